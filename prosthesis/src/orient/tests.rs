//! The orientation of a part: known boxes, agreement of exact and published method, and independence of threads.

use bonemill_geometry::Point;
use proptest::prelude::*;

use super::outline::Outline;
use super::refined::least_angle;
use super::*;
use bonemill_imaging::part::phantom::Operculum;

/// A box with its sides along the axes, from the origin.
fn cuboid(size: [f64; 3]) -> Mesh<Part> {
    let vertices = (0..8).map(|n| {
        let at = |axis: usize| if n >> axis & 1 == 1 { size[axis] } else { 0.0 };
        Point::new(at(0), at(1), at(2))
    });
    let triangles = vec![
        [0, 2, 1],
        [1, 2, 3],
        [4, 5, 6],
        [5, 7, 6],
        [0, 1, 4],
        [1, 5, 4],
        [2, 6, 3],
        [3, 6, 7],
        [0, 4, 2],
        [2, 4, 6],
        [1, 3, 5],
        [3, 7, 5],
    ];
    Mesh { vertices: vertices.collect(), triangles }
}

fn rotation() -> impl Strategy<Value = Rotation3<f64>> {
    prop::array::uniform3(-3.0f64..3.0).prop_map(|r| Rotation3::new(Vector3::from(r)))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A convex body's shadow is half its surface, each face by the cosine of its inclination (Cauchy).
    #[test]
    fn the_outline_of_a_box_has_the_area_of_its_shadow(turn in rotation(), size in prop::array::uniform3(1.0f64..40.0)) {
        let silhouette = SeenSurface::of(&cuboid(size));
        let faces = [size[1] * size[2], size[2] * size[0], size[0] * size[1]];
        for (plane, along) in [(ProjectionPlane::Xy, 2), (ProjectionPlane::Xz, 1), (ProjectionPlane::Yz, 0)] {
            let expected: f64 = (0..3).map(|n| faces[n] * turn.matrix()[(along, n)].abs()).sum();
            let found = silhouette.outline(&turn, plane).area_mm2;
            prop_assert!((found - expected).abs() < 1e-5 * expected, "{plane:?}: {found} {expected}");
        }
    }

    #[test]
    fn calipers_find_the_least_rectangle(points in prop::collection::vec(prop::array::uniform2(-20.0f64..20.0), 3..30)) {
        let hull: geo::Polygon<f64> =
            geo::ConvexHull::convex_hull(&geo::MultiPoint::new(points.iter().map(|p| geo::Point::new(p[0], p[1])).collect::<Vec<_>>()));
        let hull_mm = hull.exterior().coords().map(|c| [c.x, c.y]).collect();
        let outline = Outline { area_mm2: 0.0, hull_mm };
        let exact = outline.residual_mm2(-least_angle(&outline));
        let scanned = (0..1800).map(|n| outline.residual_mm2(f64::from(n) * 1e-3)).fold(f64::INFINITY, f64::min);
        prop_assert!(exact <= scanned + 1e-9 * scanned, "{exact} {scanned}");
    }
}

#[test]
fn a_hole_is_no_part_of_the_outline() {
    // a square frame: 10 × 10 with a hole of 4 × 4, two high
    let ring = |half: f64| [[-half, -half], [half, -half], [half, half], [-half, half]];
    let (mut vertices, mut triangles) = (Vec::new(), Vec::new());
    for (half, z) in [(5.0, 0.0), (5.0, 2.0), (2.0, 2.0), (2.0, 0.0)] {
        vertices.extend(ring(half).map(|[x, y]| Point::new(x, y, z)));
    }
    for loop_ in 0..4_u32 {
        let (a, b) = (4 * loop_, 4 * ((loop_ + 1) % 4));
        for k in 0..4 {
            let n = (k + 1) % 4;
            triangles.extend([[a + k, a + n, b + n], [a + k, b + n, b + k]]);
        }
    }
    let mesh = Mesh { vertices, triangles };
    assert!((mesh.volume_mm3() - 168.0).abs() < 1e-9);
    let silhouette = SeenSurface::of(&mesh);
    assert!((silhouette.outline(&Rotation3::identity(), ProjectionPlane::Xy).area_mm2 - 84.0).abs() < 1e-6);
    assert!((silhouette.residual(&Rotation3::identity()).xy_mm2 - 16.0).abs() < 1e-6);
}

#[test]
fn a_tilted_box_is_laid_flat_and_in_order() {
    let size = [30.0, 20.0, 8.0];
    let mesh = cuboid(size).transformed(&Rigid::<Part, Part>::new(
        Rotation3::new(Vector3::new(0.4, -0.3, 0.7)),
        Vector3::repeat(9.0),
    ));
    let silhouette = SeenSurface::of(&mesh);
    let laid = least_residual(&mesh, &silhouette, &published(&mesh, &silhouette));
    for (found, expected) in laid.size_mm.iter().zip([30.0, 8.0, 20.0]) {
        assert!((found - expected).abs() < 0.05, "{}", laid.size_mm);
    }
    assert!(laid.residual.sum_mm2() < 2.0, "{:?}", laid.residual);
    assert!((laid.block_from_part.rotation.matrix().determinant() - 1.0).abs() < 1e-9);
    let center = laid.block_from_part
        * Point::from_coords(
            Rotation3::new(Vector3::new(0.4, -0.3, 0.7)) * Vector3::new(15.0, 10.0, 4.0)
                + Vector3::repeat(9.0),
        );
    assert!(center.coords.norm() < 1e-9);
}

#[test]
fn the_exact_orientation_is_never_worse_than_the_published_one() {
    for seed in 1..=6 {
        let mesh = Operculum::drawn(seed).mesh(2500);
        let silhouette = SeenSurface::of(&mesh);
        let runs = published(&mesh, &silhouette);
        let (first, last) = (runs.first().unwrap().laid.residual, &runs.last().unwrap().laid);
        let given = Laid::as_given(&mesh, &silhouette).residual;
        assert!(last.residual.sum_mm2() <= given.sum_mm2(), "seed {seed}: {given:?} {last:?}");
        assert!(runs.len() >= 2 && last.residual.sum_mm2() <= first.sum_mm2() + 1e-3 * given.sum_mm2());
        let exact = least_residual(&mesh, &silhouette, &runs);
        assert!(
            exact.residual.sum_mm2() <= last.residual.sum_mm2() + 1e-6,
            "seed {seed}: {exact:?} {last:?}"
        );
        for laid in [&exact, last] {
            let s = laid.size_mm;
            assert!(s.x >= s.z && s.z >= s.y, "seed {seed}: {s}");
            // the outer side bulges toward +y: its middle stands higher than its border
            let turned = mesh.transformed(&laid.block_from_part);
            let top = turned.vertices.iter().max_by(|a, b| a.y().total_cmp(&b.y())).unwrap();
            assert!(top.x().hypot(top.z()) < 0.45 * s.x, "seed {seed}: {top:?}");
        }
    }
}

#[test]
fn the_order_of_threads_changes_nothing() {
    let mesh = Operculum::drawn(3).mesh(1500);
    let silhouette = SeenSurface::of(&mesh);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| least_residual(&mesh, &silhouette, &published(&mesh, &silhouette)))
    };
    assert_eq!(on(1), on(3));
}
