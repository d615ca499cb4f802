//! What a viewer draws of a finished plan, without knowing any viewer: surfaces, slices, colours, motion.
//!
//! Read anew from the plan's own images and files, and without its images where they are missing; everything is in the work frame, whose z is the approach, out of the
//! bone. The removal times come from the waypoints as they stand in the file, the motion from the trajectory by forward
//! kinematics: what is drawn is what would be executed. Nothing here judges or computes forces.

mod body;
mod colour;
mod frame;
mod motion;
mod paint;
mod plot;
mod slice;
mod surface;

use bonemill_cutter::Ball;
use bonemill_geometry::{Ct, Point, Rigid, Volume, Work};
use bonemill_scene::{Class, Scene};
use rayon::prelude::*;

pub use body::ShownBody;
pub use colour::{CUT_COLOUR, LINK_COLOUR, STRUCTURE_COLOURS, TARGET_COLOUR, css, scale_colour};
pub use frame::ShownFrame;
pub use motion::Moment;
pub use paint::{ARROW_MM_PER_N, PAINTS, Paint};
pub use plot::{Curve, Plot};
pub use slice::{PLANES, Plane, Slice};
pub use surface::Surface;

use bonemill_geometry::Progress;
use bonemill_planfile::StoredPlan;
use bonemill_setup::PlanError;
use bonemill_setup::inputs::scene_of;
use bonemill_stock::removal::RemovalTime;

/// Voxel codes of a slice: nothing of interest, target that is there, target that is cut; structures follow in the case's order.
pub const NOTHING: u8 = 0;
/// Target that is still there.
pub const TARGET: u8 = 1;
/// Target that is cut away.
pub const CUT: u8 = 2;
/// Code of the case's first structure.
pub const FIRST_STRUCTURE: u8 = 3;

/// A plan ready to be drawn.
#[derive(Debug)]
pub struct Show<'a> {
    plan: &'a StoredPlan,
    work_from_ct: Rigid<Work, Ct>,
    path: Vec<Point<Work>>,
    images: Option<ShownImages>,
}

/// What is drawn of a plan's images: target, structures, slices.
#[derive(Debug)]
pub struct ShownImages {
    scene: Scene,
    removal: RemovalTime,
    /// Structure of each voxel by its code, else [`NOTHING`].
    structure: Volume<u8, Work>,
}

impl<'a> Show<'a> {
    /// Reads a plan's images and lays its path through them. Where one of its inputs is missing, the rest is drawn without
    /// them.
    ///
    /// # Errors
    /// [`PlanError`] when images that are there cannot be read.
    pub fn read(plan: &'a StoredPlan, progress: &dyn Progress) -> Result<Self, PlanError> {
        let work_from_ct = plan.record.frames.ct_from_grid().inverse();
        let path: Vec<_> = plan.waypoints.iter().map(|w| work_from_ct * w.position).collect();
        let images = plan.images_found().then(|| ShownImages::read(plan, &path, progress)).transpose()?;
        Ok(Self { plan, work_from_ct, path, images })
    }

    /// The plan.
    pub fn plan(&self) -> &StoredPlan {
        self.plan
    }

    /// What is drawn of its images, where they were found.
    pub fn images(&self) -> Option<&ShownImages> {
        self.images.as_ref()
    }

    /// The burr's centre at every waypoint.
    pub fn path(&self) -> &[Point<Work>] {
        &self.path
    }

    /// Where the arm's base is.
    pub fn work_from_base(&self) -> Rigid<Work, bonemill_geometry::Base> {
        self.work_from_ct * self.plan.record.frames.base_from_ct.inverse()
    }
}

impl ShownImages {
    fn read(plan: &StoredPlan, path: &[Point<Work>], progress: &dyn Progress) -> Result<Self, PlanError> {
        let scene = scene_of(plan, progress)?;
        progress.stage("removal");
        let mut removal = RemovalTime::new(scene.class.grid());
        let radius_mm = plan.record.case.burr.radius_mm;
        removal.sweep(0..path.len() as u32, |n| path[n as usize], Ball { radius_mm }, |_| ());
        let structure = structures(&scene);
        Ok(Self { scene, removal, structure })
    }

    /// Code of a voxel once waypoint `index` is reached.
    fn code(&self, voxel: usize, index: u32) -> u8 {
        let structure = self.structure.data()[voxel];
        match self.scene.class.data()[voxel] {
            _ if structure != NOTHING => structure,
            class if !class.is(Class::TARGET) => NOTHING,
            _ if self.removal.time()[voxel] <= index => CUT,
            _ => TARGET,
        }
    }
}

/// Which structure each voxel belongs to, by code.
fn structures(scene: &Scene) -> Volume<u8, Work> {
    let grid = scene.class.grid();
    let code = |(n, class): (usize, &Class)| {
        if !class.is(Class::STRUCTURE) {
            return NOTHING;
        }
        let p = scene.ct_from_work * grid.center(grid.voxel(n));
        let inside =
            |s: &bonemill_scene::SceneStructure| s.field.as_ref().is_some_and(|f| f.distance(p) <= 0.0);
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
