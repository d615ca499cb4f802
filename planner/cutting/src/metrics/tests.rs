//! Tests of `metrics`.

use bonemill_geometry::{Grid, Work};
use proptest::prelude::*;

use super::*;

fn unit(v: [f64; 3]) -> Unit<Vector3<f64>> {
    Unit::new_normalize(Vector3::from(v) + Vector3::new(1e-3, 0.0, 0.0))
}

/// A crescent of pieces, all inside the ball of radius 2.
fn moments(pieces: &[[f64; 4]]) -> Moments {
    let mut out = Moments::new(2.0);
    for &[m, x, y, z] in pieces {
        out.add(m, &Vector3::new(x, y, z));
    }
    out
}

fn pieces() -> impl Strategy<Value = Vec<[f64; 4]>> {
    prop::collection::vec((0.01f64..1.0, -1.1f64..1.1, -1.1f64..1.1, -1.1f64..1.1), 1..20)
        .prop_map(|v| v.into_iter().map(|(m, x, y, z)| [m, x, y, z]).collect())
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(256))]

    #[test]
    fn the_form_is_the_sum(pieces in pieces(), axis in prop::array::uniform3(-1.0f64..1.0)) {
        let axis = unit(axis);
        let mass: f64 = pieces.iter().map(|p| p[0]).sum();
        let inertia: f64 =
            pieces.iter().map(|&[m, x, y, z]| m * (4.0 - Vector3::new(x, y, z).dot(&axis).powi(2))).sum();
        let found = moments(&pieces).inertia_normalised(&axis);
        prop_assert!((found - inertia / (mass * 4.0)).abs() < 1e-13);
    }
}

#[test]
fn a_full_ball_of_fine_voxels_is_four_fifths_for_any_tilt() {
    let grid = Grid::<Work>::aligned([61, 61, 61], 0.05, Point::new(-1.5, -1.5, -1.5)).unwrap();
    let bone = Volume::filled(grid, 0.8f32);
    for axis in [[0.0, 0.0, 1.0], [0.3, -0.8, 0.1], [1.0, 1.0, 1.0]] {
        let m = engagement_metrics(&bone, Point::new(0.01, 0.02, -0.01), &unit(axis), 1.4);
        assert!((m.inertia_normalised - 0.8).abs() < 2e-3, "{m:?}");
        assert!((m.true_inertia_normalised - 0.4).abs() < 2e-3);
        let ball = 4.0 / 3.0 * std::f64::consts::PI * 1.4f64.powi(3);
        assert!((m.mass_mg - f64::from(0.8f32) * ball).abs() < 1e-12 * ball);
    }
}

#[test]
fn without_mass_every_axis_is_as_good() {
    let none = Moments::new(2.0);
    assert_eq!(none.inertia_normalised(&Vector3::z_axis()), 1.0);
    let grid = Grid::<Work>::aligned([9, 9, 9], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
    let m =
        engagement_metrics(&Volume::filled(grid, 0.0), Point::new(2.0, 2.0, 2.0), &Vector3::z_axis(), 1.0);
    assert_eq!(
        (m.mass_mg, m.inertia_normalised, m.true_inertia_normalised, m.z2_mean_mm2),
        (0.0, 1.0, 1.0, 0.0)
    );
}
