//! The data that a viewer draws of a finished plan, independent of the viewer: surfaces, slices, colours, motion.
//!
//! The data are read from the plan's files and its images, or from the files alone where images are missing. Everything is in
//! the work frame, whose z is the approach, out of the bone. Removal times come from the waypoints in the file, and the motion
//! from the trajectory by forward kinematics, so the drawing shows what the arm would do. This module computes no forces and
//! makes no checks.

mod body;
mod colour;
mod frame;
mod motion;
mod paint;
mod plot;
mod slice;
mod surface;
mod tool;

use bonemill_geometry::{Ct, Point, Rigid, Volume, Work};
use bonemill_toolpath::scene::{Class, Scene};
use rayon::prelude::*;

pub use body::ShownBody;
pub use colour::{CUT_COLOUR, LINK_COLOUR, STRUCTURE_COLOURS, TARGET_COLOUR, css, light, scale_colour};
pub use frame::ShownFrame;
pub use motion::Moment;
pub use paint::{ARROW_MM_PER_N, PAINTS, Paint};
pub use plot::{Curve, Plot};
pub use slice::{PLANES, Plane, Slice};
pub use surface::Surface;
pub use tool::ShownTool;

use bonemill_geometry::Progress;
use bonemill_planfile::StoredPlan;
use bonemill_setup::PlanError;
use bonemill_setup::inputs::scene_of;

/// Voxel code of a slice for a voxel that is neither target nor structure.
pub const NOTHING: u8 = 0;
/// Voxel code of standing target.
pub const TARGET: u8 = 1;
/// Voxel code of removed target.
pub const CUT: u8 = 2;
/// Voxel code of the case's first structure; the others follow in the case's order.
pub const FIRST_STRUCTURE: u8 = 3;

/// A plan's data for drawing.
#[derive(Debug)]
pub struct Show<'a> {
    plan: &'a StoredPlan,
    work_from_ct: Rigid<Work, Ct>,
    path: Vec<Point<Work>>,
    tool: ShownTool,
    images: Option<ShownImages>,
}

/// The data from a plan's images: target, structures, slices.
#[derive(Debug)]
pub struct ShownImages {
    scene: Scene,
    /// The waypoint on the way to which each voxel is removed.
    removal: Vec<u32>,
    /// Code of the structure in each voxel, else [`NOTHING`].
    structure: Volume<u8, Work>,
}

impl<'a> Show<'a> {
    /// Reads a plan's images and computes the removal times of its path. If an input is missing, the plan is drawn without images.
    ///
    /// # Errors
    /// [`PlanError`] when images that are there cannot be read.
    pub fn read(plan: &'a StoredPlan, progress: &dyn Progress) -> Result<Self, PlanError> {
        let work_from_ct = plan.record.frames.ct_from_grid().inverse();
        let path: Vec<_> = plan.waypoints.iter().map(|w| work_from_ct * w.position).collect();
        let tool = ShownTool::of(plan)?;
        let images =
            plan.images_found().then(|| ShownImages::read(plan, &path, &tool, progress)).transpose()?;
        Ok(Self { plan, work_from_ct, path, tool, images })
    }

    /// The plan.
    pub fn plan(&self) -> &StoredPlan {
        self.plan
    }

    /// The data from its images, if they were found.
    pub fn images(&self) -> Option<&ShownImages> {
        self.images.as_ref()
    }

    /// The tool.
    pub fn tool(&self) -> &ShownTool {
        &self.tool
    }

    /// The tool's origin at every waypoint: a burr's centre.
    pub fn path(&self) -> &[Point<Work>] {
        &self.path
    }

    /// Pose of the arm's base in work.
    pub fn work_from_base(&self) -> Rigid<Work, bonemill_geometry::Base> {
        self.work_from_ct * self.plan.record.frames.base_from_ct.inverse()
    }
}

impl ShownImages {
    fn read(
        plan: &StoredPlan,
        path: &[Point<Work>],
        tool: &ShownTool,
        progress: &dyn Progress,
    ) -> Result<Self, PlanError> {
        let scene = scene_of(plan, progress)?;
        progress.stage("removal");
        let removal = tool.removal(scene.class.grid(), path);
        let structure = structures(&scene);
        Ok(Self { scene, removal, structure })
    }

    /// Code of a voxel when waypoint `index` is reached.
    fn code(&self, voxel: usize, index: u32) -> u8 {
        let structure = self.structure.data()[voxel];
        match self.scene.class.data()[voxel] {
            _ if structure != NOTHING => structure,
            class if !class.is(Class::TARGET) => NOTHING,
            _ if self.removal[voxel] <= index => CUT,
            _ => TARGET,
        }
    }
}

/// Code of the structure to which each voxel belongs.
fn structures(scene: &Scene) -> Volume<u8, Work> {
    let grid = scene.class.grid();
    let code = |(n, class): (usize, &Class)| {
        if !class.is(Class::STRUCTURE) {
            return NOTHING;
        }
        let p = scene.ct_from_work * grid.center(grid.voxel(n));
        let inside = |s: &bonemill_toolpath::scene::SceneStructure| {
            s.field.as_ref().is_some_and(|f| f.distance(p) <= 0.0)
        };
        let found = scene.structures.iter().zip(FIRST_STRUCTURE..).find(|(s, _)| inside(s));
        found.map_or(NOTHING, |(_, code)| code)
    };
    let codes: Vec<u8> = scene.class.data().par_iter().enumerate().map(code).collect();
    let mut volume = Volume::filled(grid.clone(), NOTHING);
    volume.data_mut().copy_from_slice(&codes);
    volume
}

#[cfg(test)]
mod tests;
