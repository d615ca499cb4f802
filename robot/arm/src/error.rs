//! Errors of arms, paths and exports; every variant says where the fault is and which value was found.

use std::path::PathBuf;

use thiserror::Error;

/// Errors of the robot's crates. A pose out of reach is not an error but a result: see [`crate::JointExcess`].
#[derive(Debug, Error)]
pub enum RobotError {
    /// The URDF file could not be read.
    #[error("cannot read the URDF {path}: {source}; check the path under [robot] model")]
    ReadUrdf {
        /// The requested file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The text is not a URDF.
    #[error("{source_name}: not a URDF: {source}")]
    ParseUrdf {
        /// File or arm name.
        source_name: String,
        /// The parser's reason.
        source: urdf_rs::UrdfError,
    },
    /// The URDF parses, but does not describe a serial arm that can be planned for.
    #[error("{source_name}: {fault}")]
    Urdf {
        /// File or arm name.
        source_name: String,
        /// What is wrong with it.
        fault: UrdfFault,
    },
    /// A UR calibration cannot be used.
    #[error("{source_name}: {fault}; see robot.calibration")]
    Calibration {
        /// File or arm name.
        source_name: String,
        /// What is wrong with it.
        fault: CalibrationFault,
    },
    /// No arm of this name comes with the program.
    #[error(
        "no arm is called {name:?}: expected {} or the path of a .urdf file",
        crate::arm::NAMES.join(", ")
    )]
    UnknownArm {
        /// The name.
        name: String,
    },
    /// A list that must hold one value per joint (or per waypoint) has another length.
    #[error("{what} has {got} values, expected {expected}")]
    Length {
        /// Which list.
        what: &'static str,
        /// Its length.
        got: usize,
        /// The length it must have.
        expected: usize,
    },
    /// A number is outside its range, or not finite.
    #[error("{what}[{index}] = {value} {unit}, expected {expected}")]
    Value {
        /// Which list or quantity.
        what: &'static str,
        /// Index in the list: joint, waypoint or 0.
        index: usize,
        /// The value found.
        value: f64,
        /// Its unit.
        unit: &'static str,
        /// What was expected.
        expected: &'static str,
    },
    /// G-code was requested for an arm that is not a Cartesian machine.
    #[error(
        "G-code is for machines with three linear axes and at most one rotary one behind them, not for these {joints} joints"
    )]
    NotCartesian {
        /// The arm's joints.
        joints: usize,
    },
    /// The path has no waypoints.
    #[error("the joint path has no waypoint; a time law needs at least one")]
    EmptyPath,
    /// The motion would have too many rows.
    #[error(
        "the motion takes {duration_s:.3e} s, which at {rate_hz} Hz is more than {most_rows:.0e} rows: are the joints' or the \
         speeds' limits meant so small?"
    )]
    TooLong {
        /// Its duration, s.
        duration_s: f64,
        /// Rows per second.
        rate_hz: f64,
        /// Largest number of rows.
        most_rows: f64,
    },
    /// A trajectory could not be written.
    #[error("cannot write the trajectory after {rows_written} rows: {source}")]
    Write {
        /// Complete rows that were passed to the writer before.
        rows_written: u64,
        /// The system's reason.
        source: std::io::Error,
    },
}

/// Why a file cannot be used as the calibration of a UR arm.
#[derive(Debug, Error)]
pub enum CalibrationFault {
    /// The file cannot be read.
    #[error("cannot read the calibration: {0}")]
    Read(std::io::Error),
    /// The file is not YAML.
    #[error("not a YAML file: {0}")]
    Syntax(String),
    /// The YAML is not a calibration.
    #[error(
        "no calibration: expected delta_theta, delta_a, delta_d and delta_alpha (six numbers each), or kinematics with \
         shoulder, upper_arm, forearm, wrist_1, wrist_2, wrist_3"
    )]
    Unknown,
    /// A key is missing.
    #[error("{key} is missing")]
    Missing {
        /// The key.
        key: String,
    },
    /// A value is not a finite number.
    #[error("{key} is not a finite number")]
    Number {
        /// The key.
        key: String,
    },
    /// The calibrated arm is not near the requested model.
    #[error(
        "the flange would be {worst_mm:.1} mm from where a nominal {model} has it, at most {most_mm} mm are taken for a \
         calibration: does the file belong to another model?"
    )]
    OtherModel {
        /// The model asked for.
        model: &'static str,
        /// Greatest distance found, mm.
        worst_mm: f64,
        /// Greatest distance allowed, mm.
        most_mm: f64,
    },
    /// The calibrated flange is turned too far from the nominal one.
    #[error(
        "the flange would be turned by {worst_rad:.3} rad from where a nominal {model} has it, at most {most_rad} rad are \
         taken for a calibration: are angles in degrees, or does the file belong to another model?"
    )]
    Turned {
        /// The model asked for.
        model: &'static str,
        /// Greatest angle found, rad.
        worst_rad: f64,
        /// Greatest angle allowed, rad.
        most_rad: f64,
    },
}

/// Why a URDF does not describe a serial arm that can be planned for.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum UrdfFault {
    /// Two links or two joints share a name.
    #[error("two {kind}s are called {name:?}; names must be unique")]
    DuplicateName {
        /// "link" or "joint".
        kind: &'static str,
        /// The name.
        name: String,
    },
    /// A joint names a link that does not exist.
    #[error("joint {joint:?} hangs at link {link:?}, which is not declared; add <link name={link:?}/>")]
    UnknownLink {
        /// The joint.
        joint: String,
        /// The missing link.
        link: String,
    },
    /// A link is the child of two joints.
    #[error(
        "link {link:?} is the child of joints {first:?} and {second:?}; a tree gives each link one parent"
    )]
    TwoParents {
        /// The link.
        link: String,
        /// One parent joint.
        first: String,
        /// The other.
        second: String,
    },
    /// The joints form a loop.
    #[error("link {link:?} is part of a closed loop of joints; only open chains are supported")]
    Cycle {
        /// A link of the loop.
        link: String,
    },
    /// There is no root link, or more than one.
    #[error("expected one root link, found {}: {roots:?}; join every link to the tree", roots.len())]
    Roots {
        /// The links that are not the child of any joint.
        roots: Vec<String>,
    },
    /// There is more than one link without a child, so the arm's tip is ambiguous.
    #[error("expected one tip link, found {}: {tips:?}; remove the others or call the flange `tool0`", tips.len())]
    Tips {
        /// The links without a child.
        tips: Vec<String>,
    },
    /// `base_link` is not an ancestor of the tip.
    #[error("the tip {tip:?} does not hang at base_link; the arm must lead from base_link to its tip")]
    TipNotOnBase {
        /// The tip link.
        tip: String,
    },
    /// A joint moves that is not between base and tip.
    #[error("joint {joint:?} moves but does not lie between {base:?} and the tip {tip:?}; make it fixed")]
    MovesOffChain {
        /// The joint.
        joint: String,
        /// The base link.
        base: String,
        /// The tip link.
        tip: String,
    },
    /// No joint between base and tip moves.
    #[error(
        "no joint between {base:?} and the tip {tip:?} moves; expected at least one prismatic or revolute joint"
    )]
    NoMovingJoint {
        /// The base link.
        base: String,
        /// The tip link.
        tip: String,
    },
    /// A joint has a type that is not supported.
    #[error(
        "joint {joint:?} is of type {joint_type}; supported are prismatic, revolute, continuous and fixed"
    )]
    JointType {
        /// The joint.
        joint: String,
        /// Its type.
        joint_type: String,
    },
    /// A joint follows another one.
    #[error(
        "joint {joint:?} mimics {leader:?}; coupled joints are not supported, every joint must move on its own"
    )]
    Mimic {
        /// The joint.
        joint: String,
        /// The joint that it follows.
        leader: String,
    },
    /// A number is NaN or infinite.
    #[error("joint {joint:?}: {field} = {value} is not a finite number")]
    NotFinite {
        /// The joint.
        joint: String,
        /// Attribute and unit.
        field: &'static str,
        /// The value.
        value: f64,
    },
    /// The axis has length 0 or is not finite.
    #[error("joint {joint:?}: axis {axis:?} has no direction; expected a vector of length 1")]
    Axis {
        /// The joint.
        joint: String,
        /// The axis as given.
        axis: [f64; 3],
    },
    /// The joint's range is empty; a missing `<limit>` is read as an empty range.
    #[error(
        "joint {joint:?}: limits {lower}..{upper} {unit} are no range, expected lower < upper; is its <limit> missing?"
    )]
    Range {
        /// The joint.
        joint: String,
        /// As given, m or rad.
        lower: f64,
        /// As given, m or rad.
        upper: f64,
        /// "m" or "rad".
        unit: &'static str,
    },
    /// The velocity limit is absent, zero or negative.
    #[error("joint {joint:?}: velocity limit {velocity} {unit}, expected above 0; is it missing in <limit>?")]
    Velocity {
        /// The joint.
        joint: String,
        /// As given.
        velocity: f64,
        /// "m/s" or "rad/s".
        unit: &'static str,
    },
    /// A limit is implausible; most often it is in another unit.
    #[error(
        "joint {joint:?}: limit {field} = {value} {unit}, expected {least} to {most} {unit}; URDF is in m, rad and s"
    )]
    Limit {
        /// The joint.
        joint: String,
        /// The attribute of `<limit>`.
        field: &'static str,
        /// As given.
        value: f64,
        /// The attribute's unit.
        unit: &'static str,
        /// The smallest accepted value.
        least: f64,
        /// The largest accepted value.
        most: f64,
    },
    /// The lengths are in another unit.
    #[error(
        "half of the joints between {base:?} and the tip {tip:?} are {offset:.0} m or more from the one before, expected at most \
         {most} m: this looks like millimetres; URDF lengths are metres"
    )]
    Millimetres {
        /// The base link.
        base: String,
        /// The tip link.
        tip: String,
        /// The median of the origins' lengths as the file gives them, metres.
        offset: f64,
        /// The largest accepted value, metres.
        most: f64,
    },
    /// The text is not well-formed XML.
    #[error("not a URDF: no well-formed XML up to byte {byte}: {why}")]
    Xml {
        /// Byte at which reading stopped.
        byte: u64,
        /// The reader's reason.
        why: String,
    },
    /// A name has a prefix that the root element does not declare, or a namespace is declared below the root.
    #[error(
        "{name:?} in the tag that ends at byte {byte}: expected a name without a prefix, or one that the robot's own tag declares"
    )]
    Namespace {
        /// Element or attribute.
        name: String,
        /// Where its tag ends.
        byte: u64,
    },
    /// An attribute of `<limit>` is not a number.
    #[error("joint {joint:?}: limit {field} = {text:?}, expected a number")]
    LimitText {
        /// The joint.
        joint: String,
        /// The attribute of `<limit>`.
        field: &'static str,
        /// As given.
        text: String,
    },
}
