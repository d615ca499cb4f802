//! The solid voxels of a scene for a simulation: the planner's target, and the bone and structures around it, which also give
//! force when a deflected or hand-moved burr reaches them.

use bonemill_geometry::{Volume, VolumeError, Work};
use bonemill_imaging::DensityTable;
use bonemill_toolpath::scene::{Class, Scene};

use super::{Bone, EngineError};

/// Densities of all solid voxels of a scene, g/cm³: the target's material, all bone outside it, structures.
///
/// All other voxels are retracted soft tissue or air, and have density 0.
///
/// # Errors
/// None in practice: grids of one scene agree. The type is that of [`Volume::new`].
pub fn solid_density(scene: &Scene, table: &DensityTable) -> Result<Volume<f32, Work>, VolumeError> {
    let cut = scene.density_g_cm3.data().iter().zip(scene.class.data()).zip(scene.hu.data());
    let data = cut
        .map(|((&density, class), &hu)| {
            // structures give force also where they are softer than bone
            if class.is(Class::STRUCTURE) && density <= 0.0 {
                table.density_g_cm3(f64::from(hu)).max(0.0) as f32
            } else {
                density
            }
        })
        .collect();
    Volume::new(scene.class.grid().clone(), data)
}

/// A scene's solid voxels as the engine's bone.
///
/// # Errors
/// [`EngineError`] when the densities are not on the scene's grid.
pub fn bone_of<'a>(
    scene: &'a Scene,
    density_g_cm3: &'a Volume<f32, Work>,
) -> Result<Bone<'a, f32>, EngineError> {
    let bone = Bone::new(density_g_cm3)?.with_classes(&scene.class)?;
    Ok(bone.with_far(&scene.far).with_matter(&scene.matter))
}
