//! `[accuracy]`: the approximations of a plan that have a price in time, each with a key; a level sets all that the case leaves out.

use super::keys as k;
use super::walker::Walk;

/// What a plan of each level errs by at most, the cheapest level first: rounded up from what plans of block, temporal bone and, by default,
/// tbone_RT143 measure on themselves; fine forces from the block's.
const FRONT: [(Level, [f64; 3]); 3] = [
    (Level::Coarse, [0.016, 0.007, 0.005]),
    (Level::Default, [0.008, 0.003, 0.001]),
    (Level::Fine, [0.003, 0.003, 0.001]),
];

/// How finely a plan is computed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Accuracy {
    /// What a plan may err by.
    pub asked: AskedErrors,
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

/// Errors that a case allows, where it asks for them.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct AskedErrors {
    /// Share by which the forces of single cuts may err in the mean, in size and toward structures.
    pub force: Option<f64>,
    /// Share of the target by which the removed volume may err.
    pub removed: Option<f64>,
    /// By how much a least distance may be too large, mm.
    pub distance_mm: Option<f64>,
}

impl AskedErrors {
    /// The cheapest level that keeps them, or the finest; the default where nothing is asked.
    fn cheapest(&self) -> Level {
        let Self { force, removed, distance_mm } = *self;
        let asked = [force, removed, distance_mm];
        if asked.iter().all(Option::is_none) {
            return Level::Default;
        }
        let keeps = |errors: &[f64; 3]| {
            errors.iter().zip(asked).all(|(error, most)| most.is_none_or(|most| *error <= most))
        };
        FRONT.into_iter().find(|(_, errors)| keeps(errors)).map_or(Level::Fine, |(level, _)| level)
    }
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
        let asked = AskedErrors::default();
        Self { asked, level, force_elements, force_directions, force_change, axis_spacing_rad }
    }

    /// With sums of forces that err by about half: twice as many elements, and places within moves at smaller changes, as far as the keys go.
    #[must_use]
    pub fn with_finer_forces(self) -> Self {
        let force_elements = (2 * self.force_elements).min(k::FORCE_ELEMENTS.max as u32);
        let force_change = (0.4 * self.force_change).max(k::FORCE_CHANGE.min);
        Self { force_elements, force_change, ..self }
    }

    pub(super) fn read(t: Walk<'_, '_>) -> Self {
        let asked = AskedErrors {
            force: t.optional(&k::FORCE_ERROR),
            removed: t.optional(&k::REMOVED_ERROR),
            distance_mm: t.optional(&k::DISTANCE_ERROR),
        };
        let usual = Self::of(t.choice(&k::LEVEL, asked.cheapest()));
        let spacing_rad = t.optional(&k::AXIS_SPACING).map(f64::to_radians);
        let accuracy = Self {
            asked,
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
    /// Voxel of the planning grid and distance of neighbouring waypoints, mm, for a burr of this radius.
    pub fn within_mm(self, radius_mm: f64) -> [f64; 2] {
        match self {
            Self::Coarse => [0.5f64.min(radius_mm / 2.0), 0.5f64.min(radius_mm)],
            Self::Default | Self::Fine => [0.25, 0.25],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Case;

    const LEAST: &str = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n";

    #[test]
    fn the_cheapest_level_that_keeps_what_is_asked_is_taken_unless_one_is_given() {
        for (asked, level) in [
            ("", Level::Default),
            ("force = 0.02", Level::Coarse),
            ("force = 0.02\nremoved = 0.005", Level::Default),
            ("distance_mm = 0.01", Level::Coarse),
            ("force = 0.005", Level::Fine),
            ("force = 0.0005", Level::Fine),
            ("force = 0.02\nlevel = \"fine\"", Level::Fine),
        ] {
            let text = format!("{LEAST}[target]\nlabel = 1\n[accuracy]\n{asked}\n");
            let case = Case::parse(&text, "case.toml".as_ref()).unwrap();
            assert_eq!(case.accuracy.level, level, "{asked}");
            assert_eq!(case.grid.spacing_mm, level.within_mm(case.burr.radius_mm)[0], "{asked}");
        }
    }

    #[test]
    fn a_channel_is_asked_for_no_error() {
        let channel = "[path]\npattern = \"plunge\"\nentry_mm = [0, 0, 0]\ntarget_mm = [0, 0, 9]\n";
        let text = format!("{LEAST}{channel}[accuracy]\nforce = 0.02\n");
        let told = Case::parse(&text, "case.toml".as_ref()).unwrap_err().to_string();
        assert!(told.contains("accuracy.force") && told.contains("not on channels"), "{told}");
    }
}
