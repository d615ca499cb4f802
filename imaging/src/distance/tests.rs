//! Brute force, invariants, degenerate grids.

use bonemill_geometry::{Ct, Point};
use nalgebra::{Matrix3, Vector3};
use proptest::prelude::*;

use super::*;

fn mask(dims: [usize; 3], spacing: [f64; 3], is: impl FnMut(usize) -> bool) -> Volume<bool, Ct> {
    let grid = Grid::new(dims, Vector3::from(spacing), Matrix3::identity(), Vector3::zeros()).unwrap();
    let data = (0..grid.len()).map(is).collect();
    Volume::new(grid, data).unwrap()
}

/// Smallest distance over all true voxels, mm, and the first voxel that gives it (whole numbers on cubes: exact ties).
fn brute_force(mask: &Volume<bool, Ct>, at: usize) -> (f64, usize) {
    let (here, scale, unit_mm) = (mask.grid().voxel(at), scale(mask), unit_mm(mask));
    let mut best = (f64::INFINITY, 0);
    for (n, _) in mask.data().iter().enumerate().filter(|(_, v)| **v) {
        let there = mask.grid().voxel(n);
        let squared: f64 = (0..3).map(|a| (here[a].abs_diff(there[a]) as f64 * scale[a]).powi(2)).sum();
        if squared < best.0 {
            best = (squared, n);
        }
    }
    (best.0.sqrt() * unit_mm, best.1)
}

fn is_cubic(mask: &Volume<bool, Ct>) -> bool {
    let spacing = mask.grid().spacing_mm();
    spacing.min() == spacing.max()
}

fn scale(mask: &Volume<bool, Ct>) -> Vector3<f64> {
    if is_cubic(mask) { Vector3::repeat(1.0) } else { mask.grid().spacing_mm() }
}

fn unit_mm(mask: &Volume<bool, Ct>) -> f64 {
    if is_cubic(mask) { mask.grid().spacing_mm().x } else { 1.0 }
}

/// A reproducible scatter of true voxels, about one in `one_in`.
fn scatter(seed: u64, one_in: u64) -> impl FnMut(usize) -> bool {
    move |n| {
        let mut h = (n as u64 ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h = (h ^ (h >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        (h ^ (h >> 32)).is_multiple_of(one_in)
    }
}

fn check(mask: &Volume<bool, Ct>) {
    let field = distance_transform(mask).unwrap();
    assert_eq!(field.is_some(), mask.data().contains(&true));
    let Some(field) = field else { return };
    assert_eq!(field.distance_mm.data(), distance_only(mask).unwrap().unwrap().data());
    for n in 0..mask.grid().len() {
        let (expected, first) = brute_force(mask, n);
        let found = f64::from(field.distance_mm.data()[n]);
        assert!(
            (found - expected).abs() <= 1e-4f64.min(1e-6 * (1.0 + expected)),
            "{n}: {found} not {expected}"
        );
        let nearest = field.nearest[n] as usize;
        assert!(mask.data()[nearest]);
        let to_nearest = mask
            .grid()
            .center(mask.grid().voxel(n))
            .distance_mm(&mask.grid().center(mask.grid().voxel(nearest)));
        assert!((to_nearest - expected).abs() < 1e-6 * (1.0 + expected));
        if is_cubic(mask) {
            assert_eq!(nearest, first, "ties go to the smallest index");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]
    #[test]
    fn brute_force_agrees(
        dims in prop::array::uniform3(1usize..13), spacing in prop::array::uniform3(0.1f64..3.0),
        cubic: bool, seed: u64, density in 0usize..6,
    ) {
        let spacing = if cubic { [spacing[0]; 3] } else { spacing };
        check(&mask(dims, spacing, scatter(seed, [1, 2, 7, 60, 700, 5000][density])));
    }

    #[test]
    fn distance_is_lipschitz_along_every_axis(
        dims in prop::array::uniform3(2usize..28), spacing in prop::array::uniform3(0.1f64..3.0), seed: u64,
    ) {
        let mask = mask(dims, spacing, scatter(seed, 400));
        let Some(field) = distance_transform(&mask).unwrap() else { return Ok(()) };
        let d = field.distance_mm;
        for n in 0..d.grid().len() {
            for a in 0..3 {
                let mut next = d.grid().voxel(n);
                next[a] += 1;
                if next[a] < dims[a] {
                    let step = (d.data()[n] - d.get(next)).abs();
                    prop_assert!(f64::from(step) <= spacing[a] + 1e-4);
                }
            }
        }
    }

    #[test]
    fn the_bounded_field_is_the_field_cut_off(
        dims in prop::array::uniform3(1usize..24), spacing in prop::array::uniform3(0.1f64..3.0),
        seed: u64, density in 0usize..4, max_mm in 0.05f64..40.0,
    ) {
        let mask = mask(dims, spacing, scatter(seed, [2, 60, 700, 5000][density]));
        let field = distance_transform(&mask).unwrap();
        let bounded = distance_within(&mask, max_mm).unwrap();
        prop_assert_eq!(field.is_some(), bounded.is_some());
        if let (Some(field), Some(bounded)) = (field, bounded) {
            for (d, b) in field.distance_mm.data().iter().zip(bounded.data()) {
                prop_assert_eq!(d.min(max_mm as f32), *b);
            }
        }
    }
}

#[test]
fn degenerate_masks() {
    for dims in [[1, 1, 1], [1, 17, 1], [33, 1, 1], [1, 1, 40], [16, 16, 1], [17, 1, 16], [1, 31, 15]] {
        let spacing = [0.3, 1.1, 0.7];
        check(&mask(dims, spacing, |_| false));
        check(&mask(dims, spacing, |_| true));
        let len: usize = dims.iter().product();
        for only in [0, len / 2, len - 1] {
            check(&mask(dims, spacing, |n| n == only));
        }
    }
}

#[test]
fn planes_and_tubes_of_any_slant_agree() {
    // best sites move fast along a line and differ between neighbouring lines
    for slope in [0.0, 0.4, 1.0, 2.7] {
        let grid = Grid::<Ct>::aligned([36, 25, 23], 1.0, Point::new(0.0, 0.0, 0.0)).unwrap();
        check(&mask(grid.dims(), [0.5, 0.5, 0.5], |n| {
            let [i, j, k] = grid.voxel(n).map(|c| c as f64);
            (i - slope * j + 0.5 * slope * k - 7.0).abs() < 0.6 && (j - k).abs() < 9.0
        }));
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    let mask = mask([50, 33, 21], [0.4, 0.5, 0.9], scatter(5, 300));
    let run = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| distance_transform(&mask).unwrap().unwrap())
    };
    let (one, three) = (run(1), run(3));
    assert_eq!(one.distance_mm.data(), three.distance_mm.data());
    assert_eq!(one.nearest, three.nearest);
}

#[test]
fn a_bound_must_be_a_distance() {
    let mask = mask([3, 3, 3], [1.0; 3], |n| n == 0);
    for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(distance_within(&mask, bad), Err(ImageError::MaxDistance { .. })));
    }
}
