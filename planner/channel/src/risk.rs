//! What a straight channel keeps of every structure, and how likely the registration's error lets the tool touch it.
//!
//! The clearance c is that of the tool's swept solid (`swept.rs`). While channels are searched, the probability of touching is that of a
//! flat wall at the nearest place: P = Φ(−c/σ), with σ the error's standard deviation there toward the structure. Channels that were
//! found are judged on all sides ([`crate::touching`]): a structure around the tool is touched more often than a wall. What is missing or left
//! is then that of the wall that is touched as often.

use bonemill_cutting::importance::Importance;
use bonemill_imaging::StructureField;
use nalgebra::Vector3;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::axis::ChannelAxis;
use crate::registration_error::RegistrationError;
use crate::swept::{SweptPose, SweptTool};
use crate::touching::touch_probability;

/// A structure that a channel must keep clear of.
#[derive(Debug, Clone, Copy)]
pub struct KeptStructure<'a> {
    /// Its exact distance; `None` where no voxel of it is in the map.
    pub field: Option<&'a StructureField>,
    /// Least clearance, mm.
    pub clearance_mm: f64,
    /// Its priority over the smallest of the case: 1 is the most important.
    pub rank: f64,
}

/// What a channel keeps of one structure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeptClearance {
    /// From the surface of what the tool sweeps, mm; negative where the tool would cut the structure.
    pub clearance_mm: f64,
    /// Depth of the tip's way at which the structure is nearest, mm; negative before the entry.
    pub depth_mm: f64,
    /// Unit direction toward it there.
    pub toward: Vector3<f64>,
    /// Standard deviation of the registration's error there along that direction, mm.
    pub sigma_mm: f64,
    /// Probability that the tool touches it.
    pub touch_probability: f64,
    /// What is asked for, mm: the larger of the case's clearance and that at which the probability is the largest allowed one.
    pub needed_mm: f64,
    /// What is kept beyond that, times √rank, mm. What is missing is negative and divided by it: of two structures that cannot both
    /// be kept, the more important one comes first.
    pub weighted_margin_mm: f64,
}

/// By what channels are judged.
#[derive(Debug, Clone, Copy)]
pub struct RiskModel<'a> {
    /// In the case's order.
    pub structures: &'a [KeptStructure<'a>],
    /// What goes into the bone.
    pub tool: &'a SweptTool,
    /// How far before the entry the tool begins, mm.
    pub standoff_mm: f64,
    /// The registration's error.
    pub error: RegistrationError,
    /// Largest probability of touching, above 0 and at most 0.5.
    pub touch_probability: f64,
}

/// Which sides of the tool a probability of touching is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sides {
    /// That of the nearest place, as if the structure was a flat wall there.
    Nearest,
    /// All.
    All,
}

impl RiskModel<'_> {
    /// What a channel keeps of each structure; `None` for one that the map lacks. Clearances are told at most `tolerance_mm` too
    /// small.
    pub fn assess(&self, axis: &ChannelAxis, tolerance_mm: f64, sides: Sides) -> Vec<Option<KeptClearance>> {
        let of = |structure| self.of_structure(structure, axis, tolerance_mm, sides);
        self.structures.iter().map(of).collect()
    }

    fn of_structure(
        &self,
        structure: &KeptStructure<'_>,
        axis: &ChannelAxis,
        tolerance_mm: f64,
        sides: Sides,
    ) -> Option<KeptClearance> {
        let field = structure.field?;
        let pose = SweptPose { end: axis.end(), out: axis.out, way_mm: axis.depth_mm + self.standoff_mm };
        let found = self.tool.clearance(field, &pose, tolerance_mm);
        let clearance_mm = found.at_least_mm;
        let sigma_mm = self.error.sigma_mm(found.at, &found.toward);
        let wall = of_wall(clearance_mm, sigma_mm);
        let touched = match sides {
            Sides::Nearest => wall,
            Sides::All => {
                touch_probability(self.tool, field, &pose, &self.error, clearance_mm).unwrap_or(wall)
            }
        };
        // how far away a wall is that is touched as often
        let as_far_mm =
            if touched == wall { clearance_mm } else { -sigma_mm * Normal::standard().inverse_cdf(touched) };
        let exceeded_mm = self.error.exceeded_mm(found.at, &found.toward, self.touch_probability);
        let needed_mm = structure.clearance_mm.max(exceeded_mm + clearance_mm - as_far_mm);
        Some(KeptClearance {
            clearance_mm,
            depth_mm: axis.depth_mm - found.height_mm.max(0.0),
            toward: found.toward,
            sigma_mm,
            touch_probability: touched,
            needed_mm,
            weighted_margin_mm: weighted_mm(clearance_mm - needed_mm, structure.rank),
        })
    }
}

/// Φ(−c/σ), with which a flat wall is touched; without an error 0 or 1.
fn of_wall(clearance_mm: f64, sigma_mm: f64) -> f64 {
    if sigma_mm > 0.0 {
        Normal::standard().cdf(-clearance_mm / sigma_mm)
    } else {
        f64::from(u8::from(clearance_mm < 0.0))
    }
}

fn weighted_mm(margin_mm: f64, rank: f64) -> f64 {
    let weight = Importance::by_rank(1.0, rank);
    if margin_mm < 0.0 { margin_mm * weight } else { margin_mm / weight }
}

/// The weighted margins of all structures, mm, the least first.
pub fn margins_mm(kept: &[Option<KeptClearance>]) -> Vec<f64> {
    let mut margins_mm: Vec<f64> = kept.iter().flatten().map(|kept| kept.weighted_margin_mm).collect();
    margins_mm.sort_by(f64::total_cmp);
    margins_mm
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_cutting::cutter::SolidOfRevolution;
    use bonemill_geometry::{Ct, Grid, Point, Volume};
    use nalgebra::Unit;

    fn flat(radius_mm: f64) -> SweptTool {
        SweptTool::new(&SolidOfRevolution::new(&[[0.0, radius_mm], [4.0, radius_mm]]).unwrap()).unwrap()
    }

    #[test]
    fn a_wall_beside_a_channel_is_touched_as_often_as_a_normal_number_exceeds_the_gap() {
        let grid = Grid::<Ct>::aligned([40, 4, 40], 0.5, Point::new(0.0, -0.75, 0.0)).unwrap();
        let mut labels = Volume::filled(grid, 0u16);
        for n in 0..labels.data().len() {
            if labels.grid().voxel(n)[0] >= 20 {
                labels.data_mut()[n] = 3;
            }
        }
        let field = StructureField::new(&labels, 3, None).unwrap().unwrap();
        let structures = [KeptStructure { field: Some(&field), clearance_mm: 0.3, rank: 4.0 }];
        let tool = flat(1.0);
        let model = RiskModel {
            structures: &structures,
            tool: &tool,
            standoff_mm: 2.0,
            error: RegistrationError::uniform(0.2),
            touch_probability: 0.01,
        };
        // the wall is at x = 9.75: 0.5 mm from the tool's surface
        let out = Unit::new_unchecked(Vector3::z());
        let axis = ChannelAxis { entry: Point::new(8.25, 0.0, 15.0), out, depth_mm: 10.0 };
        let kept = model.assess(&axis, 1e-4, Sides::Nearest)[0].unwrap();
        assert!((kept.clearance_mm - 0.5).abs() < 2e-4, "{}", kept.clearance_mm);
        assert!((kept.toward - Vector3::x()).norm() < 1e-9);
        // Φ(−2.5) = 0.00621, Φ⁻¹(0.99) = 2.32635
        assert!((kept.touch_probability - 0.00621).abs() < 1e-5, "{}", kept.touch_probability);
        assert!((kept.weighted_margin_mm - 2.0 * (0.5 - 0.2 * 2.326_35)).abs() < 5e-4);
        // a shortfall counts more where the structure is more important, a margin less
        assert_eq!([weighted_mm(-0.4, 1.0), weighted_mm(-0.4, 4.0)], [-0.4, -0.2]);
        assert_eq!([weighted_mm(0.4, 1.0), weighted_mm(0.4, 4.0)], [0.4, 0.8]);
        assert_eq!([of_wall(0.1, 0.0), of_wall(-0.1, 0.0)], [0.0, 1.0]);
        // a wall on one side is no more on all sides
        let all = model.assess(&axis, 1e-4, Sides::All)[0].unwrap();
        assert!((all.touch_probability / kept.touch_probability - 1.0).abs() < 0.05, "{all:?}");
        assert!((all.weighted_margin_mm - kept.weighted_margin_mm).abs() < 0.01);
    }
}
