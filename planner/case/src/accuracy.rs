//! `[accuracy]`: the approximations of a plan that have a price in time, each with a key; a level sets all that the case leaves out.

use super::keys as k;
use super::walker::Walk;

/// The error of a level's forces, the larger of |F| and push toward structures of single cuts, the cheapest level first: rounded up from what
/// `experiment speed-vs-error` measures.
const FRONT: [(Level, f64); 3] = [(Level::Coarse, 0.015), (Level::Default, 0.007), (Level::Fine, 0.003)];

/// How finely a plan is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// By what share the forces of single cuts may err in the mean, where the case asks for it.
    pub force: Option<f64>,
    /// What the other values are where the case does not give them.
    pub level: Level,
    /// Elements of the force sum from tip to shaft where a force is stated, and twice as many around.
    pub force_elements: u32,
    /// Directions in which bone is looked for, two of which make a sample, where axes are chosen and within moves.
    pub force_directions: u32,
    /// Forces at neighbouring places within a move differ by less than this share of the larger.
    pub force_change: f64,
    /// Spacing of the shaft's directions in a plane, rad; three times that over a cap.
    pub axis_spacing_rad: f64,
}

impl Accuracy {
    /// All values of a level.
    pub fn of(level: Level) -> Self {
        let (force_elements, force_directions, force_change, spacing_deg) = match level {
            Level::Coarse => (32, 512, 0.2, 4.0f64),
            Level::Default => (64, 1024, 0.05, 2.0),
            Level::Fine => (128, 4096, 0.02, 2.0),
        };
        let axis_spacing_rad = spacing_deg.to_radians();
        Self { force: None, level, force_elements, force_directions, force_change, axis_spacing_rad }
    }

    /// With sums of forces that err by about half: twice as many elements, and places within moves at smaller changes.
    #[must_use]
    pub fn with_finer_forces(self) -> Self {
        Self { force_elements: 2 * self.force_elements, force_change: 0.4 * self.force_change, ..self }
    }

    pub(super) fn read(t: Walk<'_, '_>) -> Self {
        let force = t.optional(&k::FORCE_ERROR);
        let usual = Self::of(t.choice(&k::LEVEL, force.map_or(Level::Default, Level::cheapest)));
        let spacing_rad = t.optional(&k::AXIS_SPACING).map(f64::to_radians);
        let accuracy = Self {
            force,
            level: usual.level,
            force_elements: t.whole(&k::FORCE_ELEMENTS, usual.force_elements),
            force_directions: t.whole(&k::FORCE_DIRECTIONS, usual.force_directions),
            force_change: t.optional(&k::FORCE_CHANGE).unwrap_or(usual.force_change),
            axis_spacing_rad: spacing_rad.unwrap_or(usual.axis_spacing_rad),
        };
        t.finish();
        accuracy
    }
}

/// A setting of all approximations.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    /// For a preview.
    Coarse,
    /// For a plan.
    Default,
    /// For a check of a plan's figures.
    Fine,
}

impl Level {
    /// The cheapest whose forces err by no more than a share, or the finest.
    fn cheapest(force: f64) -> Self {
        FRONT.into_iter().find(|(_, error)| *error <= force).map_or(Self::Fine, |(level, _)| level)
    }

    /// Voxel of the planning grid and distance of neighbouring waypoints, mm, for a burr of this radius.
    pub fn within_mm(self, radius_mm: f64) -> [f64; 2] {
        match self {
            Self::Coarse => [0.5f64.min(radius_mm / 2.0), 0.5f64.min(radius_mm)],
            Self::Default | Self::Fine => [0.25, 0.25],
        }
    }
}
