//! The case: one patient, one tool, one robot, as validated values.
//!
//! Text becomes a [`Case`] in [`Case::parse`]; every number in it is finite and in range, so that inner code need not ask
//! again. The file's keys, defaults and their sources are those of the case file's documentation. Reading files is not
//! done here.

mod accuracy;
pub mod draft;
mod edit;
mod error;
mod explain;
mod given;
mod hold;
mod job;
#[macro_use]
mod keys;
mod label;
mod parse;
mod parse_channel;
mod parse_label;
mod parse_robot;
mod parse_tool;
pub mod prosthesis;
mod rank;
mod reference;
mod relations;
mod room;
mod suggest;
#[cfg(test)]
mod tests;
mod tool;
mod walker;
pub mod write;
mod write_channel;

use std::path::{Path, PathBuf};

use bonemill_arm::ur::{Branches, UrModel};
use bonemill_imaging::{AffineChoice, DensityTable};
use nalgebra::{Rotation3, Vector3};

pub use accuracy::{Accuracy, AskedErrors, Level};
pub use bonemill_cutting::burr::Measure;
pub use bonemill_cutting::cost::SeveralStructures;
pub use bonemill_cutting::speed::DistanceCurve;
pub use bonemill_geometry::Sheets;
pub use edit::with_values;
pub use error::{CaseError, CaseFault, Located};
pub use explain::{Origin, Parameter, explained, explained_job};
pub use given::Given;
pub use hold::Hold;
pub use job::{ChannelDirection, ChannelEnd, ChannelSpec, Entry, FeedSpec, Job, Pattern};
pub use keys::{DEFAULT_BONE_HU, Unit};
pub use label::LabelRef;
pub use parse::syntax;
pub use parse_robot::rotation_from_matrix;
pub use reference::reference;
pub use room::{HeadSource, Obstacle, ObstacleFrame, ObstacleShape, RoomSpec};
pub use suggest::nearest;
pub use tool::{EdgeMaterial, EdgeModel, MeshTool, Spindle, ToolSpec};
pub use walker::{as_number, line_at};

/// One patient, one tool and one robot; resolved and validated.
#[derive(Debug, Clone, PartialEq)]
pub struct Case {
    /// Whether `preset = "paper"` chose the defaults.
    pub paper: bool,
    /// Which images.
    pub images: Images,
    /// Hounsfield units to density, and what counts as air and bone.
    pub density: Density,
    /// The kind of work.
    pub job: Job,
    /// The bone to be removed.
    pub target: Target,
    /// What belongs to the target besides.
    pub also: Vec<TargetRegion>,
    /// What is taken away from it.
    pub less: Vec<TargetRegion>,
    /// Whether thin bone outside the target is kept.
    pub sheets: Sheets,
    /// The least share of it that must be removed, 0..1.
    pub least_share: f64,
    /// What must not be touched.
    pub structures: Vec<Structure>,
    /// What stands around the arm.
    pub obstacles: Vec<Obstacle>,
    /// Where the arm holds for the user.
    pub holds: Vec<Hold>,
    /// Approach direction in ct, unit, out of the bone; `None`: the direction along which burr and shank reach most of the target.
    pub approach: Option<Vector3<f64>>,
    /// What cuts.
    pub tool: ToolSpec,
    /// The burr, where the tool is one.
    pub burr: Burr,
    /// The shank, from the burr outwards.
    pub shank: Vec<ShankSegment>,
    /// Cutting coefficients of a burr, and how force follows density.
    pub material: MaterialSpec,
    /// Cutting coefficients of the edges of other tools.
    pub edge_material: EdgeMaterial,
    /// How the path is laid.
    pub path: PathSpec,
    /// Weights of the orientation cost.
    pub cost: CostSpec,
    /// How the shaft is oriented.
    pub orientation: OrientationSpec,
    /// Speed range and law.
    pub speed: SpeedSpec,
    /// The arm and where the patient is.
    pub robot: RobotSpec,
    /// How well the patient must be registered.
    pub registration: RegistrationSpec,
    /// The planning grid.
    pub grid: GridSpec,
    /// How finely forces and directions are computed.
    pub accuracy: Accuracy,
    /// Which keys the file gave.
    pub given: Given,
}

/// `[images]`: paths relative to the case file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Images {
    /// The CT.
    pub ct: PathBuf,
    /// The label map.
    pub labels: PathBuf,
    /// Name of the CT in a folder with several DICOM series, by [`bonemill_imaging::series_name`].
    pub ct_series: Option<String>,
    /// Which affine to take from the CT.
    pub ct_affine: AffineChoice,
    /// Which affine to take from the label map.
    pub labels_affine: AffineChoice,
}

/// `[density]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Density {
    /// HU to g/cm³, piecewise linear.
    pub table: DensityTable,
    /// At or below: air, nothing to cut, HU.
    pub air_hu: f64,
    /// At or above: bone, which burr and shank may not touch outside the target, HU.
    pub bone_hu: f64,
}

impl Case {
    /// Clearance of each structure, mm.
    pub fn clearances_mm(&self) -> Vec<f64> {
        self.structures.iter().map(|s| s.clearance_mm).collect()
    }
}

/// `[[structure]]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Structure {
    /// Its name in reports.
    pub name: String,
    /// Its label.
    pub label: LabelRef,
    /// Least distance of the burr's surface, mm.
    pub clearance_mm: f64,
    /// 1 is the most important.
    pub priority: u32,
    /// Least distance of the shank's surface, mm.
    pub shank_clearance_mm: f64,
}

/// `[burr]`: a fluted ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Burr {
    /// Radius, mm.
    pub radius_mm: f64,
    /// Number of identical flutes.
    pub flutes: u32,
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
    /// −1 forward (clockwise seen from the handpiece), +1 reverse.
    pub spin: i8,
    /// Whether it may turn the other way instead: then the planner chooses [`Self::spin`].
    pub turns_both_ways: bool,
    /// Radius of the neck where the flutes end, mm.
    pub neck_radius_mm: f64,
}

/// One cylinder of the shank; the first starts at the burr's radius along the axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShankSegment {
    /// Length along the axis, mm.
    pub length_mm: f64,
    /// Radius, mm.
    pub radius_mm: f64,
}

/// What is to be removed, a label by its name or number.
pub type Target<L = LabelRef> = bonemill_geometry::Target<L>;

/// A region that is added to the target or taken away from it.
pub type TargetRegion<L = LabelRef> = bonemill_geometry::TargetRegion<L>;

/// `[material]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MaterialSpec {
    /// Tangential, radial, axial specific cutting energy, N/mm².
    pub k_n_mm2: [f64; 3],
    /// Tangential, radial, axial edge coefficients, N/mm.
    pub k_edge_n_mm: [f64; 3],
    /// Density at which `k_n_mm2` holds, g/cm³.
    pub rho_ref_g_cm3: f64,
    /// Exponent of density.
    pub exponent: f64,
    /// Length element.
    pub measure: Measure,
    /// Chip thickness at which the edge term saturates, mm; 0: at once.
    pub t0_mm: f64,
}

/// `[path]`: a lawnmower.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSpec {
    /// Depth of a layer, mm.
    pub layer_mm: f64,
    /// Distance of neighbouring lines, mm.
    pub stepover_mm: f64,
    /// Distance of neighbouring waypoints, mm.
    pub step_mm: f64,
    /// Direction of the lines from work x towards work y; `None`: chosen.
    pub raster_rad: Option<f64>,
    /// In which sense the passes are cut.
    pub sense: Sense,
}

/// In which sense a pass is cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sense {
    /// [`Self::Both`] or [`Self::Away`], whichever gives smaller forces toward structures in the same time.
    Auto,
    /// From whichever end is nearer.
    Both,
    /// The teeth move against the feed in the bone beside the pass.
    Climb,
    /// They move with it.
    Conventional,
    /// Near a structure in the sense that pushes less toward it.
    Away,
}

impl Sense {
    /// The word in the case file.
    pub fn word(self) -> &'static str {
        keys::SENSE.word(self)
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Auto => "chosen",
            Self::Both => "cut to and fro",
            Self::Climb => "cut in one sense, climb",
            Self::Conventional => "cut in one sense, conventional",
            Self::Away => "cut, near structures, in the sense that pushes less toward them",
        }
    }
}

/// Which force the cost looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ForceTerm {
    /// D6: the cutting force's direction.
    Cutting,
    /// D12: the deflection's direction under the arm's compliance.
    Deflection,
}

/// What the choice of axes minimises.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Objective {
    /// The time under levels of force: the lowest levels whose fastest sequence fits the total time.
    Levels,
    /// D's cost C.
    Dillon,
}

/// `[cost]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostSpec {
    /// Decay of α₁ with distance, 1/mm.
    pub kappa_per_mm: f64,
    /// α₁ at the clearance, 0..1.
    pub alpha_max: f64,
    /// Which force.
    pub force: ForceTerm,
    /// What the choice of axes minimises.
    pub objective: Objective,
    /// Which structures, where several are near.
    pub structures: SeveralStructures,
}

/// How the shaft's axis is chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrientationMode {
    /// Dynamic programming over the whole sequence.
    Optimal,
    /// Each waypoint alone, then a low-pass (D II-D, II-G).
    Greedy,
    /// Along the approach, or as near as the arm can.
    Fixed,
}

/// `[orientation]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrientationSpec {
    /// How.
    pub mode: OrientationMode,
    /// Tilt angles: 1 or 2.
    pub angles: u32,
    /// Largest angle from the approach while cutting, rad.
    pub tilt_limit_rad: f64,
}

/// How speed follows the bone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SpeedMode {
    /// D13: inverse to the mass ahead.
    Mass,
    /// The nominal speed.
    Constant,
    /// Fastest under force caps.
    ForceLimited,
    /// Least force within a time, toward structures first.
    LeastForce,
}

impl SpeedMode {
    /// Whether speeds keep caps on force, deflection and power, and the acceleration along the path.
    pub fn keeps_caps(self) -> bool {
        matches!(self, Self::ForceLimited | Self::LeastForce)
    }
}

/// Caps of `force_limited` and `least_force`; absent ones do not bind.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedCaps {
    /// Largest force, N.
    pub force_n: Option<f64>,
    /// Largest force toward a structure, N, by the distance from the burr's surface to it, mm.
    pub force_toward_n: Option<DistanceCurve>,
    /// Largest deflection, µm.
    pub deflection_um: Option<f64>,
    /// Largest spindle power, W.
    pub power_w: Option<f64>,
    /// Largest acceleration along the path, mm/s².
    pub acceleration_mm_s2: f64,
}

impl SpeedCaps {
    /// The caps on force, deflection and power that are given, each as its key and figure.
    pub fn words(&self) -> Vec<String> {
        let toward = self.force_toward_n.as_ref().map(|curve| curve.points());
        let one =
            |key: &str, cap: Option<f64>, unit: &str| cap.map(|cap| format!("speed.{key} = {cap} {unit}"));
        let toward = toward.map(|points| {
            let points: Vec<String> = points.iter().map(|[mm, n]| format!("{n} N at {mm} mm")).collect();
            format!("speed.force_toward_n = {}", points.join(", "))
        });
        [
            one("force_n", self.force_n, "N"),
            toward,
            one("deflection_um", self.deflection_um, "µm"),
            one("power_w", self.power_w, "W"),
        ]
        .into_iter()
        .flatten()
        .collect()
    }
}

/// `[speed]`.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedSpec {
    /// How.
    pub mode: SpeedMode,
    /// Slowest cut, mm/s.
    pub min_mm_s: f64,
    /// Fastest cut, mm/s.
    pub max_mm_s: f64,
    /// Speed of `constant`, and at which forces are compared, mm/s.
    pub nominal_mm_s: f64,
    /// Speed in free space, mm/s.
    pub link_mm_s: f64,
    /// Time of the whole plan, s, when it is to be met.
    pub total_time_s: Option<f64>,
    /// Share by which the least level of |F| may be exceeded for lower forces toward structures.
    pub force_room: f64,
    /// Of `force_limited` and `least_force`.
    pub caps: SpeedCaps,
}

/// Where the patient is, seen from the arm.
#[derive(Debug, Clone, PartialEq)]
pub enum Registration {
    /// p_base = R p_ct + t.
    Given {
        /// R.
        rotation: Rotation3<f64>,
        /// t, mm.
        translation_mm: Vector3<f64>,
    },
    /// Fitted to points given in both frames, in pairs, mm.
    Fiducials {
        /// In ct.
        ct_mm: Vec<[f64; 3]>,
        /// In base.
        base_mm: Vec<[f64; 3]>,
    },
    /// None in the case: base x, y, z along work y, −x, z, so that the bone-attached arm tilts in the work y–z plane; the
    /// target's centre at its base's origin, or before a UR's base. Stated in the plan.
    Assumed,
}

/// `[robot]`.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotSpec {
    /// One of [`bonemill_arm::arm::NAMES`], or a URDF's path.
    pub model: String,
    /// A UR's calibration file, relative to the case.
    pub calibration: Option<PathBuf>,
    /// The branches of a UR's inverse that may be taken; `None`: all.
    pub branch: Option<Branches>,
    /// Registration of the patient.
    pub base_from_ct: Registration,
    /// Burr's centre and axis in the flange: translation mm, fixed-axis roll, pitch, yaw rad.
    pub flange_from_burr: Option<([f64; 3], [f64; 3])>,
    /// N/mm for prismatic joints, N·mm/rad for revolute ones.
    pub joint_stiffness: Option<Vec<f64>>,
    /// mm/s or rad/s; the stricter of this and the URDF's holds.
    pub velocity_limits: Option<Vec<f64>>,
    /// mm/s² or rad/s².
    pub acceleration_limits: Option<Vec<f64>>,
    /// mm/s³ or rad/s³.
    pub jerk_limits: Option<Vec<f64>>,
    /// How its links keep away from what is around them.
    pub room: RoomSpec,
    /// Sampling rate of the trajectory, Hz.
    pub rate_hz: f64,
}

/// `[registration]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RegistrationSpec {
    /// Largest RMS residual of the fiducials (FRE), mm.
    pub max_fre_mm: f64,
}

impl RobotSpec {
    /// Keys and paths of the files that describe the arm.
    pub fn files(&self) -> impl Iterator<Item = (&'static str, &Path)> {
        let is_named = self.model == parse::BONE_ATTACHED || UrModel::by_name(&self.model).is_some();
        let urdf = (!is_named).then(|| ("robot.model", Path::new(&self.model)));
        urdf.into_iter().chain(self.calibration.as_deref().map(|path| ("robot.calibration", path)))
    }
}

/// `[grid]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridSpec {
    /// Voxel of the planning grid, mm.
    pub spacing_mm: f64,
    /// Bone kept around the target beside the tool's own reach, mm.
    pub margin_mm: f64,
}
