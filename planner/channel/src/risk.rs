//! What a straight channel keeps of every structure, and how likely the registration's error lets the tool touch it.
//!
//! The tool on its way is taken as a capsule: its largest radius around the line from the deepest place of its tip out of the
//! bone. So the clearance that is told is never above the true one, which ends at the tip's point. With the clearance c
//! at the nearest place and the error's standard deviation σ there, toward the structure, the probability of touching is
//! P = Φ(−c/σ): that the patient is off toward the tool by more than c. Where a structure surrounds the channel, P is for its
//! nearest side only; the verification draws whole motions instead.

use bonemill_imaging::StructureField;
use nalgebra::Vector3;
use statrs::distribution::{ContinuousCDF, Normal};

use crate::axis::ChannelAxis;
use crate::clearance::{Line, nearest_place};
use crate::registration_error::RegistrationError;

/// A structure that a channel must keep clear of.
#[derive(Debug, Clone, Copy)]
pub struct KeptStructure<'a> {
    /// Its exact distance; `None` where no voxel of it is in the map.
    pub field: Option<&'a StructureField>,
    /// Least clearance, mm.
    pub clearance_mm: f64,
    /// 1 is the most important.
    pub priority: u32,
}

/// What a channel keeps of one structure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeptClearance {
    /// From the tool's surface, mm; negative where the tool would cut the structure.
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
    /// What is kept beyond that, times √priority, mm. What is missing is negative and divided by it: of two structures that cannot both
    /// be kept, the more important one comes first.
    pub weighted_margin_mm: f64,
}

/// By what channels are judged.
#[derive(Debug, Clone, Copy)]
pub struct RiskModel<'a> {
    /// In the case's order.
    pub structures: &'a [KeptStructure<'a>],
    /// Largest radius of the tool that goes into the bone, mm.
    pub radius_mm: f64,
    /// How far before the entry the tool begins, mm.
    pub standoff_mm: f64,
    /// The registration's error.
    pub error: RegistrationError,
    /// Largest probability of touching, above 0 and at most 0.5.
    pub touch_probability: f64,
}

impl RiskModel<'_> {
    /// What a channel keeps of each structure; `None` for one that the map lacks. Clearances are told at most `tolerance_mm` too
    /// small.
    pub fn assess(&self, axis: &ChannelAxis, tolerance_mm: f64) -> Vec<Option<KeptClearance>> {
        self.structures.iter().map(|structure| self.of_structure(structure, axis, tolerance_mm)).collect()
    }

    fn of_structure(
        &self,
        structure: &KeptStructure<'_>,
        axis: &ChannelAxis,
        tolerance_mm: f64,
    ) -> Option<KeptClearance> {
        let length_mm = axis.depth_mm + self.standoff_mm;
        let line = Line { from: axis.end(), along: &axis.out, length_mm };
        let place = nearest_place(structure.field?, &line, tolerance_mm);
        let depth_mm = axis.depth_mm - place.along_mm;
        let clearance_mm = place.distance_mm - self.radius_mm;
        let at = axis.at(depth_mm);
        let sigma_mm = self.error.sigma_mm(at, &place.toward);
        let exceeded_mm = self.error.exceeded_mm(at, &place.toward, self.touch_probability);
        let needed_mm = structure.clearance_mm.max(exceeded_mm);
        Some(KeptClearance {
            clearance_mm,
            depth_mm,
            toward: place.toward,
            sigma_mm,
            touch_probability: touch_probability(clearance_mm, sigma_mm),
            needed_mm,
            weighted_margin_mm: weighted_mm(clearance_mm - needed_mm, structure.priority),
        })
    }
}

/// Φ(−c/σ); without an error 0 or 1.
pub fn touch_probability(clearance_mm: f64, sigma_mm: f64) -> f64 {
    if sigma_mm > 0.0 {
        Normal::standard().cdf(-clearance_mm / sigma_mm)
    } else {
        f64::from(u8::from(clearance_mm < 0.0))
    }
}

fn weighted_mm(margin_mm: f64, priority: u32) -> f64 {
    let weight = f64::from(priority).sqrt();
    if margin_mm < 0.0 { margin_mm / weight } else { margin_mm * weight }
}

/// The least weighted margin over all structures, mm; infinite where there is none.
pub fn least_margin_mm(kept: &[Option<KeptClearance>]) -> f64 {
    kept.iter().flatten().map(|kept| kept.weighted_margin_mm).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_geometry::{Ct, Grid, Point, Volume};
    use nalgebra::Unit;

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
        let structures = [KeptStructure { field: Some(&field), clearance_mm: 0.3, priority: 4 }];
        let model = RiskModel {
            structures: &structures,
            radius_mm: 1.0,
            standoff_mm: 2.0,
            error: RegistrationError::uniform(0.2),
            touch_probability: 0.01,
        };
        // the wall is at x = 9.75: 0.5 mm from the tool's surface
        let out = Unit::new_unchecked(Vector3::z());
        let axis = ChannelAxis { entry: Point::new(8.25, 0.0, 15.0), out, depth_mm: 10.0 };
        let kept = model.assess(&axis, 1e-4)[0].unwrap();
        assert!((kept.clearance_mm - 0.5).abs() < 2e-4, "{}", kept.clearance_mm);
        assert!((kept.toward - Vector3::x()).norm() < 1e-9);
        // Φ(−2.5) = 0.00621, Φ⁻¹(0.99) = 2.32635
        assert!((kept.touch_probability - 0.00621).abs() < 1e-5, "{}", kept.touch_probability);
        assert!((kept.weighted_margin_mm - 2.0 * (0.5 - 0.2 * 2.326_35)).abs() < 5e-4);
        // a shortfall counts more where the structure is more important, a margin less
        assert_eq!([weighted_mm(-0.4, 1), weighted_mm(-0.4, 4)], [-0.4, -0.2]);
        assert_eq!([weighted_mm(0.4, 1), weighted_mm(0.4, 4)], [0.4, 0.8]);
        assert_eq!([touch_probability(0.1, 0.0), touch_probability(-0.1, 0.0)], [0.0, 1.0]);
    }
}
