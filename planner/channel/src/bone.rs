//! What a tool meets along a channel: the density of bone at any point of ct, as the image has it.
//!
//! At or above `bone_hu` is bone, with its density; what is softer is retracted and resists nothing. Bone in front of an
//! advancing edge is untouched, since everything that the tool swept before lies behind it: no state of removal is needed.

use bonemill_case::Density;
use bonemill_geometry::{Ct, Point, Volume, trilinear};
use nalgebra::{Rotation3, Unit, Vector3};

/// Bone of a CT.
#[derive(Debug, Clone, Copy)]
pub struct BoneField<'a> {
    /// HU.
    pub ct: &'a Volume<f32, Ct>,
    /// Table and thresholds.
    pub density: &'a Density,
}

impl BoneField<'_> {
    /// HU at a point; `None` where there is no image.
    pub fn hu(&self, p: Point<Ct>) -> Option<f64> {
        let (corners, at) = self.ct.cell_inside(self.ct.grid().continuous_index(p))?;
        Some(trilinear(&corners, at))
    }

    /// Density of bone at a point, g/cm³; 0 where there is none, or no image.
    ///
    /// HU are calibrated at the voxels, then the density is interpolated.
    pub fn density_g_cm3(&self, p: Point<Ct>) -> f64 {
        let Some((corners, at)) = self.ct.cell_inside(self.ct.grid().continuous_index(p)) else { return 0.0 };
        if trilinear(&corners, at) < self.density.bone_hu {
            return 0.0;
        }
        trilinear(&corners.map(|hu| self.density.table.density_g_cm3(hu)), at)
    }
}

/// A pose of the tool: its origin and its axes in ct.
#[derive(Debug, Clone, Copy)]
pub struct ToolPose {
    /// The tool's origin.
    pub origin: Point<Ct>,
    /// ct from tool: z to the handpiece.
    pub turn: Rotation3<f64>,
}

impl ToolPose {
    /// The tool with its origin at a point and its axis along `out`.
    pub fn new(origin: Point<Ct>, out: &Unit<Vector3<f64>>) -> Self {
        Self { origin, turn: bonemill_geometry::basis::from_z(out) }
    }

    /// A point of the tool in ct.
    pub fn place(&self, p: Vector3<f64>) -> Point<Ct> {
        self.origin + self.turn * p
    }
}
