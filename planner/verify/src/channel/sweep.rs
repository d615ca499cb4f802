//! What the tool of a channel sweeps, from the dimensions in the case, and the volumes that this gives.

use bonemill_case::Tool;
use bonemill_geometry::{Grid, Point, Work};
use bonemill_planfile::{ChannelRecord, StoredPlan};

use super::super::anatomy::Anatomy;
use super::super::check::Check;

/// Height of a reamer's shell above its rim, mm, as the planner assumes it.
const SHELL_MM: f64 = 2.0;
/// Share of a volume, and voxels, that the planner's chords of curved profiles and its interpolation may differ by.
const VOLUME_SHARE: f64 = 5e-3;
const VOLUME_VOXELS: f64 = 8.0;

/// The solid of a tool: the height of its front at each radius.
pub enum OwnSolid {
    /// Lips at the distance w from the axis, of slope cot ε, from R_c on; flat inside.
    Drill { web_mm: f64, inner_mm: f64, cot: f64, radius_mm: f64, top_mm: f64 },
    /// An arc of radius R about a point at the distance w from the axis; flat inside, with a guide below.
    Reamer { arc_mm: f64, offset_mm: f64, rim_mm: f64, top_mm: f64 },
    /// No solid.
    None,
}

impl OwnSolid {
    /// Of a case's tool.
    pub fn new(tool: &Tool) -> Self {
        match tool {
            Tool::Drill(s, _) => {
                let inner_mm = s.web_mm / s.chisel_deg.to_radians().sin();
                let cot = if s.point_deg >= 90.0 { 0.0 } else { 1.0 / s.point_deg.to_radians().tan() };
                let along = |r: f64| (r * r - s.web_mm * s.web_mm).max(0.0).sqrt();
                let top_mm = (along(s.radius_mm) - along(inner_mm)) * cot + s.flute_mm;
                Self::Drill { web_mm: s.web_mm, inner_mm, cot, radius_mm: s.radius_mm, top_mm }
            }
            Tool::Reamer(s, _) => {
                let out = (s.rim_radius_mm - s.offset_mm) / s.arc_radius_mm;
                let top_mm = s.arc_radius_mm * (1.0 - (1.0 - out * out).max(0.0).sqrt()) + SHELL_MM;
                Self::Reamer {
                    arc_mm: s.arc_radius_mm,
                    offset_mm: s.offset_mm,
                    rim_mm: s.rim_radius_mm,
                    top_mm,
                }
            }
            Tool::Burr | Tool::Mesh(..) => Self::None,
        }
    }

    /// Height of the front at a radius, mm; `None` beyond the tool.
    fn front_mm(&self, radius: f64) -> Option<f64> {
        match *self {
            Self::Drill { web_mm, inner_mm, cot, radius_mm, .. } => (radius <= radius_mm).then(|| {
                let along = |r: f64| (r * r - web_mm * web_mm).max(0.0).sqrt();
                if radius <= inner_mm { 0.0 } else { (along(radius) - along(inner_mm)) * cot }
            }),
            Self::Reamer { arc_mm, offset_mm, rim_mm, .. } => (radius <= rim_mm).then(|| {
                let out = ((radius - offset_mm) / arc_mm).max(0.0);
                arc_mm * (1.0 - (1.0 - out * out).max(0.0).sqrt())
            }),
            Self::None => None,
        }
    }

    fn top_mm(&self) -> f64 {
        match *self {
            Self::Drill { top_mm, .. } | Self::Reamer { top_mm, .. } => top_mm,
            Self::None => 0.0,
        }
    }

    /// Whether the part that cuts holds a point at a radius and height, mm.
    pub fn cuts(&self, radius: f64, height: f64) -> bool {
        self.front_mm(radius).is_some_and(|front| (front..=self.top_mm()).contains(&height))
    }
}

/// Where the shank begins behind the tool, mm.
pub fn top_mm(tool: &Tool) -> f64 {
    OwnSolid::new(tool).top_mm()
}

/// Radius and length of a guide in front of the tool, mm.
fn guide_mm(tool: &Tool) -> [f64; 2] {
    match tool {
        Tool::Reamer(s, _) => [s.nipple_radius_mm, s.nipple_length_mm],
        _ => [0.0, 0.0],
    }
}

/// The volumes that the plan states, counted again on its own voxels.
pub fn volumes(plan: &StoredPlan, channel: &ChannelRecord, anatomy: &Anatomy) -> Vec<Check> {
    let (case, frames) = (&plan.record.case, &plan.record.frames);
    let Ok(grid) = Grid::<Work>::aligned(frames.grid.dims, case.grid.spacing_mm, Point::new(0.0, 0.0, 0.0))
    else {
        return vec![Check::none_wrong("planning grid", 1)];
    };
    let ct_from_grid = frames.ct_from_grid();
    let solid = OwnSolid::new(&case.tool);
    let [guide_radius, guide_length] = guide_mm(&case.tool);
    let out = -channel.direction.into_inner();
    let end = channel.end();
    let way = channel.depth_mm - channel.contact_depth_mm;
    let mut counts = [0u64; 3];
    for n in 0..grid.len() {
        let p = ct_from_grid * grid.center(grid.voxel(n));
        let height = (p - end).dot(&out);
        let radius = (p - end - out * height).norm();
        let in_front = solid.front_mm(radius).is_some_and(|front| height >= front);
        let in_guide = radius <= guide_radius && guide_radius > 0.0 && height >= -guide_length;
        if height > way || !(in_front || in_guide) {
            continue;
        }
        let hu = anatomy.hu(p);
        counts[0] += 1;
        counts[1] += u64::from(hu > case.density.air_hu);
        counts[2] += u64::from(hu >= case.density.bone_hu);
    }
    let m = &plan.record.metrics;
    let stated = [m.removed_mm3, m.removed_material_mm3, m.removed_bone_mm3];
    let names = ["removed_mm3", "removed_material_mm3", "removed_bone_mm3"];
    let voxel = grid.voxel_mm3();
    let check = |n: usize| {
        let found = counts[n] as f64 * voxel;
        let limit = VOLUME_SHARE * found + VOLUME_VOXELS * voxel;
        Check::at_most("volumes as written", (stated[n] - found).abs(), limit, "mm³ off").of(names[n])
    };
    (0..3).map(check).collect()
}
