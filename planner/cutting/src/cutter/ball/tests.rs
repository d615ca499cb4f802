//! Tests of `ball`.

use bonemill_geometry::Work;
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

use super::*;

fn all<F: Frame>(grid: &Grid<F>) -> [[usize; 3]; 2] {
    [[0; 3], grid.dims()]
}

fn volumes(grid: &Grid<Work>, center: Point<Work>, radius_mm: f64) -> Vec<f64> {
    let mut out = vec![0.0; grid.len()];
    BallVolumes::new().for_each(grid, center, radius_mm, all(grid), |row| row, |n, v| out[n] += v);
    out
}

fn box_of(grid: &Grid<Work>, center: Point<Work>, n: usize) -> [[f64; 3]; 2] {
    let c = Vector3::from(grid.continuous_index(center));
    let v = Vector3::from(grid.voxel(n).map(|i| i as f64));
    let h = grid.spacing_mm();
    let at = |side: f64| (v - c + Vector3::repeat(side)).component_mul(&h).into();
    [at(-0.5), at(0.5)]
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(2000))]

    #[test]
    fn atan2_of_the_first_quadrant(y in 0f64..2.0, x in 0f64..2.0, ey in -30..1, ex in -30..1) {
        let (y, x) = (y * 2f64.powi(ey), x * 2f64.powi(ex));
        let expected = y.atan2(x);
        prop_assert!((atan2_first(y, x) - expected).abs() <= 4.5e-16 * expected.max(1e-300));
    }

    /// Cut a box anywhere: the parts make the whole.
    #[test]
    fn volume_is_additive(
        lo in prop::array::uniform3(-1.3f64..1.0), size in prop::array::uniform3(0.01f64..1.5),
        at in 0.0f64..1.0, axis in 0usize..3, radius in 0.5f64..2.0,
    ) {
        let hi: [f64; 3] = std::array::from_fn(|a| lo[a] + size[a]);
        let cut = lo[axis] + at * size[axis];
        let (mut first, mut second) = (hi, lo);
        (first[axis], second[axis]) = (cut, cut);
        let parts = ball_box_volume(radius, lo, first) + ball_box_volume(radius, second, hi);
        prop_assert!((parts - ball_box_volume(radius, lo, hi)).abs() < 4e-15 * radius.powi(3));
    }

    #[test]
    fn volume_is_never_outside_its_bounds_and_mirrors(
        lo in prop::array::uniform3(-1.3f64..1.0), size in prop::array::uniform3(0.01f64..1.0),
    ) {
        let hi: [f64; 3] = std::array::from_fn(|a| lo[a] + size[a]);
        let v = ball_box_volume(1.0, lo, hi);
        let whole: f64 = (0..3).map(|a| hi[a] - lo[a]).product();
        prop_assert!(v >= 0.0 && v <= whole * (1.0 + 1e-15));
        let mirrored = ball_box_volume(1.0, [-hi[0], lo[1], -hi[2]], [-lo[0], hi[1], -lo[2]]);
        prop_assert!((v - mirrored).abs() < 1e-15);
        let turned = ball_box_volume(1.0, [lo[1], lo[2], lo[0]], [hi[1], hi[2], hi[0]]);
        prop_assert!((v - turned).abs() < 4e-15);
    }
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(60))]

    #[test]
    fn a_lattice_holds_the_whole_ball_and_each_voxel_its_box(
        center in prop::array::uniform3(-0.7f64..0.7), radius in 0.4f64..1.5,
        spacing in prop::array::uniform3(0.13f64..0.6), turn in prop::array::uniform3(-1.0f64..1.0),
    ) {
        let h = Vector3::from(spacing);
        let dims = spacing.map(|s| (5.2 / s) as usize + 2);
        let mut axes: Matrix3<f64> = nalgebra::Rotation3::new(Vector3::from(turn)).into_inner();
        axes.set_column(1, &-axes.column(1));
        let middle = Vector3::from(dims.map(|d| (d - 1) as f64 * 0.5)).component_mul(&h);
        let grid = Grid::<Work>::new(dims, h, axes, -(axes * middle)).unwrap();
        let center = Point::from_coords(Vector3::from(center));
        let found = volumes(&grid, center, radius);
        let ball = 4.0 / 3.0 * PI * radius.powi(3);
        prop_assert!((found.iter().sum::<f64>() - ball).abs() < 1e-12 * ball);
        for (n, v) in found.iter().enumerate() {
            let [lo, hi] = box_of(&grid, center, n);
            prop_assert!((v - ball_box_volume(radius, lo, hi)).abs() < 4e-15 * radius.powi(3));
        }
    }
}

/// Midpoint sums over a fine grid of points: an estimate that shares nothing with the formula.
#[test]
fn volume_agrees_with_counting_points() {
    let n = 160;
    for (lo, hi) in [([0.3, -0.2, 0.1], [0.9, 0.5, 0.9]), ([-0.8, -0.75, -0.4], [-0.2, 0.1, 0.3])] {
        let size: [f64; 3] = std::array::from_fn(|a| hi[a] - lo[a]);
        let at = |a: usize, i: usize| lo[a] + (i as f64 + 0.5) / n as f64 * size[a];
        // exact along z, counted over x and y
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let half = (1.0 - at(0, i).powi(2) - at(1, j).powi(2)).max(0.0).sqrt();
                sum += (half.min(hi[2]) - (-half).max(lo[2])).max(0.0);
            }
        }
        let counted = sum * size[0] * size[1] / (n * n) as f64;
        assert!((ball_box_volume(1.0, lo, hi) - counted).abs() < 2e-5);
    }
}

#[test]
fn a_centre_on_a_voxel_plane_or_centre_is_no_special_case() {
    for offset in [0.0, 0.5] {
        let origin = Point::new(-5.0 - offset, -5.0, -5.0 + offset);
        let grid = Grid::<Work>::aligned([11, 11, 11], 1.0, origin).unwrap();
        let found: f64 = volumes(&grid, Point::new(0.0, 0.0, 0.0), 3.0).iter().sum();
        assert!((found - 36.0 * PI).abs() < 1e-12 * 36.0 * PI);
    }
}

#[test]
fn only_the_wanted_voxels_of_the_block_are_visited_in_order() {
    let grid = Grid::<Work>::aligned([12, 12, 12], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
    let center = Point::new(2.6, 2.9, 3.1);
    let every = volumes(&grid, center, 1.7);
    let (lo, hi) = ([3, 0, 5], [8, 7, 40]);
    let mut seen = Vec::new();
    BallVolumes::new().for_each(
        &grid,
        center,
        1.7,
        [lo, hi],
        |row| row.filter(|n| n % 3 != 0),
        |n, v| seen.push((n, v)),
    );
    let inside = |n: usize| (0..3).all(|a| (lo[a]..=hi[a]).contains(&grid.voxel(n)[a]));
    let expected: Vec<_> =
        every.iter().copied().enumerate().filter(|&(n, v)| v > 0.0 && n % 3 != 0 && inside(n)).collect();
    assert!(!expected.is_empty());
    assert_eq!(seen, expected);
}

#[test]
fn a_ball_beyond_the_grid_or_without_size_visits_nothing() {
    let grid = Grid::<Work>::aligned([4, 4, 4], 0.5, Point::new(0.0, 0.0, 0.0)).unwrap();
    let nan = f64::NAN;
    for (x, r) in
        [(-9.0, 1.0), (9.0, 1.0), (1.0, 0.0), (1.0, -1.0), (1.0, nan), (nan, 1.0), (1.0, f64::INFINITY)]
    {
        assert_eq!(volumes(&grid, Point::new(x, 1.0, 1.0), r).iter().sum::<f64>(), 0.0);
    }
    assert_eq!(ball_box_volume(1.0, [0.0; 3], [0.0, 1.0, 1.0]), 0.0);
    assert_eq!(ball_box_volume(1.0, [0.0; 3], [nan, 1.0, 1.0]), 0.0);
}
