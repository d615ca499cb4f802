//! Clearances of swept solids against every point of a structure asked one by one.

use bonemill_cutting::cutter::{Cutter, TwistDrill, TwistDrillSpec};
use bonemill_geometry::{Grid, Volume};

use super::*;

/// A map with these voxels of 0.5 mm; voxel (0, 0, 0) has its centre at (−5, −5, −5).
fn field(holds: impl Fn(Point<Ct>) -> bool) -> StructureField {
    let grid = Grid::<Ct>::aligned([21, 21, 41], 0.5, Point::new(-5.0, -5.0, -5.0)).unwrap();
    let labels = (0..grid.len()).map(|n| u16::from(holds(grid.center(grid.voxel(n))))).collect();
    StructureField::new(&Volume::new(grid, labels).unwrap(), 1, None).unwrap().unwrap()
}

fn drill(point_deg: f64) -> SolidOfRevolution {
    let spec = TwistDrillSpec { radius_mm: 0.9, point_deg, flute_mm: 4.0, ..TwistDrillSpec::FAIEGHI };
    TwistDrill::new(spec).unwrap().solid().clone()
}

/// The least signed distance of the points of a structure's boxes, 0.05 mm apart, by the tool's own solid at places 0.2 mm apart.
fn brute_mm(field: &StructureField, tool: &SolidOfRevolution, pose: &SweptPose) -> f64 {
    let mut least = f64::INFINITY;
    for voxel in field.voxels() {
        let center = Vector3::from(voxel.map(|n| 0.5 * n as f64 - 5.0));
        if (center - pose.end.coords).cross(&pose.out).norm() > 3.0 {
            continue;
        }
        for n in 0..11 * 11 * 11 {
            let at = [n % 11, n / 11 % 11, n / 121].map(|n| 0.05 * f64::from(n) - 0.25);
            if !at.iter().any(|v: &f64| v.abs() > 0.249) {
                continue;
            }
            let from = center + Vector3::from(at) - pose.end.coords;
            let height = from.dot(&pose.out);
            let radius = (from - pose.out.as_ref() * height).norm();
            let gap = |step: i32| tool.signed_distance_at_mm(radius, height - 0.2 * f64::from(step));
            least = (0..=(pose.way_mm / 0.2) as i32).map(gap).fold(least, f64::min);
        }
    }
    least
}

#[test]
fn the_clearance_is_that_of_the_drills_true_solid() {
    let tool = drill(59.0);
    let swept = SweptTool::new(&tool).unwrap();
    let mut fronts = 0;
    for seed in 0..16u32 {
        let part = |n: u32| f64::from((seed * 97 + n * 53) % 101) / 101.0 - 0.5;
        let lump = Point::new(3.0 * part(1), 3.0 * part(2), 4.0 * part(3) - 1.0);
        let field = field(|p| p.distance_mm(&lump) < 0.7);
        let out = Unit::new_normalize(Vector3::new(part(4), part(5), 1.0));
        let pose = SweptPose { end: Point::new(2.0 * part(6), 2.0 * part(7), 1.0), out, way_mm: 4.0 };
        let brute = brute_mm(&field, &tool, &pose);
        let found = swept.clearance(&field, &pose, 1e-3);
        assert!(found.at_least_mm <= found.at_most_mm);
        if brute > 0.04 {
            // the brute search sees a point at most 0.035 mm beside the nearest
            let (low, high) = (found.at_least_mm, found.at_most_mm);
            assert!(
                low <= brute && high >= brute - 0.035 && high - low < 1.1e-3,
                "{seed}: {low} {high}, {brute}"
            );
            assert!((found.toward.norm() - 1.0).abs() < 1e-9);
            // a capsule would reach the tool's radius ahead of the tip
            let capsule = field.distance(pose.end) - 0.9;
            fronts += usize::from(capsule < low - 0.1);
        } else {
            assert!(found.at_least_mm < 0.04, "{seed}: {found:?}, {brute}");
        }
    }
    assert!(fronts > 3, "{fronts}");
}

/// A wall below the tip, square to the axis: the point touches it first, and a flat drill with its whole front.
#[test]
fn a_wall_ahead_is_as_far_as_the_tip() {
    let field = field(|p| p.z() < -1.1);
    for point_deg in [30.0, 59.0, 90.0] {
        let swept = SweptTool::new(&drill(point_deg)).unwrap();
        let pose = SweptPose {
            end: Point::new(0.1, 0.2, -0.5),
            out: Unit::new_unchecked(Vector3::z()),
            way_mm: 6.0,
        };
        let found = swept.clearance(&field, &pose, 1e-3);
        // the last voxel's face is at z = −1.25
        assert!((found.at_most_mm - 0.75).abs() < 1e-9, "{point_deg}°: {found:?}");
        assert!(found.at_least_mm > 0.75 - 0.05, "{point_deg}°: {found:?}");
        assert!((found.toward + Vector3::z()).norm() < 1e-6 && (found.height_mm + 0.75).abs() < 1e-9);
        // behind the tool's upper end nothing is met; beside it, as far as the cylinder
        let aside =
            SweptPose { out: Unit::new_unchecked(Vector3::x()), end: Point::new(-4.0, 0.0, 1.0), ..pose };
        let found = swept.clearance(&field, &aside, 1e-3);
        assert!((found.at_most_mm - (2.25 - 0.9)).abs() < 1e-3, "{point_deg}°: {found:?}");
    }
}

#[test]
fn a_speck_inside_the_front_is_met() {
    // a voxel wholly inside a wide flat front, beside every ball on the axis
    let field = field(|p| p.distance_mm(&Point::new(2.5, 0.0, 0.0)) < 0.2);
    let swept = SweptTool::new(&SolidOfRevolution::new(&[[0.0, 4.0], [3.0, 4.0]]).unwrap()).unwrap();
    let pose =
        SweptPose { end: Point::new(0.0, 0.0, -0.6), out: Unit::new_unchecked(Vector3::z()), way_mm: 6.0 };
    assert!(swept.clearance(&field, &pose, 1e-2).at_least_mm < 0.0);
}
