//! A glenoid reamer: curved edges on a sphere-like shell, guided by a nipple in a pilot hole.
//!
//! Each edge is an arc of the radius R whose centre lies at the distance w from the axis, so that at the radius r
//! ε = acos((r − w)/R); it starts at r = w, where it is perpendicular to the axis, and ends at the rim R_o. Seen along the axis it is a
//! straight line that makes the angle α with the radius at the rim: β = asin(R_o sin α/r). Rake: γ_n = 0. The nipple fills the pilot
//! hole and does not cut; what lies between it and the edges is swept by the reamer's face, and gives no force.
//!
//! **Source:** Faieghi et al., section III-B. They print R sin α/r for β; with the arc's radius R = 16.22 mm instead of the rim's
//! R_o = 18.25 mm the angle at the rim is 8.40°, not α = 9.46° (docs/force-model.md 9).

use bonemill_geometry::{Mesh, Point, Tool};

use crate::cutter::edge::{EdgePlace, checked_count, checked_feed};
use crate::cutter::{Cutter, CutterError, CuttingEdges, EdgeElement, SolidOfRevolution, checked};

/// Dimensions of a glenoid reamer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GlenoidReamerSpec {
    /// R, radius of the edges' arc, mm.
    pub arc_radius_mm: f64,
    /// w, distance of the arc's centre from the axis, mm.
    pub offset_mm: f64,
    /// R_o, radius of the rim, mm.
    pub rim_radius_mm: f64,
    /// α, angle between edge and radius at the rim, degrees.
    pub edge_deg: f64,
    /// N_c, number of edges.
    pub edges: u32,
    /// Radius of the guide, mm; 0: none.
    pub nipple_radius_mm: f64,
    /// How far the guide stands out below the edges, mm.
    pub nipple_length_mm: f64,
}

impl GlenoidReamerSpec {
    /// The reamer of Faieghi et al., section III-B, without its guide.
    pub const FAIEGHI: Self = Self {
        arc_radius_mm: 16.22,
        offset_mm: 6.43,
        rim_radius_mm: 18.25,
        edge_deg: 9.46,
        edges: 5,
        nipple_radius_mm: 0.0,
        nipple_length_mm: 0.0,
    };
}

/// A glenoid reamer; its dimensions make an edge everywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct GlenoidReamer {
    spec: GlenoidReamerSpec,
    /// Distance of the edges' lines from the axis, mm: r sin β everywhere.
    line_mm: f64,
    solid: SolidOfRevolution,
}

/// Chords of the arc leave it by at most this, mm.
const ARC_TOLERANCE_MM: f64 = 5e-4;
/// Height of the shell above the rim, mm, assumed: what follows the edges into the bone.
const SHELL_MM: f64 = 2.0;
/// Facets around the mesh.
const FACETS: usize = 160;

impl GlenoidReamer {
    /// A reamer.
    ///
    /// # Errors
    /// [`CutterError`] for dimensions that no reamer has.
    pub fn new(spec: GlenoidReamerSpec) -> Result<Self, CutterError> {
        Self::with_line_at(spec, spec.rim_radius_mm)
    }

    /// The reamer with β as the source prints it, R sin α/r, whose angle at the rim is not α. For comparisons only.
    ///
    /// # Errors
    /// As [`GlenoidReamer::new`].
    pub fn with_beta_as_printed(spec: GlenoidReamerSpec) -> Result<Self, CutterError> {
        Self::with_line_at(spec, spec.arc_radius_mm)
    }

    fn with_line_at(spec: GlenoidReamerSpec, radius_of_alpha_mm: f64) -> Result<Self, CutterError> {
        let GlenoidReamerSpec { arc_radius_mm, offset_mm, rim_radius_mm, edge_deg, .. } = spec;
        checked("arc radius, mm", arc_radius_mm, |r| (0.5..=100.0).contains(&r), "0.5 to 100")?;
        checked(
            "offset of the arc's centre, mm",
            offset_mm,
            |w| (0.0..100.0).contains(&w),
            "0 to below 100",
        )?;
        checked("edge angle, degrees", edge_deg, |a| (0.0..90.0).contains(&a), "0 to below 90")?;
        checked("edges", f64::from(spec.edges), |n| (1.0..=64.0).contains(&n), "1 to 64")?;
        let (least_mm, most_mm) = (offset_mm, offset_mm + arc_radius_mm);
        if !(rim_radius_mm > least_mm && rim_radius_mm < most_mm) {
            return Err(CutterError::RimOffArc { rim_mm: rim_radius_mm, least_mm, most_mm });
        }
        let in_face = |r: f64| (0.0..=offset_mm).contains(&r);
        checked("nipple radius, mm", spec.nipple_radius_mm, in_face, "0 up to the offset: it must not cut")?;
        checked("nipple length, mm", spec.nipple_length_mm, |l| (0.0..=100.0).contains(&l), "0 to 100")?;
        let line_mm = radius_of_alpha_mm * edge_deg.to_radians().sin();
        // with an offset of 0 the innermost edge is only reached in the limit
        if line_mm > offset_mm {
            return Err(CutterError::EdgeOffAxis { radius_mm: offset_mm, offset_mm: line_mm });
        }
        Ok(Self { solid: profile(&spec)?, spec, line_mm })
    }

    /// Its dimensions.
    pub fn spec(&self) -> &GlenoidReamerSpec {
        &self.spec
    }

    /// Height of the rim above the edges' start, mm.
    pub fn lip_height_mm(&self) -> f64 {
        height_mm(&self.spec, self.spec.rim_radius_mm)
    }

    fn lip(&self, radius_mm: f64, width_mm: f64, feed_mm_rev: f64) -> EdgeElement {
        let beta = (self.line_mm / radius_mm).asin();
        let (sin_beta, cos_beta) = beta.sin_cos();
        let place = EdgePlace {
            position_mm: Point::new(
                radius_mm * cos_beta,
                radius_mm * sin_beta,
                height_mm(&self.spec, radius_mm),
            ),
            radius_mm,
            width_mm,
            feed_share: 1.0 / f64::from(self.spec.edges),
            epsilon_rad: ((radius_mm - self.spec.offset_mm) / self.spec.arc_radius_mm).acos(),
            beta_rad: beta,
        };
        place.lip(feed_mm_rev, |_| 0.0)
    }
}

impl Cutter for GlenoidReamer {
    fn solid(&self) -> &SolidOfRevolution {
        &self.solid
    }

    /// `elements` along an edge, from the offset to the rim.
    fn edges(&self, feed_mm_rev: f64, elements: usize) -> Result<CuttingEdges, CutterError> {
        let count = checked_count(elements)?;
        let f = checked_feed(feed_mm_rev, self.spec.edges, self.lip_height_mm())?;
        let from = self.spec.offset_mm;
        let width = (self.spec.rim_radius_mm - from) / count as f64;
        let elements = (0..count).map(|k| self.lip(from + (k as f64 + 0.5) * width, width, f)).collect();
        Ok(CuttingEdges { elements, copies: self.spec.edges })
    }

    fn mesh(&self) -> Mesh<Tool> {
        self.solid.mesh(FACETS)
    }
}

/// Height of an edge at the radius r above its start, mm.
fn height_mm(spec: &GlenoidReamerSpec, radius_mm: f64) -> f64 {
    let out = (radius_mm - spec.offset_mm) / spec.arc_radius_mm;
    spec.arc_radius_mm * (1.0 - (1.0 - out * out).max(0.0).sqrt())
}

fn profile(spec: &GlenoidReamerSpec) -> Result<SolidOfRevolution, CutterError> {
    let mut points = Vec::new();
    if spec.nipple_radius_mm > 0.0 && spec.nipple_length_mm > 0.0 {
        points.push([-spec.nipple_length_mm, spec.nipple_radius_mm]);
        points.push([0.0, spec.nipple_radius_mm]);
    }
    points.push([0.0, spec.offset_mm]);
    let open = ((spec.rim_radius_mm - spec.offset_mm) / spec.arc_radius_mm).asin();
    let step = 2.0 * (1.0 - ARC_TOLERANCE_MM / spec.arc_radius_mm).acos();
    let pieces = (open / step).ceil().max(1.0) as usize;
    for n in 1..=pieces {
        let (sin, cos) = (open * n as f64 / pieces as f64).sin_cos();
        points.push([spec.arc_radius_mm * (1.0 - cos), spec.offset_mm + spec.arc_radius_mm * sin]);
    }
    let rim_mm = points.last().map_or(0.0, |p| p[0]);
    points.push([rim_mm + SHELL_MM, spec.rim_radius_mm]);
    SolidOfRevolution::new(&points)
}
