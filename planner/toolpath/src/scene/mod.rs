//! The scene: everything the planner needs of the images, on one isotropic grid along the approach.
//!
//! One crop to the target and the burr's reach, one resampling, one class per voxel. Outside the crop nothing fine is
//! kept; what the handpiece could meet there is a coarse, conservative map (`far`). The work frame's origin is the
//! grid's first voxel centre, its z points out of the bone, so a milling layer is a slab of the grid.

mod build;
mod crop;
mod edge;
mod far;
mod hull;
mod inside;
mod labels;
mod mask;
mod matter;
mod obstacles;
mod place;
#[cfg(test)]
mod tests;
mod touching;
mod way_in;

use bonemill_geometry::{Approach, Ct, Point, Rigid, Volume, Work, basis};
use nalgebra::Vector3;
use thiserror::Error;

pub use bonemill_geometry::{Sheets, Target};
pub use build::{MemoryNeed, SceneSpec, ToolReach, build_scene};
pub use edge::{ByFace, TargetOutside};
pub use far::FarObstacles;
pub use hull::{Rectangle, smallest_rectangle};
pub use matter::Matter;
pub use place::{Displaced, LabelExtent, label_extents};
pub use way_in::{ApproachSpec, ArmHolds, ChosenWay, HoldsAt, Tilts, Way, WayInTool};

use bonemill_imaging::StructureField;

/// What a voxel of the work grid is; several may hold at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Class(pub u8);

impl Class {
    /// Belongs to the target: to be removed, air cells included.
    pub const TARGET: u8 = 1;
    /// Target above `air_hu`.
    pub const MATERIAL: u8 = 2;
    /// Target at or above `bone_hu`.
    pub const TARGET_BONE: u8 = 4;
    /// Bone outside the target: neither burr nor shank may touch it.
    pub const OBSTACLE: u8 = 8;
    /// Bone outside the target that is no obstacle: a speck, or so thin and near the target that it is taken for partial
    /// volume, see [`Scene::band_mm`]. The burr may take it, and feels it.
    pub const SHEET: u8 = 16;
    /// Inside a structure.
    pub const STRUCTURE: u8 = 32;
    /// An obstacle thinner than the band: none with [`Sheets::Cut`].
    pub const THIN: u8 = 64;
    /// What gives force and mass wherever the burr meets it.
    pub const HAS_MASS: u8 = Self::MATERIAL | Self::OBSTACLE | Self::SHEET;

    /// Whether one of `flags` is set.
    #[inline]
    pub fn is(self, flags: u8) -> bool {
        self.0 & flags != 0
    }
}

/// One structure to be kept, with its exact distance.
#[derive(Debug)]
pub struct SceneStructure {
    /// Its name.
    pub name: String,
    /// Its label in the map.
    pub label: u16,
    /// Volume of all its voxels, mm³.
    pub volume_mm3: f64,
    /// Median of its grey values in the CT, HU, of at most 20,000 voxels throughout it; `None` where it shares all with others.
    pub median_hu: Option<f64>,
    /// Exact distance to its voxel boxes; `None` when no voxel of it lies in reach of the tool.
    pub field: Option<StructureField>,
}

/// Images, target and structures on the planning grid.
#[derive(Debug)]
pub struct Scene {
    /// Work frame, the grid's, in ct.
    pub ct_from_work: Rigid<Ct, Work>,
    /// How far the grid is turned about the approach from the basis of z, rad in [−π/4, π/4]: see
    /// [`Scene::ct_from_approach`].
    pub turn_rad: f64,
    /// Approach used: unit, out of the bone.
    pub approach: Vector3<f64>,
    /// How it was chosen, if it was not given.
    pub way: Option<ChosenWay>,
    /// Hounsfield units.
    pub hu: Volume<f32, Work>,
    /// Density of each voxel, g/cm³: 0 unless it has [`Class::HAS_MASS`].
    pub density_g_cm3: Volume<f32, Work>,
    /// Density at any point.
    pub matter: Matter,
    /// Class per voxel.
    pub class: Volume<Class, Work>,
    /// Distance from voxel centres to the centres of obstacle voxels, mm, cut off at twice the burr's radius; `None`:
    /// there is no obstacle.
    pub obstacle_mm: Option<Volume<f32, Work>>,
    /// Structures, in the case's order.
    pub structures: Vec<SceneStructure>,
    /// What lies beyond the work grid, coarsely.
    pub far: FarObstacles,
    /// The largest voxel diagonal of CT, labels and work grid, mm: thinner bone within as much of the target
    /// is taken for partial volume.
    pub band_mm: f64,
    /// What a voxel of the target stands for, mm³: all voxels in the label or shape, the volume that it has on its own grid or as
    /// a solid. A count of centres alone is off by up to a voxel at every face.
    pub target_voxel_mm3: f64,
    /// Centre of the target's voxels.
    pub target_center: Point<Work>,
    /// Convex hull of the target seen along the approach: corners (x, y) in work, mm, counter-clockwise.
    pub target_hull_xy: Vec<[f64; 2]>,
    /// The part of the target beyond the scan: neither target nor removed.
    pub outside: TargetOutside,
    /// Bone on the scan's edge within the burr's diameter of the target, mm²: where it goes on beyond is not known.
    pub edge_bone_mm2: ByFace,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Why no scene can be made of the images.
#[derive(Debug, Error)]
pub enum SceneError {
    /// The label is not in the map.
    #[error("label {label} ({what}) has no voxel in the label map; labels there: {present}")]
    LabelAbsent {
        /// The label's value.
        label: u16,
        /// What the case names it for.
        what: String,
        /// What the map holds.
        present: String,
    },
    /// CT and label map do not overlap.
    #[error(
        "CT and label map do not overlap: CT spans {ct} mm, the map {labels} mm (both in ct); \
         are they of the same patient and affine convention?"
    )]
    NoOverlap {
        /// Extent of the CT.
        ct: String,
        /// Extent of the map.
        labels: String,
    },
    /// The label map lies beside the CT.
    #[error(
        "the label map has the CT's dimensions, but another spacing or origin: its corners lie up to {mm:.3} mm ({voxels:.1} \
         voxels) beside the CT's, at most 1 voxel is accepted. {}",
        elsewhere(*is_nifti)
    )]
    LabelsDisplaced {
        /// The largest distance of corners, mm.
        mm: f64,
        /// The same in the CT's smallest voxel spacing.
        voxels: f64,
        /// Whether the map is a NIfTI file, of whose transforms the case can choose one.
        is_nifti: bool,
    },
    /// Nothing of a label lies in the CT.
    #[error(
        "{what} (label {label}) lies wholly outside the CT: the nearest of its {mm3:.2} mm³ is {beyond_mm:.2} mm beyond the scan's \
         edge. CT and label map do not share a place there: are they of the same scan, and is the map where it was drawn? Give a CT \
         that holds it, or leave it out of the case"
    )]
    LabelOutside {
        /// What the case names it for.
        what: String,
        /// The label's value.
        label: u16,
        /// Its volume, mm³.
        mm3: f64,
        /// Distance of its nearest voxel's centre from the CT's edge, mm.
        beyond_mm: f64,
    },
    /// The target holds nothing that can be removed.
    #[error("the target is empty: {0}")]
    EmptyTarget(String),
    /// Structures that the target touches take most of it.
    #[error(
        "the target touches {structures}: {lost_mm3:.2} of its {drawn_mm3:.2} mm³ lie in a structure or within its clearance_mm, more than half; \
         expected a target beside the structures: look whether the labels are right"
    )]
    TargetGivesWay {
        /// Which, in words.
        structures: String,
        /// What they take, mm³.
        lost_mm3: f64,
        /// The target as drawn, mm³.
        drawn_mm3: f64,
    },
    /// Too much of the target lies outside the scan.
    #[error(
        "{outside}; expected at most {most_percent} %. The target spans {target} mm, the CT {ct} mm (both in ct): give a scan \
         that holds the target, crop the target to the scan, or check both images' affines"
    )]
    TargetOutside {
        /// How much and on which side.
        outside: String,
        /// How much would be planned for, per cent of the target.
        most_percent: f64,
        /// Extent of the target.
        target: String,
        /// Extent of the CT.
        ct: String,
    },
    /// A structure lies in what a channel's tool sweeps.
    #[error(
        "the target touches structure '{structure}' at ct ({x:.2}, {y:.2}, {z:.2}) mm, label voxel {voxel:?}: the tool would sweep it; \
         choose another entry, direction or depth, or a thinner tool"
    )]
    TargetTouches {
        /// The structure.
        structure: String,
        /// Where, mm in ct.
        x: f64,
        /// Where, mm in ct.
        y: f64,
        /// Where, mm in ct.
        z: f64,
        /// The structure's voxel in the label map.
        voxel: [usize; 3],
    },
    /// The planning grid would not fit.
    #[error(
        "planning would take about {needed_mb:.0} MB, and {most_mb:.0} MB {}: the target spans {extent} mm, which is {voxels} \
         voxels at grid.spacing_mm = {spacing_mm}; {fitting_mm:.2} mm would fit",
        if *is_available { "are available" } else { "are the most that is planned in" }
    )]
    TooLarge {
        /// How many voxels.
        voxels: f64,
        /// Memory for them, MB.
        needed_mb: f64,
        /// Memory that there is, MB.
        most_mb: f64,
        /// Whether that is what this computer has left, rather than the most voxels of a plan.
        is_available: bool,
        /// A spacing at which it would fit, mm.
        fitting_mm: f64,
        /// Extent of the target.
        extent: String,
        /// The spacing asked for, mm.
        spacing_mm: f64,
    },
    /// Burr and shank reach nothing along any direction.
    #[error(
        "burr and shank reach no place at the target along any direction: bone outside the target or structures are in the way; see \
         shank, orientation.tilt_limit_deg and the target"
    )]
    NoApproach,
    /// The burr fits nowhere.
    #[error(
        "a burr of radius {radius_mm} mm finds no place at the target that is clear of bone outside it and keeps the clearances of the \
         structures"
    )]
    NoRoom {
        /// Its radius, mm.
        radius_mm: f64,
    },
    /// The given approach leads nowhere.
    #[error(
        "approach.direction {} faces bone: along it burr and shank reach {:.0} % of the burr's places at the target, along {} {:.0} %; \
         +x is the patient's right, +y anterior, +z superior, and the direction leads out of the bone",
        way_in::words(&given.direction), 100.0 * given.reached, way_in::words(&best.direction), 100.0 * best.reached
    )]
    FacesBone {
        /// The given direction.
        given: Way,
        /// The best one.
        best: Way,
    },
    /// A grid could not be made.
    #[error(transparent)]
    Grid(#[from] bonemill_geometry::GridError),
    /// Our own bug: values and grid differ.
    #[error(transparent)]
    Values(bonemill_geometry::VolumeError),
    /// A distance or an image step failed.
    #[error(transparent)]
    Image(#[from] bonemill_imaging::ImageError),
}

/// What helps where a map lies elsewhere.
fn elsewhere(is_nifti: bool) -> &'static str {
    if is_nifti {
        "Write the map anew on the CT's grid; if it does lie where its own header says, set images.labels_affine to \"sform\" or \"qform\""
    } else {
        "Write the map anew on the CT's grid, in 3D Slicer by exporting the segmentation with the CT as its reference volume"
    }
}

impl Scene {
    /// The frame in which θ and φ are measured: the grid's origin and approach, x and y by the basis of the approach.
    ///
    /// The grid itself follows the CT's voxels, so that a turned scan has the turned grid; a basis that depends on the
    /// approach alone cannot.
    pub fn ct_from_approach(&self) -> Rigid<Ct, Approach> {
        Rigid::new(basis::from_z(&self.approach), self.ct_from_work.translation_mm)
    }

    /// Voxels of the target.
    pub fn count(&self, flags: u8) -> usize {
        self.class.data().iter().filter(|c| c.is(flags)).count()
    }
}
