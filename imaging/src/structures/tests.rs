//! Brute force over every voxel box, on straight, oblique and mirrored grids.

use super::*;
use nalgebra::{Matrix3, Rotation3};
use proptest::prelude::*;

fn grid(dims: [usize; 3], spacing: [f64; 3], turn: [f64; 3], mirror: bool) -> Grid<Ct> {
    let mut axes = Rotation3::new(Vector3::from(turn)).into_inner();
    if mirror {
        axes.set_column(0, &-axes.column(0));
    }
    Grid::new(dims, Vector3::from(spacing), axes, Vector3::new(4.0, -11.0, 30.0)).unwrap()
}

/// Labels 1 and 2 in many pieces that touch, 0 between.
fn scatter(grid: Grid<Ct>, seed: u64, one_in: u64) -> Volume<u16, Ct> {
    let data = (0..grid.len() as u64)
        .map(|n| {
            let mut h = (n ^ seed).wrapping_mul(0x9e37_79b9_7f4a_7c15);
            h = (h ^ (h >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            h ^= h >> 33;
            if h.is_multiple_of(one_in) { 1 } else { 2 * u16::from(h.is_multiple_of(3)) }
        })
        .collect();
    Volume::new(grid, data).unwrap()
}

/// Distance to the nearest closed voxel box, found by testing every box.
fn brute_force(labels: &Volume<u16, Ct>, label: u16, p: Point<Ct>) -> f64 {
    let grid = labels.grid();
    let index = grid.continuous_index(p);
    (0..grid.len())
        .filter(|n| labels.data()[*n] == label)
        .map(|n| {
            let voxel = grid.voxel(n);
            (0..3)
                .map(|a| ((index[a] - voxel[a] as f64).abs() - 0.5).max(0.0) * grid.spacing_mm()[a])
                .map(|d| d * d)
                .sum::<f64>()
                .sqrt()
        })
        .fold(f64::INFINITY, f64::min)
}

fn point_near(grid: &Grid<Ct>, share: [f64; 3]) -> Point<Ct> {
    // points from half the grid's size before the grid to half its size behind it
    grid.at(std::array::from_fn(|a| (share[a] * 2.0 - 0.5) * grid.dims()[a] as f64))
}

proptest! {
    #[test]
    fn distance_nearest_and_bounds_agree_with_brute_force(
        dims in prop::array::uniform3(1usize..11), spacing in prop::array::uniform3(0.15f64..2.0),
        turn in prop::array::uniform3(-3.0f64..3.0), straight: bool, mirror: bool,
        seed: u64, density in 0usize..3,
        points in prop::collection::vec(prop::array::uniform3(0.0f64..1.0), 20),
    ) {
        let grid = grid(dims, spacing, if straight { [0.0; 3] } else { turn }, mirror);
        let labels = scatter(grid, seed, [2, 12, 200][density]);
        let field = match StructureField::new(&labels, 1, None) {
            Err(ImageError::LabelAbsent { .. }) => {
                prop_assert!(!labels.data().contains(&1));
                return Ok(());
            }
            field => field.unwrap().unwrap(),
        };
        prop_assert_eq!(field.count(), labels.data().iter().filter(|v| **v == 1).count());
        let voxels: Vec<_> = field.voxels().map(|v| labels.grid().index(v)).collect();
        prop_assert!(voxels.is_sorted());
        prop_assert!(voxels.iter().all(|n| labels.data()[*n] == 1) && voxels.len() == field.count());
        for share in points {
            let p = point_near(labels.grid(), share);
            let expected = brute_force(&labels, 1, p);
            prop_assert!((field.distance(p) - expected).abs() < 1e-9);
            let (distance, nearest) = field.nearest(p);
            prop_assert!((distance - expected).abs() < 1e-9);
            prop_assert!((nearest.distance_mm(&p) - expected).abs() < 1e-9);
            prop_assert!(brute_force(&labels, 1, nearest) < 1e-9, "the nearest point lies in the structure");
            let (lower, upper) = field.bounds(p);
            prop_assert!(lower <= expected && expected <= upper);
            for threshold in [0.0, 0.5 * expected, expected * 1.01 + 1e-6, expected + 5.0] {
                prop_assert_eq!(field.is_nearer_than(p, threshold), expected < threshold);
            }
        }
    }

    #[test]
    fn a_region_keeps_what_a_point_in_it_can_reach(
        turn in prop::array::uniform3(-3.0f64..3.0), mirror: bool, seed: u64,
        a in prop::array::uniform3(0.0f64..1.0), b in prop::array::uniform3(0.0f64..1.0), reach_mm in 0.0f64..4.0,
    ) {
        let grid = grid([12, 11, 9], [0.4, 0.7, 1.1], turn, mirror);
        let labels = scatter(grid, seed, 90);
        let (p, q) = (point_near(labels.grid(), a).coords, point_near(labels.grid(), b).coords);
        let region = Region { min: Point::from_coords(p.inf(&q)), max: Point::from_coords(p.sup(&q)), reach_mm };
        if !labels.data().contains(&1) {
            return Ok(());
        }
        let field = StructureField::new(&labels, 1, Some(&region)).unwrap();
        for p in [p, q, (p + q) * 0.5, p * 0.3 + q * 0.7].map(Point::from_coords) {
            let expected = brute_force(&labels, 1, p);
            match &field {
                None => prop_assert!(expected > reach_mm - 1e-9),
                Some(field) => {
                    let found = field.distance(p);
                    prop_assert!(found >= expected - 1e-9);
                    prop_assert!((found - expected).abs() < 1e-9 || expected > reach_mm);
                    let (lower, upper) = field.bounds(p);
                    prop_assert!(lower <= found && found <= upper);
                }
            }
        }
    }
}

#[test]
fn a_box_is_closed_and_its_inside_is_zero() {
    let grid = grid([3, 3, 3], [1.0, 2.0, 0.5], [0.0; 3], false);
    let mut labels = Volume::filled(grid, 0u16);
    labels.data_mut()[13] = 7;
    let field = StructureField::new(&labels, 7, None).unwrap().unwrap();
    let at = |i, j, k| labels.grid().at([i, j, k]);
    assert_eq!(field.distance(at(1.0, 1.0, 1.0)), 0.0);
    assert!(field.distance(at(1.5, 1.0, 1.0)) < 1e-12);
    let (distance, nearest) = field.nearest(at(2.5, 1.0, 1.0));
    assert!((distance - 1.0).abs() < 1e-12 && nearest.distance_mm(&at(1.5, 1.0, 1.0)) < 1e-12);
    let [min, max] = field.bounding_box();
    assert!(min.distance_mm(&at(0.5, 0.5, 0.5)) < 1e-12 && max.distance_mm(&at(1.5, 1.5, 1.5)) < 1e-12);
    assert_eq!(field.distance(Point::new(f64::NAN, 0.0, 0.0)), 0.0);
    assert_eq!((field.label(), field.count()), (7, 1));
}

#[test]
fn labels_that_are_absent_and_regions_that_are_no_boxes_are_refused() {
    let labels = scatter(grid([6, 5, 4], [0.3; 3], [0.1, 0.2, 0.3], true), 3, 4);
    match StructureField::new(&labels, 9, None) {
        Err(ImageError::LabelAbsent { label, present }) => assert_eq!((label, present), (9, vec![1, 2])),
        other => panic!("{other:?}"),
    }
    let far = Point::new(500.0, 500.0, 500.0);
    let region = |min, max, reach_mm| Region { min, max, reach_mm };
    assert!(StructureField::new(&labels, 1, Some(&region(far, far, 3.0))).unwrap().is_none());
    for bad in
        [region(far, Point::new(0.0, 0.0, 0.0), 1.0), region(far, far, -1.0), region(far, far, f64::NAN)]
    {
        assert!(matches!(StructureField::new(&labels, 1, Some(&bad)), Err(ImageError::Region { .. })));
    }
    // a grid along ct's axes, the simplest case
    let plain = Grid::new([2, 1, 1], Vector3::repeat(1.0), Matrix3::identity(), Vector3::zeros()).unwrap();
    let two = Volume::new(plain, vec![4u16, 0]).unwrap();
    let field = StructureField::new(&two, 4, None).unwrap().unwrap();
    assert_eq!(field.distance(Point::new(3.0, 0.0, 0.0)), 2.5);
}
