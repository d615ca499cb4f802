//! Closed triangle surfaces of voxel fields, for display and export.
//!
//! Naive surface nets: one vertex in each cube of eight voxel centres that the surface crosses, at the mean of its edge
//! crossings. Invariants: the surface is closed, also where the body leaves the grid (it then ends on the outermost voxel
//! faces); triangles are counter-clockwise seen from outside, on mirrored grids too; vertices are mm in the grid's frame.
//! Where two parts of a body meet along a voxel edge only, four triangles share that edge: watertight, but not a manifold
//! there. Distances are never measured on these meshes.

use bonemill_geometry::{Frame, Grid, Mesh, Volume};
use fast_surface_nets::ndshape::{RuntimeShape, Shape};
use fast_surface_nets::{SurfaceNetsBuffer, surface_nets};

/// The surface around the voxels whose value is above `level`.
///
/// Between voxel centres the field is linear along the grid's edges. A NaN counts as outside. The mesh is empty when no
/// value is above `level`. For the signed distance of a ball of radius r on voxels of spacing h, area and volume are too
/// small by at most the shares 0.7 (h/r)² and 1.15 (h/r)² (measured for r/h from 4 to 32).
///
/// # Panics
/// When the body's bounding box holds 2³² voxels or more (16 GiB of field).
pub fn iso_surface<F: Frame>(field: &Volume<f32, F>, level: f32) -> Mesh<F> {
    // clamped to finite values, so that interpolation along edges stays finite
    let depth = |value: f32| if value.is_nan() { -1.0 } else { (value - level).clamp(-1e30, 1e30) };
    mesh_of(field, depth)
}

/// The zero surface of `depth(value)`, positive inside.
fn mesh_of<T: Copy, F: Frame>(volume: &Volume<T, F>, depth: impl Fn(T) -> f32) -> Mesh<F> {
    let grid = volume.grid();
    let Some((lo, hi)) = bounds(volume, |value| depth(value) > 0.0) else {
        return Mesh { vertices: Vec::new(), triangles: Vec::new() };
    };
    // node 0 is voxel lo - 1; there are two nodes beyond hi, because faces on the last plane of nodes are left out
    let nodes: [usize; 3] = std::array::from_fn(|a| hi[a] - lo[a] + 4);
    let count = nodes.iter().map(|&n| n as u64).product::<u64>();
    assert!(count < 1 << 32, "a surface over {nodes:?} voxels does not fit 32-bit vertex numbers");

    let shape = RuntimeShape::<u32, 3>::new(nodes.map(|n| n as u32));
    let mut distance = Vec::with_capacity(shape.usize());
    for k in 0..nodes[2] {
        for j in 0..nodes[1] {
            for i in 0..nodes[0] {
                let node = [i, j, k];
                let voxel =
                    std::array::from_fn(|a| (node[a] + lo[a]).saturating_sub(1).min(grid.dims()[a] - 1));
                let inside = depth(*volume.get(voxel));
                let beyond = (0..3).any(|a| node[a] + lo[a] != voxel[a] + 1);
                // beyond the grid the value is mirrored, which puts the crossing on the voxel's face
                distance.push(if beyond { inside.abs() } else { -inside });
            }
        }
    }
    let mut buffer = SurfaceNetsBuffer::default();
    surface_nets(&distance, &shape, [0; 3], nodes.map(|n| n as u32 - 1), &mut buffer);
    assemble(grid, lo, &buffer)
}

/// The buffer's mesh in mm, facing outwards.
fn assemble<F: Frame>(grid: &Grid<F>, lo: [usize; 3], buffer: &SurfaceNetsBuffer) -> Mesh<F> {
    let place = |p: &[f32; 3]| grid.at(std::array::from_fn(|a| f64::from(p[a]) + lo[a] as f64 - 1.0));
    let mirrored = grid.axes().determinant() < 0.0;
    let face = |t: &[u32]| if mirrored { [t[0], t[2], t[1]] } else { [t[0], t[1], t[2]] };
    Mesh {
        vertices: buffer.positions.iter().map(place).collect(),
        triangles: buffer.indices.chunks_exact(3).map(face).collect(),
    }
}

/// First and last voxel, per axis, of those that are `inside`.
fn bounds<T: Copy, F: Frame>(
    volume: &Volume<T, F>,
    inside: impl Fn(T) -> bool,
) -> Option<([usize; 3], [usize; 3])> {
    let [nx, ny, _] = volume.grid().dims();
    let (mut lo, mut hi) = ([usize::MAX; 3], [0; 3]);
    for (row, values) in volume.data().chunks_exact(nx).enumerate() {
        let Some(first) = values.iter().position(|&v| inside(v)) else { continue };
        let last = values.iter().rposition(|&v| inside(v)).unwrap_or(first);
        for (a, (from, to)) in
            [(first, last), (row % ny, row % ny), (row / ny, row / ny)].into_iter().enumerate()
        {
            lo[a] = lo[a].min(from);
            hi[a] = hi[a].max(to);
        }
    }
    (lo[0] != usize::MAX).then_some((lo, hi))
}

#[cfg(test)]
mod tests {
    use std::collections::HashMap;
    use std::f64::consts::PI;

    use bonemill_geometry::{Point, Work};
    use nalgebra::{Matrix3, Rotation3, Vector3};

    use super::*;

    const CENTER: Point<Work> = Point::new(3.1, -2.3, 7.7);

    /// An oblique grid around `CENTER` that reaches `half_mm` to each side.
    fn grid(spacing_mm: f64, half_mm: f64, mirrored: bool) -> Grid<Work> {
        let mut axes = Rotation3::new(Vector3::new(0.3, -0.2, 0.6)).into_inner();
        if mirrored {
            axes.set_column(1, &-axes.column(1));
        }
        let n = (2.0 * half_mm / spacing_mm).ceil() as usize + 1;
        let spacing = Vector3::repeat(spacing_mm);
        // a shift by no simple fraction of a voxel, so that no voxel centre lies on the surface
        let origin = CENTER.coords - axes * (spacing * (0.5 * (n - 1) as f64 + 0.137));
        Grid::new([n; 3], spacing, axes, origin).unwrap()
    }

    fn ball(grid: Grid<Work>, radius_mm: f64) -> Volume<f32, Work> {
        let value = |n| (radius_mm - grid.center(grid.voxel(n)).distance_mm(&CENTER)) as f32;
        let data = (0..grid.len()).map(value).collect();
        Volume::new(grid, data).unwrap()
    }

    /// Every directed edge once, and its reverse once.
    fn assert_closed_manifold(mesh: &Mesh<Work>) {
        let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
        for t in &mesh.triangles {
            for e in [(t[0], t[1]), (t[1], t[2]), (t[2], t[0])] {
                *edges.entry(e).or_default() += 1;
            }
        }
        assert!(!edges.is_empty());
        for (&(a, b), &n) in &edges {
            assert_eq!(n, 1, "edge {a}-{b}");
            assert_eq!(edges.get(&(b, a)), Some(&1), "edge {b}-{a}");
        }
    }

    #[test]
    fn a_ball_has_its_area_and_volume_and_both_converge_with_the_spacing() {
        let r = 4.0;
        let (area, volume) = (4.0 * PI * r * r, 4.0 / 3.0 * PI * r * r * r);
        let mut errors = Vec::new();
        for cells in [4.0, 8.0, 16.0, 32.0] {
            let h = r / cells;
            let mesh = iso_surface(&ball(grid(h, r + 2.0 * h, false), r), 0.0);
            assert_closed_manifold(&mesh);
            let (e_area, e_volume) =
                ((mesh.area_mm2() / area - 1.0).abs(), (mesh.volume_mm3() / volume - 1.0).abs());
            assert!(
                e_area < 0.7 / (cells * cells) && e_volume < 1.15 / (cells * cells),
                "r/h {cells}: area {e_area:.2e}, volume {e_volume:.2e}"
            );
            errors.push(e_volume);
        }
        assert!(errors.windows(2).all(|e| e[1] < 0.35 * e[0]), "second order: {errors:?}");
    }

    #[test]
    fn vertices_lie_on_the_ball_in_mm_of_the_frame() {
        let mesh = iso_surface(&ball(grid(0.25, 4.5, false), 4.0), 0.0);
        let worst = mesh.vertices.iter().map(|v| (v.distance_mm(&CENTER) - 4.0).abs()).fold(0.0, f64::max);
        assert!(worst < 0.25 * 0.25 / 4.0, "{worst} mm");
    }

    #[test]
    fn the_level_moves_the_surface() {
        let mesh = iso_surface(&ball(grid(0.25, 4.5, false), 4.0), 1.0);
        assert!((mesh.volume_mm3() / (4.0 / 3.0 * PI * 27.0) - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_mirrored_grid_still_faces_outwards() {
        for mirrored in [false, true] {
            let field = ball(grid(0.25, 4.5, mirrored), 4.0);
            let mesh = iso_surface(&field, 0.0);
            assert_closed_manifold(&mesh);
            assert!(mesh.volume_mm3() > 250.0, "mirrored {mirrored}: {}", mesh.volume_mm3());
            for t in &mesh.triangles {
                let [a, b, c] = t.map(|n| mesh.vertices[n as usize].coords);
                assert!((b - a).cross(&(c - a)).dot(&(a - CENTER.coords)) > 0.0);
            }
        }
    }

    #[test]
    fn a_body_that_leaves_the_grid_is_closed_on_the_voxel_faces() {
        let spacing = Vector3::new(0.5, 0.7, 1.1);
        let g =
            Grid::<Work>::new([6, 5, 4], spacing, Matrix3::identity(), Vector3::new(9.0, 0.0, -4.0)).unwrap();
        let labels = Volume::filled(g, 7u16);
        let mesh = label_surface(&labels, 7);
        assert_closed_manifold(&mesh);
        let (lo, hi) =
            mesh.vertices.iter().fold((mesh.vertices[0].coords, mesh.vertices[0].coords), |(lo, hi), v| {
                (lo.inf(&v.coords), hi.sup(&v.coords))
            });
        assert!((lo - Vector3::new(8.75, -0.35, -4.55)).amax() < 1e-6, "{lo}");
        assert!((hi - Vector3::new(11.75, 3.15, -0.15)).amax() < 1e-6, "{hi}");
    }

    fn label_surface<F: Frame>(labels: &Volume<u16, F>, label: u16) -> Mesh<F> {
        iso_surface(&labels.map(|l| if *l == label { 1.0 } else { -1.0 }), 0.0)
    }

    #[test]
    fn a_single_voxel_and_a_labelled_ball_are_bodies() {
        let g = grid(0.4, 4.6, true);
        let mut one = Volume::filled(g.clone(), 0u16);
        let n = g.index([0, 3, 2]);
        one.data_mut()[n] = 3;
        assert_closed_manifold(&label_surface(&one, 3));
        let labels = ball(g, 4.0).map(|&d| if d > 0.0 { 5u16 } else { 2 });
        let mesh = label_surface(&labels, 5);
        assert_closed_manifold(&mesh);
        assert!((mesh.volume_mm3() / (4.0 / 3.0 * PI * 64.0) - 1.0).abs() < 0.015, "{}", mesh.volume_mm3());
    }

    #[test]
    fn no_crossing_gives_no_triangle_and_nan_is_outside() {
        let mut field = ball(grid(0.5, 4.5, false), 4.0);
        assert!(iso_surface(&field, 99.0).triangles.is_empty());
        assert!(label_surface(&field.map(|_| 1u16), 2).vertices.is_empty());
        let n = field.data().len() / 2;
        field.data_mut()[n] = f32::NAN;
        field.data_mut()[n + 1] = f32::INFINITY;
        let mesh = iso_surface(&field, 0.0);
        assert!(!mesh.triangles.is_empty() && mesh.vertices.iter().all(Point::is_finite));
        assert!(iso_surface(&field.map(|_| f32::NAN), 0.0).triangles.is_empty());
    }
}
