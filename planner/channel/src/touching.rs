//! The probability with which an error of the registration lets a tool touch a structure, on all sides.
//!
//! The error is made of k independent standard normal numbers (3 for a translation, 6 with a rotation). Along a direction u of their
//! space the tool first touches at a distance ρ(u), and the numbers lie beyond with the probability that χ²_k exceeds ρ². So
//!
//! ```text
//! P = mean over u of  P(χ²_k > ρ(u)²)
//! ```
//!
//! which is Φ(−c/σ) for a flat wall on one side and exp(−c²/2σ²) for a tube around a channel. Beyond its first touch a
//! direction counts as touching, also where a thin structure would have been passed: that needs an error of more than the tool's diameter.
//!
//! **Source:** directional simulation, Bjerager 1988; the directions are a fixed low-discrepancy sequence.

use bonemill_geometry::basis::{self, on_sphere};
use bonemill_geometry::cancel;
use bonemill_imaging::StructureField;
use nalgebra::Unit;
use rayon::prelude::*;
use statrs::distribution::{ChiSquared, ContinuousCDF, Normal};

use crate::registration_error::{RegistrationError, SmallMotion};
use crate::swept::{SweptPose, SweptTool};

/// Directions of the mean for a translation; with a rotation more.
const DIRECTIONS: u32 = 400;
const DIRECTIONS_6D: u32 = 2000;
/// A structure that is touched less often than this, whatever its shape, is not searched.
const RARE: f64 = 1e-10;
/// Directions are followed to where χ² is larger than at the nearest touch by this: what lies beyond is e⁻¹¹ as likely.
const BEYOND: f64 = 22.0;
/// Steps along a direction at most.
const MOST_STEPS: u32 = 40;
/// A touch is found to this share of the error along its direction.
const EXACT: f64 = 5e-3;
/// Clearances on the way are searched to these shares of themselves and of the error: the point of the structure that has the
/// clearance is found much closer than that.
const SEARCHED: [f64; 2] = [0.1, 0.04];

/// The probability of touching a structure that the tool keeps clear of by `clearance_mm`; `None` where it is cut without an
/// error, where there is no error, and where it is certainly touched less often than 1e-10.
pub fn touch_probability(
    tool: &SweptTool,
    field: &StructureField,
    pose: &SweptPose,
    error: &RegistrationError,
    clearance_mm: f64,
) -> Option<f64> {
    let numbers = error.numbers();
    let chi2 = ChiSquared::new(numbers as f64).ok()?;
    let directions = directions(numbers);
    let motions = directions.into_par_iter().map(|u| error.of_numbers(&u));
    let moves: Vec<Move> = motions.map(|motion| Move::new(tool, pose, motion)).collect();
    let fastest = moves.iter().map(|m| m.speed_mm).fold(0.0, f64::max);
    let nearest2 = (clearance_mm / fastest).powi(2);
    if !(clearance_mm > 0.0 && fastest > 0.0 && chi2.sf(nearest2) > RARE) {
        return None;
    }
    let farthest = (nearest2 + BEYOND).sqrt();
    let touched = |m: &Move| {
        cancel::poll();
        let touch = m.first_touch((tool, field), pose, clearance_mm, farthest);
        touch.map_or(0.0, |touch| chi2.sf(touch * touch))
    };
    // summed in order: the same on any number of threads
    let shares: Vec<f64> = moves.par_iter().map(touched).collect();
    Some(shares.iter().sum::<f64>() / shares.len() as f64).filter(|share| *share > 0.0)
}

/// Errors in one direction, by their size.
struct Move {
    motion: SmallMotion,
    /// No point of the tool moves faster, mm.
    speed_mm: f64,
}

impl Move {
    fn new(tool: &SweptTool, pose: &SweptPose, motion: SmallMotion) -> Self {
        // the speed of a point is convex: along the axis it is largest at an end
        let at_ends = tool.heights_mm(pose).map(|z| motion.of_point(pose.end + pose.out.as_ref() * z).norm());
        let turned = |v: &nalgebra::Vector3<f64>| motion.of_direction(v).norm();
        let across = basis::from_z(&pose.out);
        let [x, y] = [0, 1].map(|n| turned(&across.matrix().column(n).into_owned()));
        Self { motion, speed_mm: at_ends[0].max(at_ends[1]) + x.hypot(y) * tool.radius_mm() }
    }

    /// The size of the error at which the tool first touches, up to `farthest`.
    fn first_touch(
        &self,
        (tool, field): (&SweptTool, &StructureField),
        pose: &SweptPose,
        clearance_mm: f64,
        farthest: f64,
    ) -> Option<f64> {
        let exact_mm = EXACT * self.speed_mm;
        let gap_mm = |size: f64, within_mm: f64| {
            let moved = SweptPose {
                end: pose.end + self.motion.of_point(pose.end) * size,
                out: Unit::new_normalize(pose.out.as_ref() + self.motion.of_direction(&pose.out) * size),
                way_mm: pose.way_mm,
            };
            tool.clearance(field, &moved, within_mm).at_most_mm
        };
        let (mut size, mut gap) = (0.0, clearance_mm);
        for _ in 0..MOST_STEPS {
            if gap <= exact_mm {
                break;
            }
            size += gap / self.speed_mm;
            if size > farthest {
                return None;
            }
            gap = gap_mm(size, (SEARCHED[0] * gap).max(SEARCHED[1] * self.speed_mm));
        }
        Some(size)
    }
}

/// Directions in a space of 3 or more dimensions, evenly spread.
fn directions(dimensions: usize) -> Vec<Vec<f64>> {
    if dimensions == 3 {
        let count = DIRECTIONS as usize;
        return (0..count).map(|n| on_sphere(n, count).iter().copied().collect()).collect();
    }
    // the root of x^(n+1) = x + 1 gives the most even spread in n dimensions
    let ratio = (0..32).fold(1.5f64, |x, _| (1.0 + x).powf(1.0 / (dimensions as f64 + 1.0)));
    let normal = Normal::standard();
    let one = |k: u32| {
        let share = |j: usize| (0.5 + f64::from(k) * ratio.powi(-(j as i32 + 1))).fract();
        let numbers = (0..dimensions).map(|j| normal.inverse_cdf(share(j).clamp(1e-9, 1.0 - 1e-9)));
        let numbers: Vec<f64> = numbers.collect();
        let length = numbers.iter().map(|v| v * v).sum::<f64>().sqrt();
        numbers.into_iter().map(|v| v / length).collect()
    };
    (1..=DIRECTIONS_6D).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use bonemill_cutting::cutter::SolidOfRevolution;
    use bonemill_geometry::{Ct, Grid, Point, Volume};
    use nalgebra::Vector3;

    /// A plate from z = −1 to 1 with a round hole about the z axis, or a wall on one side, of voxels of 0.1 mm.
    fn plate(holds: impl Fn(Point<Ct>) -> bool) -> StructureField {
        let grid = Grid::<Ct>::aligned([61, 61, 21], 0.1, Point::new(-3.0, -3.0, -1.0)).unwrap();
        let labels = (0..grid.len()).map(|n| u16::from(holds(grid.center(grid.voxel(n))))).collect();
        StructureField::new(&Volume::new(grid, labels).unwrap(), 1, None).unwrap().unwrap()
    }

    fn probability(field: &StructureField, sigma_mm: f64) -> (f64, f64) {
        let tool = SolidOfRevolution::new(&[[0.0, 0.0], [0.9, 0.9], [8.0, 0.9]]).unwrap();
        let tool = SweptTool::new(&tool).unwrap();
        let out = Unit::new_unchecked(Vector3::z());
        let pose = SweptPose { end: Point::new(0.0, 0.0, -6.0), out, way_mm: 12.0 };
        let clearance_mm = tool.clearance(field, &pose, 1e-4).at_least_mm;
        let error = RegistrationError::uniform(sigma_mm);
        (clearance_mm, touch_probability(&tool, field, &pose, &error, clearance_mm).unwrap())
    }

    #[test]
    fn a_ring_is_touched_on_all_sides_and_a_wall_on_one() {
        let ring = plate(|p| p.x().hypot(p.y()) > 1.75);
        let wall = plate(|p| p.x() > 1.75);
        let walls = plate(|p| p.x().abs() > 1.75);
        for sigma_mm in [0.25, 0.35] {
            let (clearance_mm, found) = probability(&wall, sigma_mm);
            assert!((clearance_mm - 0.85).abs() < 1e-3, "{clearance_mm}");
            let phi = Normal::standard().cdf(-0.85 / sigma_mm);
            assert!((found / phi - 1.0).abs() < 0.05, "wall, {sigma_mm}: {found}, {phi}");
            let (_, found) = probability(&walls, sigma_mm);
            assert!((found / (2.0 * phi) - 1.0).abs() < 0.05, "walls, {sigma_mm}: {found}");
            // of voxels, the hole's radius is 1.75 on average, less at corners
            let (_, found) = probability(&ring, sigma_mm);
            let tube = |c: f64| (-0.5 * (c / sigma_mm).powi(2)).exp();
            assert!(found > tube(0.87) && found < tube(0.77), "ring, {sigma_mm}: {found}, {}", tube(0.82));
            assert!(found > 4.0 * phi);
        }
    }

    #[test]
    fn a_rotation_about_a_far_point_touches_as_often_as_its_shift_there() {
        // fiducials about a point 40 mm away along y: a rotation moves the tool along x by 40 mm per radian
        let wall = plate(|p| p.x() > 1.75);
        let tool = SolidOfRevolution::new(&[[0.0, 0.9], [8.0, 0.9]]).unwrap();
        let tool = SweptTool::new(&tool).unwrap();
        let out = Unit::new_unchecked(Vector3::z());
        let pose = SweptPose { end: Point::new(0.0, 0.0, -1.0), out, way_mm: 2.0 };
        let error = RegistrationError::of_rotation(0.1, Point::new(0.0, 40.0, 0.0), 6e-3);
        let sigma_mm = error.sigma_mm(Point::new(1.75, 0.0, 0.0), &Vector3::x());
        let found = touch_probability(&tool, &wall, &pose, &error, 0.85).unwrap();
        let phi = Normal::standard().cdf(-0.85 / sigma_mm);
        // the tool also turns about y: its ends move more than its middle
        assert!(found > 0.9 * phi && found < 2.0 * phi, "{found}, {phi}");
    }
}
