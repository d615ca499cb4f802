//! Surfaces of the remaining target, of structures, and of the clearances around them.

use bonemill_geometry::{Frame, Grid, Mesh, Point, Volume, Work};
use bonemill_imaging::{ImageError, distance_only, surface::iso_surface};
use bonemill_toolpath::scene::Class;
use nalgebra::{Matrix3, Vector3};

use super::{FIRST_STRUCTURE, ShownImages};

/// A triangle surface with a normal per vertex, single precision, work frame, mm.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Surface {
    /// Vertices.
    pub vertices: Vec<[f32; 3]>,
    /// Outward unit normals, one per vertex.
    pub normals: Vec<[f32; 3]>,
    /// The numbers of each triangle's three vertices.
    pub triangles: Vec<[u32; 3]>,
}

impl Surface {
    /// Of a mesh; a vertex's normal is the mean of its triangles', by their area.
    pub fn of<F: Frame>(mesh: &Mesh<F>) -> Self {
        let mut normals = vec![Vector3::zeros(); mesh.vertices.len()];
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|n| mesh.vertices[n as usize].coords);
            // its length is twice the area, so large triangles count more
            let normal = (b - a).cross(&(c - a));
            t.iter().for_each(|&n| normals[n as usize] += normal);
        }
        let single = |v: &Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
        let unit = |v: &Vector3<f64>| single(&v.try_normalize(0.0).unwrap_or_else(Vector3::z));
        Self {
            vertices: mesh.vertices.iter().map(|p| single(&p.coords)).collect(),
            normals: normals.iter().map(unit).collect(),
            triangles: mesh.triangles.clone(),
        }
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.triangles.is_empty()
    }
}

impl ShownImages {
    /// The surface of the target, air cells included, that remains when waypoint `index` is reached; `None` means the whole
    /// target. It is computed on cells of two voxels, which is fine enough for display.
    pub fn target(&self, index: Option<u32>) -> Surface {
        let class = self.scene.class.data();
        let counts = |n: usize| class[n].is(Class::TARGET) && index.is_none_or(|i| self.removal[n] > i);
        let grid = self.scene.class.grid();
        match coarse(grid) {
            Some(cells) => Surface::of(&iso_surface(&shares(grid, &cells, counts), 0.5)),
            None => Surface::default(),
        }
    }

    /// The surface at `offset_mm` around the case's structure `n`, as far as it lies in the scene. It is interpolated between
    /// voxel centres, for display only.
    ///
    /// # Errors
    /// When a distance field cannot be computed.
    pub fn around(&self, n: usize, offset_mm: f64) -> Result<Surface, ImageError> {
        let code = u8::try_from(n).ok().and_then(|n| FIRST_STRUCTURE.checked_add(n));
        let mask = self.structure.map(|c| Some(*c) == code);
        let Some(distance_mm) = distance_only(&mask)? else { return Ok(Surface::default()) };
        let level_mm = offset_mm + 0.5 * self.pixel_mm();
        Ok(Surface::of(&iso_surface(&distance_mm.map(|d| -d), -level_mm as f32)))
    }
}

/// The grid of cells of 2 × 2 × 2 voxels; its last cells may extend beyond the original grid.
fn coarse(grid: &Grid<Work>) -> Option<Grid<Work>> {
    let origin: Point<Work> = grid.at([0.5; 3]);
    let dims = grid.dims().map(|d| d.div_ceil(2));
    Grid::new(dims, 2.0 * grid.spacing_mm(), Matrix3::identity(), origin.coords).ok()
}

/// Share of each cell's voxels for which `counts` is true.
fn shares(grid: &Grid<Work>, cells: &Grid<Work>, counts: impl Fn(usize) -> bool) -> Volume<f32, Work> {
    let mut shares = Volume::filled(cells.clone(), 0.0);
    for n in (0..grid.len()).filter(|n| counts(*n)) {
        let cell = cells.index(grid.voxel(n).map(|v| v / 2));
        shares.data_mut()[cell] += 0.125;
    }
    shares
}
