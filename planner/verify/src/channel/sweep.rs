//! What the tool of a channel sweeps, from the dimensions in the case, and the volumes that this gives.

use bonemill_case::ToolSpec;
use bonemill_planfile::{ChannelRecord, StoredPlan};
use nalgebra::Vector3;

use super::super::anatomy::Anatomy;
use super::super::check::Check;

/// Height of a reamer's shell above its rim, mm, as the planner assumes it.
const SHELL_MM: f64 = 2.0;
/// Columns along the tool's radius, and steps along a column, mm.
const COLUMNS_PER_RADIUS: i32 = 40;
const STEP_MM: f64 = 0.1;
/// Share of all that is swept by which the planner's places and these may differ.
const VOLUME_SHARE: f64 = 5e-3;

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
    pub fn new(tool: &ToolSpec) -> Self {
        match tool {
            ToolSpec::Drill(s, _) => {
                let inner_mm = s.web_mm / s.chisel_deg.to_radians().sin();
                let cot = if s.point_deg >= 90.0 { 0.0 } else { 1.0 / s.point_deg.to_radians().tan() };
                let along = |r: f64| (r * r - s.web_mm * s.web_mm).max(0.0).sqrt();
                let top_mm = (along(s.radius_mm) - along(inner_mm)) * cot + s.flute_mm;
                Self::Drill { web_mm: s.web_mm, inner_mm, cot, radius_mm: s.radius_mm, top_mm }
            }
            ToolSpec::Reamer(s, _) => {
                let out = (s.rim_radius_mm - s.offset_mm) / s.arc_radius_mm;
                let top_mm = s.arc_radius_mm * (1.0 - (1.0 - out * out).max(0.0).sqrt()) + SHELL_MM;
                Self::Reamer {
                    arc_mm: s.arc_radius_mm,
                    offset_mm: s.offset_mm,
                    rim_mm: s.rim_radius_mm,
                    top_mm,
                }
            }
            ToolSpec::Burr | ToolSpec::Mesh(..) => Self::None,
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
pub fn top_mm(tool: &ToolSpec) -> f64 {
    OwnSolid::new(tool).top_mm()
}

/// Radius of a guide in front of the tool, mm: it lies in a hole that was drilled before.
fn guide_radius_mm(tool: &ToolSpec) -> f64 {
    match tool {
        ToolSpec::Reamer(s, _) => s.nipple_radius_mm,
        _ => 0.0,
    }
}

/// The volumes that the plan states, counted again by columns along the axis, from the front to where it was at the first contact.
pub fn volumes(plan: &StoredPlan, channel: &ChannelRecord, anatomy: &Anatomy) -> Vec<Check> {
    let case = &plan.record.case;
    let solid = OwnSolid::new(&case.tool);
    let radius = super::radius_mm(case);
    let out = -channel.direction.into_inner();
    let end = channel.end();
    let right = out.cross(&Vector3::ith(out.iamin(), 1.0)).normalize();
    let up = out.cross(&right);
    let side = radius / f64::from(COLUMNS_PER_RADIUS);
    let way = channel.depth_mm - channel.contact_depth_mm;
    let steps = (way / STEP_MM).ceil().max(1.0);
    let cell_mm3 = side * side * way / steps;
    let mut counts = [0u64; 3];
    let around = || -COLUMNS_PER_RADIUS..=COLUMNS_PER_RADIUS;
    // off the axis by no simple part of a column: squares that lie evenly about a circle's centre all round it the same way
    let across = |n: i32| (f64::from(n) + 0.382) * side;
    let columns = around().flat_map(|i| around().map(move |j| [across(i), across(j)]));
    for [x, y] in columns {
        let r = x.hypot(y);
        let Some(front) = solid.front_mm(r).filter(|_| r > guide_radius_mm(&case.tool)) else { continue };
        for n in 0..steps as u32 {
            let p = end + right * x + up * y + out * (front + (f64::from(n) + 0.5) * way / steps);
            let hu = anatomy.hu(p);
            counts[0] += 1;
            counts[1] += u64::from(hu > case.density.air_hu);
            counts[2] += u64::from(hu >= case.density.bone_hu);
        }
    }
    let m = &plan.record.metrics;
    let stated = [m.removed_mm3, m.removed_material_mm3, m.removed_bone_mm3];
    let names = ["removed_mm3", "removed_material_mm3", "removed_bone_mm3"];
    let all = counts[0] as f64 * cell_mm3;
    let check = |n: usize| {
        let found = counts[n] as f64 * cell_mm3;
        let off = (stated[n] - found).abs();
        Check::at_most("volumes as written", off, VOLUME_SHARE * all, "mm³ off").of(names[n])
    };
    (0..3).map(check).collect()
}
