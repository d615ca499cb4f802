//! What the tool of a channel sweeps, from the dimensions in the case, and the volumes that this gives.

use std::path::{Path, PathBuf};

use bonemill_case::{MeshTool, ToolSpec};
use bonemill_imaging::part::read_facets;
use bonemill_planfile::{ChannelRecord, StoredPlan};
use nalgebra::Vector3;

use super::super::VerifyError;
use super::super::anatomy::Anatomy;
use super::super::check::Check;

/// Height of a reamer's shell above its rim, mm, as the planner assumes it.
const SHELL_MM: f64 = 2.0;
/// Radii, beside 0, at which the front of a mesh is kept.
const RADII: usize = 800;
/// Columns along the tool's radius, and steps along a column, mm.
const COLUMNS_PER_RADIUS: i32 = 40;
const STEP_MM: f64 = 0.02;
/// Share of all that is swept by which the planner's places and these may differ.
const VOLUME_SHARE: f64 = 5e-3;

/// The solid of a tool: the height of its front at each radius.
pub enum OwnSolid {
    /// Lips at the distance w from the axis, of slope cot ε, from R_c on; flat inside.
    Drill { web_mm: f64, inner_mm: f64, cot: f64, radius_mm: f64, top_mm: f64 },
    /// An arc of radius R about a point at the distance w from the axis; flat inside, with a guide below.
    Reamer { arc_mm: f64, offset_mm: f64, rim_mm: f64, top_mm: f64, guide_mm: [f64; 2] },
    /// The lowest point of a spinning mesh at or beyond each of equally spaced radii from 0 on.
    Mesh { front_mm: Vec<f64>, radius_mm: f64, top_mm: f64 },
    /// No solid.
    None,
}

impl OwnSolid {
    /// Of a case's tool; `place` says where the file is that the case names so.
    ///
    /// # Errors
    /// [`VerifyError::Tool`] for a mesh that cannot be read.
    pub fn new(tool: &ToolSpec, place: impl Fn(&Path) -> PathBuf) -> Result<Self, VerifyError> {
        Ok(match tool {
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
                    guide_mm: [s.nipple_radius_mm, s.nipple_length_mm],
                }
            }
            ToolSpec::Mesh(mesh, _) => Self::of_mesh(mesh, &place(&mesh.stl))?,
            ToolSpec::Burr => Self::None,
        })
    }

    /// Of a mesh that spins. On a facet the part beyond a radius has its lowest point on the facet's outline: there the height is linear and the
    /// squared radius a convex quadratic, so each edge is met at a radius once on the way up from its lower end, if that end lies
    /// within the radius.
    fn of_mesh(mesh: &MeshTool, path: &Path) -> Result<Self, VerifyError> {
        let facets = read_facets(path)
            .map_err(|source| VerifyError::Tool { path: path.into(), source: Box::new(source) })?;
        let placed = |v: &Vector3<f64>| {
            let from = v * mesh.scale_mm - mesh.axis_point_mm;
            let height = from.dot(&mesh.axis);
            (from - mesh.axis * height, height)
        };
        let corners: Vec<(Vector3<f64>, f64)> = facets.vertices.iter().map(placed).collect();
        let ends = |pick: fn(f64, f64) -> f64, start: f64| corners.iter().map(|c| c.1).fold(start, pick);
        let (low, high) = (ends(f64::min, f64::INFINITY), ends(f64::max, f64::NEG_INFINITY));
        let radius_mm = corners.iter().map(|c| c.0.norm()).fold(0.0, f64::max);
        let mut front_mm = vec![high; RADII + 1];
        let place_of = |radius: f64| radius / radius_mm * RADII as f64;
        let edges = facets.triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        for [a, b] in edges.map(|edge| edge.map(|v| corners[v as usize])) {
            let (lower, upper) = if a.1 <= b.1 { (a, b) } else { (b, a) };
            let first = place_of(lower.0.norm());
            let at = first as usize;
            front_mm[at] = front_mm[at].min(lower.1);
            let (across, rise) = (upper.0 - lower.0, upper.1 - lower.1);
            let (square, half) = (across.norm_squared(), across.dot(&lower.0));
            let end = place_of(upper.0.norm()).floor().max(first) as usize;
            for (n, front) in front_mm.iter_mut().enumerate().take(end + 1).skip(at + 1) {
                let radius2 = (n as f64 / RADII as f64 * radius_mm).powi(2);
                let root = (half * half + square * (radius2 - lower.0.norm_squared())).max(0.0).sqrt();
                *front = front.min(lower.1 + ((root - half) / square).clamp(0.0, 1.0) * rise);
            }
        }
        for n in (0..RADII).rev() {
            front_mm[n] = front_mm[n].min(front_mm[n + 1]);
        }
        front_mm.iter_mut().for_each(|z| *z -= low);
        Ok(Self::Mesh { front_mm, radius_mm, top_mm: high - low })
    }

    /// Largest radius, mm.
    pub fn radius_mm(&self) -> f64 {
        match *self {
            Self::Drill { radius_mm, .. } | Self::Mesh { radius_mm, .. } => radius_mm,
            Self::Reamer { rim_mm, .. } => rim_mm,
            Self::None => 0.0,
        }
    }

    /// Radius and length of a guide in front, mm; 0 without.
    pub fn guide_mm(&self) -> [f64; 2] {
        match *self {
            Self::Reamer { guide_mm, .. } => guide_mm,
            _ => [0.0; 2],
        }
    }

    /// Height of the front at a radius, mm; `None` beyond the tool.
    pub fn front_mm(&self, radius: f64) -> Option<f64> {
        match self {
            &Self::Drill { web_mm, inner_mm, cot, radius_mm, .. } => (radius <= radius_mm).then(|| {
                let along = |r: f64| (r * r - web_mm * web_mm).max(0.0).sqrt();
                if radius <= inner_mm { 0.0 } else { (along(radius) - along(inner_mm)) * cot }
            }),
            &Self::Reamer { arc_mm, offset_mm, rim_mm, .. } => (radius <= rim_mm).then(|| {
                let out = ((radius - offset_mm) / arc_mm).max(0.0);
                arc_mm * (1.0 - (1.0 - out * out).max(0.0).sqrt())
            }),
            Self::Mesh { front_mm, radius_mm, .. } => (radius <= *radius_mm).then(|| {
                let at = radius / radius_mm * RADII as f64;
                let n = (at as usize).min(RADII - 1);
                front_mm[n] + (front_mm[n + 1] - front_mm[n]) * (at - n as f64)
            }),
            Self::None => None,
        }
    }

    /// Where the shank begins behind the tool, mm.
    pub fn top_mm(&self) -> f64 {
        match *self {
            Self::Drill { top_mm, .. } | Self::Reamer { top_mm, .. } | Self::Mesh { top_mm, .. } => top_mm,
            Self::None => 0.0,
        }
    }

    /// Whether the part that cuts holds a point at a radius and height, mm.
    pub fn cuts(&self, radius: f64, height: f64) -> bool {
        self.front_mm(radius).is_some_and(|front| (front..=self.top_mm()).contains(&height))
    }
}

/// Radius of a guide in front of the tool, mm: it lies in a hole that was drilled before.
fn guide_radius_mm(tool: &ToolSpec) -> f64 {
    match tool {
        ToolSpec::Reamer(s, _) => s.nipple_radius_mm,
        _ => 0.0,
    }
}

/// The volumes that the plan states, counted again by columns along the axis, from the front to where it was at the first contact.
pub fn volumes(
    plan: &StoredPlan,
    channel: &ChannelRecord,
    anatomy: &Anatomy,
    solid: &OwnSolid,
) -> Vec<Check> {
    let case = &plan.record.case;
    let radius = solid.radius_mm();
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
            counts[0] += 1;
            // where the scan has ended nothing is known to be cut
            let Some(hu) = anatomy.hu_inside(p) else { continue };
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
