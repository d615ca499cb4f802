//! Why there is no plan.

use std::path::{Path, PathBuf};

use bonemill_arm::RobotError;
use bonemill_arm::registration::RegistrationFault;
use bonemill_imaging::{ImageError, NiftiProblem};
use bonemill_toolpath::scene::SceneError;
use nalgebra::{Unit, Vector3};
use thiserror::Error;

use super::ChannelFault;
use super::armpath::WHAT_TO_CHANGE;
use super::label_files::LabelFileFault;
use super::mesh_tool::MeshToolError;
use super::mount::MountFault;
use bonemill_case::{Case, LabelRef};
use bonemill_cutting::burr::ModelError;
use bonemill_planfile::PlanFileError;
use bonemill_robot::resolve::Meeting;

/// Why there is no path that the shank can reach.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Unreached {
    /// Nothing is left of it.
    #[error("the shank can reach no part of the target")]
    Nothing {
        /// What stands in the way most often, where that is known.
        mostly: Option<String>,
    },
    /// Some waypoints are still out of reach when the planner gives up.
    #[error(
        "after {rounds} rounds of leaving out what the shank cannot get to, {waypoints} waypoints are still out of its reach"
    )]
    Unsettled {
        /// How many.
        waypoints: usize,
        /// After how many rounds of dropping.
        rounds: usize,
    },
}

impl Unreached {
    /// What stands in the way most often, with what joins it to a sentence; empty where that is not known.
    fn mostly(&self) -> String {
        match self {
            Self::Nothing { mostly: Some(mostly) } => format!(" ({mostly})"),
            _ => String::new(),
        }
    }
}

/// Why a case cannot be planned.
#[derive(Debug, Error)]
pub enum PlanError {
    /// An image or its names cannot be read or trusted.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// No scene can be made of the images.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// An input cannot be hashed.
    #[error(transparent)]
    File(#[from] PlanFileError),
    /// The arm.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// A model's parameter is out of range.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// There is no channel as the case asks for it.
    #[error("{key}: {0}", key = .0.key())]
    Channel(#[from] ChannelFault),
    /// A mesh that is to be the cutter is none.
    #[error("mesh.stl: {}", path.display())]
    MeshTool {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: Box<MeshToolError>,
    },
    /// A label is named that the list of names does not have.
    #[error("{key}: {} has no {name:?}{} it has: {}", list.display(),
        nearest.as_ref().map_or(";".into(), |nearest| format!("; did you mean {nearest:?}?")), known.join(", "))]
    LabelName {
        /// The key in the case.
        key: String,
        /// The name.
        name: String,
        /// The label map, or the `labels.json` beside it.
        list: PathBuf,
        /// The names that there are.
        known: Vec<String>,
        /// The one that it resembles.
        nearest: Option<String>,
    },
    /// A file of its own gives no label.
    #[error("{what}: {} {fault}", path.display())]
    LabelFile {
        /// What it would be.
        what: String,
        /// The table of the case that names it.
        table: String,
        /// The file.
        path: PathBuf,
        /// Why not.
        fault: LabelFileFault,
    },
    /// A label is named, but there is no `labels.json`.
    #[error("{key}: the label {name:?} is a name, but there is no {}: give the label's number",
        beside.with_file_name("labels.json").display())]
    NoLabelNames {
        /// The key in the case.
        key: String,
        /// The name.
        name: String,
        /// The label map.
        beside: PathBuf,
    },
    /// Two structures, or a structure and the target, are one label, by number and by name.
    #[error("{first} and {second} are both label {number}: give each a label of its own")]
    SharedLabel {
        /// The one that stands first in the case.
        first: String,
        /// The other.
        second: String,
        /// The label.
        number: u16,
        /// Place of the other in the case's structures.
        place: usize,
    },
    /// The case uses an option that this version does not support.
    #[error("{key} = \"{value}\" is not supported by this version: expected {supported}")]
    Unsupported {
        /// The key.
        key: &'static str,
        /// What the case says.
        value: String,
        /// What it may say.
        supported: String,
    },
    /// The fiducials give no registration.
    #[error("robot.base_from_ct.fiducials: {0}")]
    Registration(#[from] RegistrationFault),
    /// Fiducials that cannot have been localised in this scan.
    #[error(
        "robot.base_from_ct.fiducials.ct_mm: fiducials {} of {count} lie outside the scan, by up to {farthest_mm:.1} mm; {}",
        outside.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "),
        if *fit_as_lps { "as LPS they would all lie inside: negate x and y" } else {
            "expected points in mm, RAS+, in the scan that is planned on (if that is a part of the scan that they were localised \
             in, plan on the whole one)" }
    )]
    FiducialsOutside {
        /// Which, from 1.
        outside: Vec<usize>,
        /// Fiducials in all.
        count: usize,
        /// The largest distance from the scan, mm.
        farthest_mm: f64,
        /// Whether negating x and y of all brings them inside.
        fit_as_lps: bool,
    },
    /// The case cannot be fulfilled, on a registration that is not good enough.
    #[error("{source}; {}", reasons.join("; "))]
    BadRegistration {
        /// What is wrong with the registration.
        reasons: Vec<String>,
        /// Why there is no plan.
        source: Box<PlanError>,
    },
    /// The chosen arm needs a key that the case does not have.
    #[error("{key} is needed for robot.model = \"{model}\": {example}")]
    Needed {
        /// The key.
        key: &'static str,
        /// The arm.
        model: String,
        /// What to write.
        example: &'static str,
    },
    /// The arm cannot hold the tool as the case says.
    #[error("robot.flange_from_burr: {0}")]
    Mount(#[from] MountFault),
    /// The arm stands too far from the target.
    #[error(
        "the arm cannot reach the target, which lies {nearest_mm:.0} mm and more from the arm's base: with this tool it reaches at most \
         {reach_mm:.0} mm; move it (robot.base_from_ct, whose lengths are mm)"
    )]
    TooFar {
        /// From the base to the target's nearest point, mm.
        nearest_mm: f64,
        /// The farthest that the burr can be from the base, mm.
        reach_mm: f64,
    },
    /// The arm reaches no place of the target.
    #[error(
        "the arm reaches none of {places} places of the target, {nearest_mm:.0} mm and more from its base, with the shaft along any of \
         {axes} directions within {tilt_limit_deg:.0}° of the approach{nearer}; move it (robot.base_from_ct)",
        nearer = .nearer_mm.map_or(String::new(), |mm| format!(": the nearest would have to be {mm:.0} mm nearer"))
    )]
    NoneReached {
        /// How many places were tried.
        places: usize,
        /// From the base to the nearest of them, mm.
        nearest_mm: f64,
        /// How much nearer it would have to be, mm; `None` where that does not help.
        nearer_mm: Option<f64>,
        /// Along how many directions of the shaft.
        axes: usize,
        /// The tilt limit, degrees.
        tilt_limit_deg: f64,
    },
    /// The target lies in the arm's base.
    #[error(
        "the target lies {away_mm:.0} mm from the arm's base, and within {base_mm} mm of it is the base itself; move it (robot.base_from_ct, \
         whose lengths are mm: a base given in metres looks like this)"
    )]
    TooNear {
        /// From the base to the target's middle, mm.
        away_mm: f64,
        /// How large the base is, mm.
        base_mm: f64,
    },
    /// The arm's base is in something.
    #[error(
        "the arm cannot stand where it does: {0}; move the base or the patient (robot.base_from_ct), or what stands there"
    )]
    BaseMeets(Meeting),
    /// No place can be searched for.
    #[error("where the arm may stand cannot be searched for: {reason}")]
    CannotStand {
        /// Why not, and what was expected.
        reason: String,
    },
    /// The cost uses the deflection, and the case gives no stiffness.
    #[error("cost.force = \"deflection\" needs robot.joint_stiffness: one value per joint, N/mm or N·mm/rad")]
    StiffnessMissing,
    /// No plan is possible along an approach that was chosen.
    #[error("{source}. {way}: give the direction")]
    AlongChosen {
        /// How it was chosen, with others.
        way: String,
        /// Why not.
        source: Box<PlanError>,
    },
    /// The burr reaches nothing of the target.
    #[error("a burr of radius {radius_mm} mm can reach no voxel of the target: {reason}")]
    NothingReachable {
        /// The burr, mm.
        radius_mm: f64,
        /// What keeps it out.
        reason: &'static str,
    },
    /// The shank reaches no waypoint, or not all that are left.
    #[error(
        "{why} within a tilt of {tilt_limit_deg:.0}° from the approach{}: see shank, approach.direction, \
         orientation.tilt_limit_deg, where the arm stands (robot.base_from_ct) and how it holds the handpiece (robot.flange_from_burr)",
        .why.mostly()
    )]
    NoAccess {
        /// What it does not reach.
        why: Unreached,
        /// The tilt limit, degrees.
        tilt_limit_deg: f64,
    },
    /// The arm cannot reach a waypoint.
    #[error("the arm cannot reach waypoint {waypoint}: {excess}; {}", .meets.then_some(WHAT_TO_CHANGE).unwrap_or("move it (robot.base_from_ct)"))]
    OutOfReach {
        /// The waypoint.
        waypoint: usize,
        /// The shaft's axis there, in work.
        axis: Unit<Vector3<f64>>,
        /// Which joint, by how much; or which link meets what.
        excess: String,
        /// Whether it is a link that meets something.
        meets: bool,
    },
}

impl PlanError {
    /// Whether the case is sound but cannot be fulfilled, rather than wrong.
    pub fn is_infeasible(&self) -> bool {
        match self {
            Self::Channel(fault) => fault.is_infeasible(),
            Self::AlongChosen { source, .. } => source.is_infeasible(),
            _ => {
                matches!(
                    self,
                    Self::OutOfReach { .. }
                        | Self::TooFar { .. }
                        | Self::NoneReached { .. }
                        | Self::TooNear { .. }
                        | Self::BaseMeets(_)
                        | Self::NoAccess { .. }
                        | Self::BadRegistration { .. }
                )
            }
        }
    }

    /// The key of the case that causes the error, as in [`Case::line_of`]; `None` where no single one is.
    ///
    /// `folder` is the case file's, to which the paths in the case are relative.
    pub fn key(&self, case: &Case, folder: &Path) -> Option<String> {
        let key = match self {
            Self::Image(error) => return image_key(error, case, folder),
            Self::Scene(error) => return scene_key(error, case, folder),
            Self::LabelName { name, .. } | Self::NoLabelNames { name, .. } => {
                return case.label_key(&LabelRef::Name(name.clone()));
            }
            Self::LabelFile { table, .. } => return Some(format!("{table}.file")),
            Self::SharedLabel { place, .. } => return Some(format!("structure[{place}].label")),
            Self::Unsupported { key, .. } => key,
            Self::StiffnessMissing => "cost.force",
            Self::Channel(fault) => fault.key(),
            Self::MeshTool { .. } => "mesh.stl",
            Self::Needed { .. } => "robot.model",
            Self::Registration(_) | Self::BadRegistration { .. } => "robot.base_from_ct",
            Self::FiducialsOutside { .. } => "robot.base_from_ct.fiducials.ct_mm",
            Self::NothingReachable { .. } => "target",
            Self::AlongChosen { source, .. } => return source.key(case, folder),
            Self::Mount(_) => "robot.flange_from_burr",
            Self::OutOfReach { .. }
            | Self::TooFar { .. }
            | Self::NoneReached { .. }
            | Self::BaseMeets(_)
            | Self::TooNear { .. } => "robot.base_from_ct",
            Self::Robot(RobotError::Calibration { .. }) => "robot.calibration",
            Self::Robot(
                RobotError::ReadUrdf { .. } | RobotError::ParseUrdf { .. } | RobotError::Urdf { .. },
            ) => "robot.model",
            Self::File(_)
            | Self::Robot(_)
            | Self::Model(_)
            | Self::NoAccess { .. }
            | Self::CannotStand { .. } => return None,
        };
        Some(key.into())
    }
}

fn image_key(error: &ImageError, case: &Case, folder: &Path) -> Option<String> {
    let key = match error {
        ImageError::NotHounsfield { .. } => "images.ct",
        ImageError::Nifti { path, problem } => {
            let is_choice = matches!(
                problem,
                NiftiProblem::Disagreement { .. }
                    | NiftiProblem::VoxelSizes { .. }
                    | NiftiProblem::TransformUnset { .. }
            );
            match (*path == folder.join(&case.images.ct), is_choice) {
                (false, false) if file_key(path, case, folder).is_some() => {
                    return file_key(path, case, folder);
                }
                (true, false) => "images.ct",
                (true, true) => "images.ct_affine",
                (false, false) => "images.labels",
                (false, true) => "images.labels_affine",
            }
        }
        ImageError::Foreign { path, .. }
        | ImageError::Format { path, .. }
        | ImageError::Dicom { path, .. }
            if *path == folder.join(&case.images.ct) =>
        {
            "images.ct"
        }
        ImageError::Foreign { path, .. }
        | ImageError::Format { path, .. }
        | ImageError::Dicom { path, .. } => {
            return file_key(path, case, folder).or(Some("images.labels".into()));
        }
        ImageError::LabelNames { .. } => "images.labels",
        ImageError::LabelAbsent { label, .. } => return case.label_key(&LabelRef::Number(*label)),
        _ => return None,
    };
    Some(key.into())
}

fn scene_key(error: &SceneError, case: &Case, folder: &Path) -> Option<String> {
    let key = match error {
        SceneError::LabelAbsent { what, .. } | SceneError::LabelOutside { what, .. }
            if what.starts_with("target.") =>
        {
            return Some(format!("{what}.label"));
        }
        SceneError::LabelOutside { what, .. } if what == "the target" => "target",
        SceneError::LabelAbsent { what, label, .. } | SceneError::LabelOutside { what, label, .. } => {
            // a label that the case names is known here by its number alone; the structure by its name
            let structure = case.structures.iter().position(|s| *what == format!("structure '{}'", s.name));
            return structure
                .map(|n| format!("structure[{n}].label"))
                .or_else(|| case.label_key(&LabelRef::Number(*label)))
                .or(Some("target.label".into()));
        }
        SceneError::LabelsDisplaced { is_nifti: true, .. } => "images.labels_affine",
        SceneError::NoOverlap { .. } | SceneError::LabelsDisplaced { .. } => "images.labels",
        SceneError::EmptyTarget(_)
        | SceneError::TargetGivesWay { .. }
        | SceneError::TargetOutside { .. }
        | SceneError::TargetTouches { .. } => "target",
        SceneError::TooLarge { .. } => "grid.spacing_mm",
        SceneError::NoApproach | SceneError::FacesBone { .. } => "approach.direction",
        SceneError::NoRoom { .. } => "burr.radius_mm",
        SceneError::Image(error) => return image_key(error, case, folder),
        SceneError::Grid(_) | SceneError::Values(_) => return None,
    };
    Some(key.into())
}

/// The key that names a file of labels.
fn file_key(path: &Path, case: &Case, folder: &Path) -> Option<String> {
    let named =
        case.labels().into_iter().find(|(_, label)| label.file().is_some_and(|f| folder.join(f) == path));
    named.filter(|_| path != folder.join(&case.images.labels)).map(|(table, _)| format!("{table}.file"))
}
