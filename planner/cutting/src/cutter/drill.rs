//! A twist drill: two or more straight lips beside the axis, and the chisel edge across the web between them.
//!
//! A lip is a straight line that passes the axis at the distance w (half the web) and makes the angle ε with it, so that at the
//! radius r the web angle is β = asin(w/r) and the lip's height above the chisel edge z = (√(r² − w²) − √(R_c² − w²))/tan ε, with
//! R_c = w/sin ψ where it starts. Turning, it sweeps a hyperboloid that ends in a cylinder of the drill's radius.
//!
//! Normal rake of a lip, with the local helix angle tan θ_l = (r/R) tan θ:
//!
//! ```text
//! γ_n = atan(tan θ_l cos β / (sin ε − cos ε tan θ_l sin β)) − atan((sin β cos ε − sin ε tan μ)/cos β)
//! ```
//!
//! and of the chisel edge, which is perpendicular to the axis, γ_n = −atan(tan ε sin ψ) + μ.
//!
//! Left out: the flutes' own shape, margins, relief, and lips that are not straight.
//!
//! **Source:** Faieghi et al., section II-E, equation (6), with `cos p` = cos ε; docs/force-model.md 9.

use bonemill_geometry::{Mesh, Point, Tool};

use crate::cutter::edge::{EdgePlace, checked_count, checked_feed, feed_angle_rad};
use crate::cutter::{Cutter, CutterError, CuttingEdges, EdgeElement, EdgeKind, SolidOfRevolution, checked};

/// Dimensions of a twist drill.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwistDrillSpec {
    /// R, mm.
    pub radius_mm: f64,
    /// ε, half of the angle that the lips enclose, degrees.
    pub point_deg: f64,
    /// θ, helix angle at the periphery, degrees.
    pub helix_deg: f64,
    /// ψ, angle of the chisel edge, degrees.
    pub chisel_deg: f64,
    /// w, half the width of the chisel edge, mm: the lips' distance from the axis.
    pub web_mm: f64,
    /// N_c.
    pub lips: u32,
    /// Length of the fluted body above the lips, mm.
    pub flute_mm: f64,
}

impl TwistDrillSpec {
    /// The drill of Faieghi et al., section III-A; web, lips and flute are assumed.
    pub const FAIEGHI: Self = Self {
        radius_mm: 1.25,
        point_deg: 59.0,
        helix_deg: 20.0,
        chisel_deg: 116.0,
        web_mm: 0.15,
        lips: 2,
        flute_mm: 10.0,
    };
}

/// A twist drill; its dimensions make an edge everywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct TwistDrill {
    spec: TwistDrillSpec,
    inner_mm: f64,
    solid: SolidOfRevolution,
    chisel_turns_with_feed: bool,
}

/// Pieces of the profile along a lip: the chords of the hyperboloid are off by less than w/400.
const LIP_PIECES: usize = 24;
/// Facets around the mesh.
const FACETS: usize = 96;

impl TwistDrill {
    /// A drill.
    ///
    /// # Errors
    /// [`CutterError`] for dimensions that no drill has: a point angle outside 15° to 90°, a helix of 60° or more, a web that
    /// leaves no lip, a flute that undercuts it.
    pub fn new(spec: TwistDrillSpec) -> Result<Self, CutterError> {
        let TwistDrillSpec { radius_mm, point_deg, helix_deg, chisel_deg, web_mm, lips, flute_mm } = spec;
        checked("drill radius, mm", radius_mm, |r| (0.05..=50.0).contains(&r), "0.05 to 50")?;
        checked(
            "point angle, degrees",
            point_deg,
            |e| (15.0..=90.0).contains(&e),
            "15 to 90: half of the angle between the lips",
        )?;
        checked("helix angle, degrees", helix_deg, |t| (0.0..60.0).contains(&t), "0 to below 60")?;
        checked("chisel edge angle, degrees", chisel_deg, |p| p > 0.0 && p < 180.0, "above 0, below 180")?;
        checked("half web, mm", web_mm, |w| w >= 0.0 && w < radius_mm, "0 or more, below the radius")?;
        checked("lips", f64::from(lips), |n| (1.0..=12.0).contains(&n), "1 to 12")?;
        checked("flute length, mm", flute_mm, |l| l > 0.0 && l <= 1e3, "above 0, at most 1000")?;
        let inner_mm = web_mm / chisel_deg.to_radians().sin();
        if inner_mm >= radius_mm {
            return Err(CutterError::NoLip { inner_mm, radius_mm });
        }
        let drill = Self { spec, inner_mm, solid: profile(&spec, inner_mm)?, chisel_turns_with_feed: true };
        // the rake's denominator falls with r sin β tan θ_l, which is the same everywhere: one place stands for all
        if drill.rake_denominator(radius_mm) <= 0.0 {
            return Err(CutterError::Undercut { radius_mm });
        }
        Ok(drill)
    }

    /// The same drill with the static rake of the chisel edge, without the feed angle.
    #[must_use]
    pub fn with_static_chisel_rake(self) -> Self {
        Self { chisel_turns_with_feed: false, ..self }
    }

    /// Its dimensions.
    pub fn spec(&self) -> &TwistDrillSpec {
        &self.spec
    }

    /// R_c = w/sin ψ, where the lips start, mm.
    pub fn inner_radius_mm(&self) -> f64 {
        self.inner_mm
    }

    /// Height of the lips' outer end above the chisel edge, mm.
    pub fn lip_height_mm(&self) -> f64 {
        height_mm(&self.spec, self.inner_mm, self.spec.radius_mm)
    }

    fn tan_local_helix(&self, radius_mm: f64) -> f64 {
        radius_mm / self.spec.radius_mm * self.spec.helix_deg.to_radians().tan()
    }

    fn rake_denominator(&self, radius_mm: f64) -> f64 {
        let (se, ce) = self.spec.point_deg.to_radians().sin_cos();
        se - ce * self.tan_local_helix(radius_mm) * self.spec.web_mm / radius_mm
    }

    /// Element of a lip about the radius r; its width along the radius.
    fn lip(&self, radius_mm: f64, width_mm: f64, feed_mm_rev: f64) -> EdgeElement {
        let epsilon = self.spec.point_deg.to_radians();
        let beta = (self.spec.web_mm / radius_mm).asin();
        let ((se, ce), (sb, cb)) = (epsilon.sin_cos(), beta.sin_cos());
        let tan_helix = self.tan_local_helix(radius_mm);
        let height = height_mm(&self.spec, self.inner_mm, radius_mm);
        let place = EdgePlace {
            position_mm: Point::new(radius_mm * cb, radius_mm * sb, height),
            radius_mm,
            width_mm,
            feed_share: 1.0 / f64::from(self.spec.lips),
            epsilon_rad: epsilon,
            beta_rad: beta,
        };
        place.lip(feed_mm_rev, |mu| {
            let of_flute = (tan_helix * cb / (se - ce * tan_helix * sb)).atan();
            of_flute - ((sb * ce - se * mu.tan()) / cb).atan()
        })
    }

    /// Element of the chisel edge about the radius r.
    fn chisel(&self, radius_mm: f64, width_mm: f64, feed_mm_rev: f64) -> EdgeElement {
        let mu = feed_angle_rad(feed_mm_rev, radius_mm);
        let still =
            -(self.spec.point_deg.to_radians().tan() * self.spec.chisel_deg.to_radians().sin()).atan();
        // it ends where the lip starts, at the azimuth β there
        let azimuth = self.spec.chisel_deg.to_radians().sin().asin();
        let place = EdgePlace {
            position_mm: Point::new(radius_mm * azimuth.cos(), radius_mm * azimuth.sin(), 0.0),
            radius_mm,
            width_mm,
            feed_share: 1.0 / f64::from(self.spec.lips),
            epsilon_rad: std::f64::consts::FRAC_PI_2,
            beta_rad: 0.0,
        };
        let gamma_n_rad = still + if self.chisel_turns_with_feed { mu } else { 0.0 };
        EdgeElement { mu_rad: mu, gamma_n_rad, ..place.with_angles(EdgeKind::Chisel) }
    }
}

impl Cutter for TwistDrill {
    fn solid(&self) -> &SolidOfRevolution {
        &self.solid
    }

    /// `elements` along a lip, from R_c outwards, then as many along the chisel edge unless the web is 0.
    fn edges(&self, feed_mm_rev: f64, elements: usize) -> Result<CuttingEdges, CutterError> {
        let count = checked_count(elements)?;
        let f = if self.spec.point_deg == 90.0 {
            checked("feed, mm a revolution", feed_mm_rev, |f| (0.0..=100.0).contains(&f), "0 to 100")?
        } else {
            checked_feed(feed_mm_rev, self.spec.lips, self.lip_height_mm())?
        };
        let (from, to) = (self.inner_mm, self.spec.radius_mm);
        let [lip_mm, chisel_mm] = [to - from, from].map(|length| length / count as f64);
        let lips = (0..count).map(|k| self.lip(from + (k as f64 + 0.5) * lip_mm, lip_mm, f));
        let chisels = (0..count).map(|k| self.chisel((k as f64 + 0.5) * chisel_mm, chisel_mm, f));
        let chisels = chisels.take(if from > 0.0 { count } else { 0 });
        Ok(CuttingEdges { elements: lips.chain(chisels).collect(), copies: self.spec.lips })
    }

    fn mesh(&self) -> Mesh<Tool> {
        self.solid.mesh(FACETS)
    }
}

/// Height of a lip at the radius r above where it starts, mm.
fn height_mm(spec: &TwistDrillSpec, inner_mm: f64, radius_mm: f64) -> f64 {
    let along = |r: f64| (r * r - spec.web_mm * spec.web_mm).max(0.0).sqrt();
    // cot 90° is 0, not 6e-17
    let cot = if spec.point_deg == 90.0 { 0.0 } else { 1.0 / spec.point_deg.to_radians().tan() };
    (along(radius_mm) - along(inner_mm)) * cot
}

fn profile(spec: &TwistDrillSpec, inner_mm: f64) -> Result<SolidOfRevolution, CutterError> {
    let mut points = vec![[0.0, inner_mm]];
    for n in 1..=LIP_PIECES {
        // closer together near the chisel edge, where the hyperboloid bends
        let share = (n as f64 / LIP_PIECES as f64).powi(2);
        let radius_mm = inner_mm + (spec.radius_mm - inner_mm) * share;
        points.push([height_mm(spec, inner_mm, radius_mm), radius_mm]);
    }
    let top_mm = points.last().map_or(0.0, |p| p[0]) + spec.flute_mm;
    points.push([top_mm, spec.radius_mm]);
    SolidOfRevolution::new(&points)
}
