//! Cutting edges as chains of elements with the angles of oblique cutting.
//!
//! The angles of an element follow from where it lies and from the feed f, mm a revolution (docs/force-model.md 9):
//!
//! ```text
//! μ = atan(f/(2πr))                                        feed angle: the velocity is V = (0, cos μ, −sin μ)
//! e = (sin ε cos β, −sin ε sin β, cos ε)                   the edge, away from the axis
//! sin λ = −e·V = sin β cos μ sin ε + sin μ cos ε           inclination
//! τ = atan2(cos ε cos μ − sin ε sin β sin μ, sin ε cos β)
//! ```
//!
//! in the frame of the element: x radial, z along the shaft, y = z × x in the sense of the turn. An element's width is radial.
//!
//! **Source:** Faieghi et al., section II-D and II-E, with the corrections of docs/force-model.md 9; τ by atan2 instead of the
//! printed arccos, which loses its sign.

use std::f64::consts::PI;

use bonemill_geometry::{Mesh, Point, Tool};

use crate::cutter::{CutterError, SolidOfRevolution, checked};

/// Which kind of edge an element belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum EdgeKind {
    /// A cutting lip, or any edge of a cutter without a chisel edge.
    Lip,
    /// The chisel edge across the web of a drill.
    Chisel,
}

impl EdgeKind {
    /// The word in files and in Python.
    pub fn word(self) -> &'static str {
        match self {
            Self::Lip => "lip",
            Self::Chisel => "chisel",
        }
    }
}

/// One element of a cutting edge at a given feed. Angles in rad; its frame: x radial, z along the shaft, y in the sense of the turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeElement {
    /// Its middle.
    pub position_mm: Point<Tool>,
    /// Distance of its middle from the axis, mm.
    pub radius_mm: f64,
    /// Its extent away from the axis, mm.
    pub width_mm: f64,
    /// The part of the feed of a revolution that it cuts: 1 over the number of edges that pass its radius.
    pub feed_share: f64,
    /// Point angle ε: between the edge and the axis.
    pub epsilon_rad: f64,
    /// Web angle β: between the radial direction and the edge's projection along the axis.
    pub beta_rad: f64,
    /// Feed angle μ.
    pub mu_rad: f64,
    /// Inclination λ.
    pub lambda_rad: f64,
    /// Rotation τ from the frame of the velocity to the tool's.
    pub tau_rad: f64,
    /// Normal rake γ_n.
    pub gamma_n_rad: f64,
    /// Lip or chisel edge.
    pub kind: EdgeKind,
}

/// Where an element lies and how it is shaped, before the feed is known.
#[derive(Debug, Clone, Copy)]
pub(crate) struct EdgePlace {
    pub position_mm: Point<Tool>,
    pub radius_mm: f64,
    pub width_mm: f64,
    pub feed_share: f64,
    pub epsilon_rad: f64,
    pub beta_rad: f64,
}

impl EdgePlace {
    /// The element of a lip at a feed; `rake` gives γ_n, rad, from μ, rad.
    pub fn lip(self, feed_mm_rev: f64, rake: impl FnOnce(f64) -> f64) -> EdgeElement {
        let mu = feed_angle_rad(feed_mm_rev, self.radius_mm);
        let ((se, ce), (sb, cb), (sm, cm)) =
            (self.epsilon_rad.sin_cos(), self.beta_rad.sin_cos(), mu.sin_cos());
        let sin_lambda: f64 = sb * cm * se + sm * ce;
        EdgeElement {
            mu_rad: mu,
            lambda_rad: sin_lambda.clamp(-1.0, 1.0).asin(),
            tau_rad: (ce * cm - se * sb * sm).atan2(se * cb),
            gamma_n_rad: rake(mu),
            ..self.with_angles(EdgeKind::Lip)
        }
    }

    /// The element without what depends on the feed: μ, λ, τ and γ_n are 0.
    pub fn with_angles(self, kind: EdgeKind) -> EdgeElement {
        EdgeElement {
            position_mm: self.position_mm,
            radius_mm: self.radius_mm,
            width_mm: self.width_mm,
            feed_share: self.feed_share,
            epsilon_rad: self.epsilon_rad,
            beta_rad: self.beta_rad,
            mu_rad: 0.0,
            lambda_rad: 0.0,
            tau_rad: 0.0,
            gamma_n_rad: 0.0,
            kind,
        }
    }
}

/// μ = atan(f/(2πr)), rad. **Source:** Faieghi et al., II-D.
pub(crate) fn feed_angle_rad(feed_mm_rev: f64, radius_mm: f64) -> f64 {
    (feed_mm_rev / (2.0 * PI * radius_mm)).atan()
}

/// A feed that makes sense: 0 or more, at most 100 mm a revolution, and no more a lip than the lip is high.
///
/// # Errors
/// [`CutterError::OutOfRange`], [`CutterError::FeedOutrunsLip`].
pub(crate) fn checked_feed(feed_mm_rev: f64, lips: u32, height_mm: f64) -> Result<f64, CutterError> {
    checked("feed, mm a revolution", feed_mm_rev, |f| (0.0..=100.0).contains(&f), "0 to 100")?;
    let per_lip_mm = feed_mm_rev / f64::from(lips);
    if per_lip_mm >= height_mm {
        return Err(CutterError::FeedOutrunsLip { feed_mm_rev, per_lip_mm, height_mm });
    }
    Ok(feed_mm_rev)
}

/// How many elements an edge may have.
///
/// # Errors
/// [`CutterError::OutOfRange`] unless 1 to 100 000.
pub(crate) fn checked_count(elements: usize) -> Result<usize, CutterError> {
    checked("elements of an edge", elements as f64, |n| (1.0..=1e5).contains(&n), "1 to 100 000")?;
    Ok(elements)
}

/// The elements of a cutter's edges at a feed.
#[derive(Debug, Clone, PartialEq)]
pub struct CuttingEdges {
    /// Elements of those edges that are not turned copies of others.
    pub elements: Vec<EdgeElement>,
    /// How many times these stand around the axis, equally spaced.
    pub copies: u32,
}

/// A cutter that turns about its axis.
pub trait Cutter: Sync {
    /// What it sweeps when it turns once, without feed.
    fn solid(&self) -> &SolidOfRevolution;

    /// Its cutting elements at a feed, mm a revolution: `elements` along every edge.
    ///
    /// # Errors
    /// [`CutterError`] for a feed that outruns the lips, or a count beyond 1 to 100 000.
    fn edges(&self, feed_mm_rev: f64, elements: usize) -> Result<CuttingEdges, CutterError>;

    /// Its surface, for a viewer and a point shell.
    fn mesh(&self) -> Mesh<Tool>;
}
