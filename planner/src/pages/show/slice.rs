//! Planes through the scene: CT in grey and a code per voxel.

use bonemill_geometry::{Point, Work};

use super::{CUT, ShownImages};

/// HU shown as black and as white.
const WINDOW_HU: [f32; 2] = [-1000.0, 2000.0];

/// A plane of the work grid: the axes shown to the right and upwards, and the one looked along.
#[derive(Debug, Clone, Copy)]
pub struct Plane {
    /// What it is called.
    pub name: &'static str,
    /// Axis to the right.
    pub right: usize,
    /// Axis upwards.
    pub up: usize,
    /// Axis looked along.
    pub along: usize,
}

/// The three planes.
pub const PLANES: [Plane; 3] = [
    Plane { name: "along the approach (x-y)", right: 0, up: 1, along: 2 },
    Plane { name: "from the side (x-z, approach up)", right: 0, up: 2, along: 1 },
    Plane { name: "from the side (y-z, approach up)", right: 1, up: 2, along: 0 },
];

/// One slice: rows from top to bottom, one byte a pixel, a pixel a voxel.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Slice {
    /// Pixels in a row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Grey values.
    pub grey: Vec<u8>,
    /// Codes: [`super::NOTHING`], [`super::TARGET`], [`super::CUT`], structures from [`super::FIRST_STRUCTURE`].
    pub code: Vec<u8>,
}

impl ShownImages {
    /// The slice of a plane through `through` (or the nearest one), when waypoint `index` is reached.
    pub fn slice(&self, plane: &Plane, through: Point<Work>, index: u32) -> Slice {
        let grid = self.scene.class.grid();
        let dims = grid.dims();
        let (width, height) = (dims[plane.right], dims[plane.up]);
        let at = grid.continuous_index(through)[plane.along].round();
        let cut = at.clamp(0.0, (dims[plane.along] - 1) as f64) as usize;
        let mut slice = Slice {
            width,
            height,
            grey: Vec::with_capacity(width * height),
            code: Vec::with_capacity(width * height),
        };
        for row in 0..height {
            for column in 0..width {
                let mut voxel = [0; 3];
                (voxel[plane.right], voxel[plane.up], voxel[plane.along]) = (column, height - 1 - row, cut);
                let n = grid.index(voxel);
                let code = self.code(n, index);
                let share = (self.scene.hu.data()[n] - WINDOW_HU[0]) / (WINDOW_HU[1] - WINDOW_HU[0]);
                // removed voxels are drawn black
                slice.grey.push(if code == CUT { 0 } else { (share.clamp(0.0, 1.0) * 255.0) as u8 });
                slice.code.push(code);
            }
        }
        slice
    }

    /// Position of a point in a plane's slice, in pixels to the right and downwards; a pixel's middle is at a half.
    pub fn pixel(&self, plane: &Plane, p: Point<Work>) -> [f32; 2] {
        let grid = self.scene.class.grid();
        let at = grid.continuous_index(p);
        [(at[plane.right] + 0.5) as f32, (grid.dims()[plane.up] as f64 - 0.5 - at[plane.up]) as f32]
    }

    /// Size of a slice's pixel, mm: the grid is isotropic.
    pub fn pixel_mm(&self) -> f64 {
        self.scene.class.grid().spacing_mm().x
    }
}
