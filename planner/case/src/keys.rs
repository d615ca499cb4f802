//! The case file's keys: unit, plausible range, default, meaning and where the default comes from.
//!
//! One table for three users, so that they cannot differ: the parser takes defaults and ranges from it, the writer
//! takes its words from it, and the documentation is generated from it.

use std::fmt;

use bonemill_imaging::AffineChoice;

use super::{ForceTerm, Measure, Objective, OrientationMode, Pattern, Sense, SeveralStructures, SpeedMode};
use crate::{Level, Sheets};

/// Unit of a number in the case file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// Dimensionless or a count.
    One,
    /// A part of a whole.
    Share,
    /// Length.
    Mm,
    /// Speed.
    MmS,
    /// Angle in the file; rad inside.
    Deg,
    /// Angle.
    Rad,
    /// Spindle speed.
    Rpm,
    /// Feed.
    MmMin,
    /// Time.
    Min,
    /// Rate.
    Hz,
    /// Time.
    S,
    /// Density.
    GCm3,
    /// Specific cutting energy.
    NMm2,
    /// Edge force per length.
    NMm,
    /// Force.
    N,
    /// Small length.
    Um,
    /// Power.
    W,
    /// Acceleration.
    MmS2,
    /// Decay with distance.
    PerMm,
    /// CT number.
    Hu,
    /// Of a prismatic or a revolute joint.
    JointSpeed,
    /// Of a prismatic or a revolute joint.
    JointAcceleration,
    /// Of a prismatic or a revolute joint.
    JointJerk,
    /// Of a prismatic or a revolute joint.
    JointStiffness,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Unit::One | Unit::Share => "1",
            Unit::Mm => "mm",
            Unit::MmS => "mm/s",
            Unit::Deg => "degrees",
            Unit::Rad => "rad",
            Unit::Rpm => "rpm",
            Unit::MmMin => "mm/min",
            Unit::Min => "min",
            Unit::Hz => "Hz",
            Unit::S => "s",
            Unit::GCm3 => "g/cm³",
            Unit::NMm2 => "N/mm²",
            Unit::NMm => "N/mm",
            Unit::N => "N",
            Unit::Um => "µm",
            Unit::W => "W",
            Unit::MmS2 => "mm/s²",
            Unit::PerMm => "1/mm",
            Unit::Hu => "HU",
            Unit::JointSpeed => "mm/s or rad/s",
            Unit::JointAcceleration => "mm/s² or rad/s²",
            Unit::JointJerk => "mm/s³ or rad/s³",
            Unit::JointStiffness => "N/mm or N·mm/rad",
        })
    }
}

impl Unit {
    /// Whether a number in it is written without a unit.
    pub(super) fn is_none(self) -> bool {
        matches!(self, Unit::One | Unit::Share)
    }

    /// The unit after "a number": nothing where there is none.
    pub(super) fn after(self) -> String {
        if self.is_none() { String::new() } else { format!(" in {self}") }
    }

    /// Units in which the number may have been meant: (name, factor to ours).
    pub(super) fn lookalikes(self) -> &'static [(&'static str, f64)] {
        match self {
            Unit::Mm => &[("metres", 1e3), ("µm", 1e-3), ("cm", 10.0)],
            Unit::MmS => &[("m/s", 1e3), ("µm/s", 1e-3)],
            Unit::MmMin => &[("m/min", 1e3), ("mm/s", 60.0)],
            Unit::Min => &[("seconds", 1.0 / 60.0), ("hours", 60.0)],
            Unit::Rpm => &[("thousands of rpm", 1e3), ("revolutions per second", 60.0)],
            Unit::GCm3 => &[("kg/m³", 1e-3)],
            Unit::NMm2 => &[("Pa", 1e-6), ("GPa", 1e3)],
            Unit::N => &[("mN", 1e-3), ("kN", 1e3)],
            Unit::Um => &[("mm", 1e3), ("m", 1e6)],
            Unit::W => &[("mW", 1e-3), ("kW", 1e3)],
            Unit::Hz => &[("kHz", 1e3)],
            Unit::Rad => &[("degrees", std::f64::consts::PI / 180.0)],
            Unit::Deg => &[("radians", 180.0 / std::f64::consts::PI)],
            Unit::Share => &[("per cent", 1e-2)],
            _ => &[],
        }
    }
}

/// What is used when a key is absent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fallback {
    /// This number.
    Value(f64),
    /// What these words say: a list, absent or required.
    Words(&'static str),
    /// What follows from other keys by this rule.
    Derived(&'static str),
    /// What is chosen while planning by this rule.
    Chosen(&'static str),
}

/// A number, or a list of numbers that all obey the same range.
#[derive(Debug, Clone, Copy)]
pub struct Number {
    /// Full path.
    pub path: &'static str,
    /// Unit.
    pub unit: Unit,
    /// Least plausible value, included.
    pub min: f64,
    /// Largest plausible value, included.
    pub max: f64,
    /// When absent.
    pub default: Fallback,
    /// What it is.
    pub meaning: &'static str,
    /// Where the default comes from.
    pub source: &'static str,
}

/// One of several words.
#[derive(Debug, Clone, Copy)]
pub struct Choice<T: 'static> {
    /// Full path.
    pub path: &'static str,
    /// The words and what they stand for; the first is the default.
    pub options: &'static [(&'static str, T)],
    /// What it is.
    pub meaning: &'static str,
    /// Where the default comes from.
    pub source: &'static str,
}

impl<T: Copy + PartialEq> Choice<T> {
    /// The word for a value.
    pub(super) fn word(&self, value: T) -> &'static str {
        self.options.iter().find(|(_, v)| *v == value).map_or("", |(word, _)| word)
    }

    /// All words.
    pub(super) fn words(&self) -> Vec<&'static str> {
        self.options.iter().map(|(word, _)| *word).collect()
    }
}

/// A key that is neither a number nor a choice.
#[derive(Debug, Clone, Copy)]
pub struct Other {
    /// Full path.
    pub path: &'static str,
    /// What it holds.
    pub expects: &'static str,
    /// When absent, in words.
    pub default: &'static str,
    /// What it is.
    pub meaning: &'static str,
    /// Where the default comes from.
    pub source: &'static str,
}

/// The last part of a key's path.
pub(super) fn name_of(path: &'static str) -> &'static str {
    path.rsplit('.').next().unwrap_or(path)
}

/// Default of `density.bone_hu`, HU.
pub const DEFAULT_BONE_HU: f64 = 200.0;

use Fallback::{Chosen, Derived, Value, Words};

/// Keys whose default `preset = "paper"` changes.
pub(super) const PRESET_KEYS: [&str; 6] =
    ["material.measure", "cost.alpha_max", "orientation.mode", "path.sense", "speed.mode", "cost.objective"];

/// Keys of earlier versions, and what stands in their place.
const RENAMED: [(&str, &str); 1] = [("cost.toward", "cost.objective")];

/// The key that replaces one of an earlier version.
pub(super) fn renamed(path: &str) -> Option<String> {
    RENAMED.iter().find(|(old, _)| *old == path).map(|(_, new)| (*new).to_owned())
}

const REQUIRED: &str = "required";
const ABSENT: &str = "none";
const ASSUMED: &str = "assumed";

macro_rules! table {
    (
        numbers { $($n:ident = $np:literal $nunit:ident $min:literal..$max:literal, $nd:expr, $nm:literal, $ns:expr;)* }
        choices { $($c:ident: $t:ty = $cp:literal [$($word:literal => $v:expr),+], $cm:literal, $cs:expr;)* }
        others { $($o:ident = $op:literal $oe:literal, $od:expr, $om:literal, $os:expr;)* }
    ) => {
        $(pub(crate) const $n: Number = Number {
            path: $np, unit: Unit::$nunit, min: $min, max: $max, default: $nd, meaning: $nm, source: $ns };)*
        $(pub(crate) const $c: Choice<$t> =
            Choice { path: $cp, options: &[$(($word, $v)),+], meaning: $cm, source: $cs };)*
        $(pub(crate) const $o: Other =
            Other { path: $op, expects: $oe, default: $od, meaning: $om, source: $os };)*

        /// The keys of this part, for the documentation: in the order numbers, choices, others.
        pub(crate) fn entries() -> Vec<Entry> {
            vec![$(Entry::from(&$n),)* $(Entry::from(&$c),)* $(Entry::from(&$o),)*]
        }
    };
}

table! {
    numbers {
        AIR_HU = "density.air_hu" Hu -1e5..1e5, Value(-700.0),
            "at or below: air, nothing to cut", "assumed: half-way between the first two points of the table";
        BONE_HU = "density.bone_hu" Hu -1e5..1e5, Value(DEFAULT_BONE_HU),
            "at or above: bone, which burr and shank may not touch outside the target (see target.sheets)", ASSUMED;
        TABLE_HU = "density.hu" Hu -1e5..1e5, Words("[-1000, -400, -150, 100, 300, 2000, 4927]"),
            "points of the calibration curve, increasing", "assumed: no calibration phantom was scanned; give your scanner's own curve";
        TABLE_G_CM3 = "density.g_cm3" GCm3 0.0..25.0, Words("[0.01, 0.602, 0.924, 1.075, 1.145, 1.856, 3.379]"),
            "density at those points; linear between, constant outside", "as density.hu";
        BOX_MIN = "target.box.min_mm" Mm -1e4..1e4, Words(REQUIRED), "lower corner, ct", "-";
        BOX_MAX = "target.box.max_mm" Mm -1e4..1e4, Words(REQUIRED), "upper corner, ct", "-";
        BALL_CENTER = "target.ball.center_mm" Mm -1e4..1e4, Words(REQUIRED), "centre, ct", "-";
        BALL_RADIUS = "target.ball.radius_mm" Mm 0.5..200.0, Words(REQUIRED), "radius", "-";
        FRUSTUM_FROM = "target.frustum.from_mm" Mm -1e4..1e4, Words(REQUIRED), "centre of the first end, ct", "-";
        FRUSTUM_TO = "target.frustum.to_mm" Mm -1e4..1e4, Words(REQUIRED), "centre of the second end, ct", "-";
        FRUSTUM_FROM_RADIUS = "target.frustum.from_radius_mm" Mm 0.0..200.0, Words(REQUIRED), "radius at the first end", "-";
        FRUSTUM_TO_RADIUS = "target.frustum.to_radius_mm" Mm 0.0..200.0, Words(REQUIRED), "radius at the second end", "-";
        LEAST_SHARE = "target.least_share" Share 0.0..1.0, Value(0.9),
            "least share of the target's mm³ to be removed, air cells included and what lies beyond the scan counted as not removed; below it the plan falls short", ASSUMED;
        REGION_MARGIN = "target.less.margin_mm" Mm 0.0..50.0, Value(0.0),
            "by how much the label or shape is larger, here and in also: a label in every direction; a box by its sides, a ball by its radius, a frustum by its ends and radii", "-";
        CLEARANCE = "structure.clearance_mm" Mm 0.0..50.0, Value(1.0),
            "least distance of the burr's surface from the structure", "assumed (docs/force-model.md 10: r_v,min = r + 1 mm)";
        PRIORITY = "structure.priority" One 1.0..1e6, Derived("its place in the file"), "1 is the most important", "-";
        SHANK_CLEARANCE = "structure.shank_clearance_mm" Mm 0.0..50.0, Value(0.0),
            "least distance of the shank's surface from the structure", "D: the shank must not touch";
        HOLD_DISTANCE = "hold.distance_mm" Mm 0.0..8.0, Words(REQUIRED),
            "distance of the burr's surface from the structure, at least its clearance_mm; a streamed plan stops before the first move that comes nearer", "-";
        DIRECTION = "approach.direction" One -1e6..1e6, Chosen("the direction along which burr and shank reach most of the target"),
            "ct, out of the bone; any length but zero", "the one used stands in plan.toml";
        RADIUS = "burr.radius_mm" Mm 0.2..10.0, Value(2.5), "radius (not diameter) of the ball", "assumed: 5 mm burr (docs/force-model.md 10)";
        FLUTES = "burr.flutes" One 1.0..64.0, Value(8.0), "identical flutes", "assumed (docs/force-model.md 10)";
        RPM = "burr.spindle_rpm" Rpm 100.0..500_000.0, Value(60_000.0), "spindle speed", "assumed: otologic drill (docs/force-model.md 10)";
        SPIN = "burr.spin" One -1.0..1.0, Value(-1.0),
            "-1 forward (clockwise seen from the handpiece), +1 reverse", "assumed: forward (docs/force-model.md 1)";
        NECK = "burr.neck_radius_mm" Mm 0.05..10.0, Value(1.1), "radius of the neck where the flutes end", "assumed: asin(0.44) of the 5 mm burr (docs/force-model.md 10)";
        SEGMENTS = "shank.segments" Mm 0.05..200.0, Words("[[25.0, 1.1], [60.0, 6.0]]"),
            "[length, radius] of cylinders, one after the other, the first from radius_mm along the axis", "assumed: thin shaft, then handpiece";
        K_T = "material.k_t" NMm2 0.001..1e5, Derived("1400; 2100 with measure = \"dz\""), "tangential specific cutting energy at rho_ref and 60 000 rpm",
            "assumed: of the order of D's mean force (0.94 N in its slot at 60 000 rpm, 0.73 N measured), with the element length in use; dz: times 551/363 (docs/force-model.md 10), since one measure's value must not be used with the other";
        K_R = "material.k_r" NMm2 0.0..1e5, Derived("0.6 k_t: 840; 1260 with measure = \"dz\""), "radial", "assumed: 0.6 of the default k_t (docs/force-model.md 10)";
        K_A = "material.k_a" NMm2 0.0..1e5, Derived("0.1 k_t: 140; 210 with measure = \"dz\""), "axial, from shaft to tip", "assumed: 0.1 of the default k_t (docs/force-model.md 10)";
        K_TE = "material.k_te" NMm 0.0..100.0, Value(0.0), "tangential edge coefficient", "an edge-only model contradicts D's trials; off";
        K_RE = "material.k_re" NMm 0.0..100.0, Value(0.0), "radial edge coefficient", "as k_te";
        K_AE = "material.k_ae" NMm 0.0..100.0, Value(0.0), "axial edge coefficient", "as k_te";
        T0 = "material.t0_mm" Mm 0.0..1.0, Value(0.0), "chip thickness at which the edge term saturates; 0: at once", "docs/force-model.md 3";
        RHO_REF = "material.rho_ref_g_cm3" GCm3 0.01..10.0, Value(0.8), "density at which the coefficients hold", "D: foam of 0.8 g/cm³";
        EXPONENT = "material.exponent" One 0.0..5.0, Value(1.0), "exponent of density", "D: force proportional to mass";
        LAYER = "path.layer_mm" Mm 0.05..20.0, Value(1.5), "depth of a layer, at most twice the radius", "D: 1.5 mm";
        STEPOVER = "path.stepover_mm" Mm 0.05..20.0, Derived("2/3 of burr.radius_mm"), "distance of neighbouring lines, at most twice the radius", "assumed: reproduces D's figures";
        STEP = "path.step_mm" Mm 0.01..5.0, Derived("0.25; 0.5 with accuracy.level = \"coarse\", or the radius where that is less"), "distance of neighbouring waypoints, at most the radius", "assumed: the planning grid's spacing";
        RASTER = "path.raster_deg" Deg -360.0..360.0, Chosen("along the target or across it, by the forces toward structures in a draft"), "direction of the lines from work x towards work y", "-";
        ENTRY = "path.entry_mm" Mm -1e4..1e4, Words("where the line leaves the bone"), "with pattern = \"plunge\" or \"ream\": the tool's tip at depth 0, ct", "-";
        ENTRY_CENTER = "path.entry_ball.center_mm" Mm -1e4..1e4, Words(REQUIRED), "centre, ct", "-";
        ENTRY_RADIUS = "path.entry_ball.radius_mm" Mm 0.5..200.0, Words(REQUIRED), "radius", "-";
        END_TARGET = "path.target_mm" Mm -1e4..1e4, Words("exactly one of target_mm, depth_mm, contact_area_mm2"), "with plunge or ream: where the tip ends, ct", "-";
        END_DEPTH = "path.depth_mm" Mm 0.1..300.0, Words("exactly one of target_mm, depth_mm, contact_area_mm2"), "with plunge or ream: from the entry to where the tip ends", "-";
        END_AREA = "path.contact_area_mm2" One 1.0..1e5, Words("exactly one of target_mm, depth_mm, contact_area_mm2"), "with ream: the plunge ends where so many mm² of the reamer's surface are in bone", "-";
        CONE = "path.cone_deg" Deg 1.0..180.0, Words("60 with plunge or ream"), "with direction = \"safest\" and approach.direction: largest angle between that and the way out of the bone", ASSUMED;
        FEED_REV = "path.feed_mm_rev" Mm 0.0001..2.0, Words("0.02 with plunge or ream"), "with plunge or ream: feed per revolution of the spindle", "Faieghi et al., III-A: 0.01 and 0.02 mm/rev";
        FEED_SPEED = "path.feed_mm_s" MmS 0.001..100.0, Words("instead of feed_mm_rev"), "with plunge or ream: feed speed", "-";
        PECK = "path.peck_mm" Mm 0.1..300.0, Words(ABSENT), "with plunge: depth between two retractions out of the bone", "-";
        DWELL = "path.dwell_s" S 0.0..60.0, Words("0 with plunge or ream"), "with plunge or ream: how long the tool turns at the end", ASSUMED;
        STANDOFF = "path.standoff_mm" Mm 0.5..100.0, Words("5 with plunge or ream"), "with plunge or ream: how far before the bone the tip begins and ends", ASSUMED;
        TOUCH_PROBABILITY = "path.touch_probability" Share 1e-9..0.5, Words("0.01 with plunge or ream"), "with plunge or ream: largest probability with which the registration's error lets the tool touch a structure; above it the plan falls short", ASSUMED;
        REGISTRATION_SIGMA = "path.registration_sigma_mm" Mm 0.0..10.0, Words("0.15 with plunge or ream"), "with plunge or ream: standard deviation of the registration's error along each axis, where robot.base_from_ct gives no fiducials to estimate it from",
            "assumed: the largest deviation of 12 robotically milled cochlear channels was 0.35 mm";
        KAPPA = "cost.kappa_per_mm" PerMm 0.0..100.0, Value(0.7), "decay of a structure's importance with distance, that of α₁ too", "assumed (docs/force-model.md 10): α₁ halves with each mm";
        ALPHA_MAX = "cost.alpha_max" Share 0.0..1.0, Words("0.8; 0.5 with preset = \"paper\""), "α₁ at the clearance", "docs/force-model.md 8, resolution 10: 0.5 as D prints it, 0.8 as D's text and trials ask";
        TILT_LIMIT = "orientation.tilt_limit_deg" Deg 0.0..90.0, Value(60.0), "largest angle from the approach while cutting", ASSUMED;
        MIN_SPEED = "speed.min_mm_s" MmS 0.01..1000.0, Value(0.5), "slowest cut; a move that is to remove nothing may be ten times slower where it meets a skin, or bone between voxels", "assumed (docs/force-model.md 10)";
        MAX_SPEED = "speed.max_mm_s" MmS 0.01..1000.0, Value(4.0), "fastest cut", "assumed (docs/force-model.md 10)";
        NOMINAL_SPEED = "speed.nominal_mm_s" MmS 0.01..1000.0, Value(1.5), "speed of `constant`, and at which forces are compared", "D: 1.5 mm/s";
        LINK_SPEED = "speed.link_mm_s" MmS 0.01..1000.0, Value(10.0), "speed in free space", ASSUMED;
        TOTAL_TIME = "speed.total_time_s" S 0.1..1e6, Derived("with mode = \"least_force\": what a straight shaft takes with every cut at nominal_mm_s, driven by the same arm along lines in the better of two directions; else none"), "time of the whole plan, when it is to be met", "D III: trials of equal time";
        FORCE_ROOM = "speed.force_room" Share 0.0..10.0, Value(0.1), "with mode = \"least_force\": share by which the least level of |F| that fits the time may be exceeded, so that the level toward structures can be lower", "measured: docs/results.md";
        ANGLES = "orientation.angles" One 1.0..2.0, Derived("1 for the bone-attached arm, 2 for others"), "tilt angles of the shaft: θ in one plane, or θ and φ", "D: four joints leave θ";
        FORCE_CAP = "speed.force_n" N 0.001..1000.0, Derived("with mode = \"force_limited\": 1.7; else none"), "largest predicted force on the burr", "D IV: peak 1.69 N of the third trial";
        TOWARD_CAP = "speed.force_toward_n" One 0.0..1000.0, Derived("with mode = \"force_limited\": [[2, 0.8], [6, 1.7]]; else none"),
            "largest predicted force toward every structure: [distance from the burr's surface in mm, N], linear between, constant beyond", "D IV: peak 0.80 N within 2 mm in the third trial; the rise beyond is assumed";
        DEFLECTION_CAP = "speed.deflection_um" Um 0.001..1e5, Words(ABSENT), "largest predicted deflection of the burr; needs robot.joint_stiffness", "-";
        POWER_CAP = "speed.power_w" W 0.001..1e4, Words(ABSENT), "largest predicted spindle power", "-";
        SPEED_ACCELERATION = "speed.acceleration_mm_s2" MmS2 0.01..1e6, Value(50.0), "largest acceleration of the burr along the path with mode = \"force_limited\" or \"least_force\"; the joints' own limits hold anyway", ASSUMED;
        STIFFNESS = "robot.joint_stiffness" JointStiffness 1e-6..1e12, Words("none: rigid, no deflection"), "N/mm of prismatic joints, N·mm/rad of revolute ones", "D eq. 10";
        VELOCITY = "robot.velocity_limits" JointSpeed 1e-6..1e9, Derived("the URDF's"), "per joint and second; the stricter of this and the URDF's holds", "-";
        ACCELERATION = "robot.acceleration_limits" JointAcceleration 1e-6..1e9, Derived("the arm's, marked assumed"), "per joint and s²", "-";
        JERK = "robot.jerk_limits" JointJerk 1e-6..1e12, Derived("full acceleration within 0.02 s, marked assumed"), "per joint and s³", "-";
        RATE = "robot.rate_hz" Hz 1.0..10_000.0, Value(500.0), "sampling rate of the trajectory", "UR e-series controllers";
        ROTATION = "robot.base_from_ct.rotation" One -1.1..1.1, Words(REQUIRED), "R of p_base = R p_ct + t, by rows; or quaternion_wxyz, or rpy_rad", "-";
        QUATERNION = "robot.base_from_ct.quaternion_wxyz" One -1e6..1e6, Words("instead of rotation"), "R as a unit quaternion", "-";
        RPY = "robot.base_from_ct.rpy_rad" Rad -10.0..10.0, Words("instead of rotation"), "R = Rz(yaw) Ry(pitch) Rx(roll), as in URDF", "-";
        TRANSLATION = "robot.base_from_ct.translation_mm" Mm -1e5..1e5, Words(REQUIRED), "t of p_base = R p_ct + t", "-";
        FIDUCIALS_CT = "robot.base_from_ct.fiducials.ct_mm" Mm -1e5..1e5, Words("instead of rotation"), "points in ct (RAS+; a point in LPS has x and y negated), inside the scan, at least three and not on a line; base_from_ct is fitted to them", "Arun et al. 1987";
        FIDUCIALS_BASE = "robot.base_from_ct.fiducials.base_mm" Mm -1e5..1e5, Words("instead of rotation"), "the same points as the arm touched them, in base, in the same order", "-";
        FLANGE_TRANSLATION = "robot.flange_from_burr.translation_mm" Mm -1e4..1e4, Words(REQUIRED), "burr's centre in the flange", "-";
        FLANGE_RPY = "robot.flange_from_burr.rpy_rad" Rad -10.0..10.0, Words(REQUIRED), "burr's axes in the flange, z to the handpiece", "-";
        FORCE_ERROR = "accuracy.force" Share 0.0005..0.2, Words("none"), "by what share the forces of single cuts may err in the mean, in size and toward structures. The three errors that can be asked for set the level where the case leaves it out, to the cheapest that keeps them; a plan measures its own errors and falls short where it misses one. Forces that err by more are first summed more finely, once", "experiment speed-vs-error";
        REMOVED_ERROR = "accuracy.removed" Share 0.0001..0.2, Words("none"), "by what share of the target the removed volume may err", "experiment speed-vs-error";
        DISTANCE_ERROR = "accuracy.distance_mm" Mm 0.0001..1.0, Words("none"), "by how much a structure may be nearer between two waypoints than its least distance at one", "experiment speed-vs-error";
        FORCE_ELEMENTS = "accuracy.force_elements" One 8.0..512.0, Derived("64; coarse 32, fine 128"), "elements of the force sum from tip to shaft where a force is stated, and twice as many around", "experiment speed-vs-error";
        FORCE_DIRECTIONS = "accuracy.force_directions" One 64.0..16384.0, Derived("1024; coarse 512, fine 4096"), "directions in which bone is looked for where axes are chosen and within moves", "experiment speed-vs-error";
        FORCE_CHANGE = "accuracy.force_change" Share 0.001..1.0, Derived("0.05; coarse 0.2, fine 0.02"), "forces at neighbouring places within a move differ by less than this share of the larger, or are computed between them too", "experiment speed-vs-error";
        AXIS_SPACING = "accuracy.axis_spacing_deg" Deg 0.25..20.0, Derived("2; coarse 4"), "spacing of the shaft's directions in a plane; three times that over a cap", "experiment speed-vs-error";
        MAX_FRE = "registration.max_fre_mm" Mm 0.01..100.0, Value(1.0),
            "largest RMS residual (FRE) of robot.base_from_ct.fiducials; a plan on a worse fit falls short", "assumed: bone-anchored fiducials fit to a few tenths of a mm";
        SPACING = "grid.spacing_mm" Mm 0.02..2.0, Derived("0.25; 0.5 with accuracy.level = \"coarse\", or half the radius where that is less"), "voxel of the planning grid, at most half the radius", ASSUMED;
        MARGIN = "grid.margin_mm" Mm 0.0..100.0, Value(3.0), "bone kept around the target beside the tool's own reach", ASSUMED;
    }
    choices {
        PRESET: bool = "preset" ["none" => false, "paper" => true],
            "`paper`: D's own choices as defaults: measure `dz`, alpha_max 0.5, mode `greedy`, speed smoothed by the plain moving average. Keys that stand in the file win", "D eq. 4, 8, II-D, II-H";
        CT_AFFINE: AffineChoice = "images.ct_affine" ["auto" => AffineChoice::Auto, "sform" => AffineChoice::Sform, "qform" => AffineChoice::Qform],
            "which of the CT's affines holds; `auto`: sform, else qform, refused when they disagree, or the sform's columns and pixdim, by more than 0.1 voxel at a corner", "NIfTI-1";
        LABELS_AFFINE: AffineChoice = "images.labels_affine" ["auto" => AffineChoice::Auto, "sform" => AffineChoice::Sform, "qform" => AffineChoice::Qform],
            "the same for the label map; with `auto` a map of the CT's dimensions that lies more than a voxel beside the CT is refused", "NIfTI-1";
        SHEETS: Sheets = "target.sheets" ["keep" => Sheets::Keep, "cut" => Sheets::Cut],
            "bone outside the target that is thinner than the band (the largest voxel diagonal of CT, labels and planning grid): kept unless it lies within the band of the target, where it is taken for partial volume; or cut wherever the ball meets it. Pieces under 2×2×2 voxels are cut either way", ASSUMED;
        MEASURE: Measure = "material.measure" ["db" => Measure::Db, "dz" => Measure::Dz],
            "length element of the force sum: edge length or height; `dz` with preset = \"paper\"", "docs/force-model.md 4: db is energy-consistent and reproduces D's trials, dz is D eq. 4 as printed";
        PATTERN: Pattern = "path.pattern" ["lawnmower" => Pattern::Lawnmower, "plunge" => Pattern::Plunge, "ream" => Pattern::Ream],
            "layers of serpentine lines; a straight channel, drilled along its axis; a plunge of a reamer. With the last two [target] is left out: what the tool sweeps is cut", "D II-A; Faieghi et al., III";
        TURNS: bool = "burr.turns" ["one_way" => false, "both_ways" => true],
            "whether the burr cuts one way only, as spin says, or either way: then the plan with less force toward the structures decides", ASSUMED;
        SENSE: Sense = "path.sense" ["auto" => Sense::Auto, "both" => Sense::Both, "climb" => Sense::Climb, "conventional" => Sense::Conventional, "away" => Sense::Away],
            "sense in which a pass is cut, where it has bone on one side: whichever end is nearer; the teeth against the feed; with it; near a structure the one that pushes less toward it. `auto`: both or away, by the forces toward structures in drafts of the same time", "-";
        LEVEL: Level = "accuracy.level" ["default" => Level::Default, "coarse" => Level::Coarse, "fine" => Level::Fine],
            "what the other keys of this table, grid.spacing_mm and path.step_mm are where the case leaves them out: `coarse` for a preview, `fine` to check a plan's figures. What the forces err by is measured on every plan: `force_error` in plan.toml", "experiment speed-vs-error";
        COST_FORCE: ForceTerm = "cost.force" ["cutting" => ForceTerm::Cutting, "deflection" => ForceTerm::Deflection],
            "which force the cost looks at: D6 or D12", "D eq. 6";
        OBJECTIVE: Objective = "cost.objective" ["levels" => Objective::Levels, "dillon" => Objective::Dillon],
            "what the choice of axes minimises: `levels`, the time that cuts under levels of force and turns need, so that the lowest levels fit the total time; `dillon`, D's cost C of inertia and of the push's share toward structures (with preset = \"paper\"). The column `cost` is C either way", "levels: forces toward structures, see docs/results.md; dillon: D eq. 5 to 12";
        COST_STRUCTURES: SeveralStructures = "cost.structures" ["nearest" => SeveralStructures::Nearest, "priority" => SeveralStructures::Priority, "sum" => SeveralStructures::Sum],
            "which structures the cost looks at where several are near: the closest; the one of highest priority among the close ones; all, each by its own α₁", "D II-D names all three";
        ORIENTATION: OrientationMode = "orientation.mode" ["optimal" => OrientationMode::Optimal, "greedy" => OrientationMode::Greedy, "fixed" => OrientationMode::Fixed],
            "dynamic programming over the sequence; each waypoint alone, then a low-pass; along the approach. `greedy` with preset = \"paper\"", "assumed; greedy: D II-D";
        SPEED_MODE: SpeedMode = "speed.mode" ["least_force" => SpeedMode::LeastForce, "mass" => SpeedMode::Mass, "constant" => SpeedMode::Constant, "force_limited" => SpeedMode::ForceLimited],
            "in the given time the least force toward structures, weighted by nearness (kappa_per_mm) and 1/√rank (priority over the smallest), then the least force; D13, inverse to the mass ahead; nominal_mm_s; fastest under force caps. `mass` with preset = \"paper\"", "forces toward structures, see docs/results.md; mass: D eq. 13";
    }
    others {
        CT = "images.ct" "a path relative to the case file", REQUIRED, "the CT in HU: NIfTI, NRRD, MetaImage, or a folder with a DICOM series", "-";
        CT_SERIES = "images.ct_series" "a series' name or its SeriesInstanceUID", "none: the folder has one series", "which series, where images.ct is a folder with several: the name is the first 12 hex digits of the UID's SHA-256, as the refusal lists it; a UID is taken too, but the name is what is written", "-";
        LABELS = "images.labels" "a path relative to the case file", "required, unless every label is in a file: then the first of these, the target's before the structures'", "the label map: NIfTI, NRRD, MetaImage, 3D Slicer's .seg.nrrd, DICOM SEG, or a folder with one mask per structure. Its grid is that of all labels", "-";
        TARGET_LABEL = "target.label" "a number from 1 to 65535 or a name of labels.json", "one of label, segment, file, box, ball, frustum; label or segment beside file", "the bone to be removed; where it overlaps or touches a structure, less every structure and its clearance_mm", "-";
        TARGET_SEGMENT = "target.segment" "a name", "as target.label", "the same by the name of its segment", "-";
        TARGET_FILE = "target.file" "a path relative to the case file", "as target.label", "the same in a file of its own: a mask, or with label or segment one of several. On another grid than the label map's: voxels of the map whose centres lie in it", "-";
        TARGET_BOX = "target.box" "a table { min_mm, max_mm }", "as target.label", "bone and enclosed air in a box, less every structure and its clearance_mm", "-";
        TARGET_BALL = "target.ball" "a table { center_mm, radius_mm }", "as target.label", "the same in a ball", "-";
        TARGET_FRUSTUM = "target.frustum" "a table { from_mm, to_mm, from_radius_mm, to_radius_mm }", "as target.label", "the same in a cone's frustum", "-";
        TARGET_ALSO = "target.also" "a list of tables { label | segment | file | box | ball | frustum, margin_mm }", ABSENT, "labels and shapes that belong to the target besides, less every structure and its clearance_mm", "-";
        TARGET_LESS = "target.less" "a list of tables { label | segment | file | box | ball | frustum, margin_mm }", ABSENT, "labels and shapes that are taken away from all that: bone there is kept", "-";
        STRUCTURE = "structure" "tables [[structure]], or `structure = []` when there is nothing to spare", REQUIRED, "what must not be touched", "-";
        STRUCTURE_NAME = "structure.name" "text without commas and quotes", REQUIRED, "name in results", "-";
        STRUCTURE_LABEL = "structure.label" "a number from 1 to 65535, or a name of labels.json or of the label file itself", "label or segment, or file, or file with one of the two", "its label", "-";
        STRUCTURE_SEGMENT = "structure.segment" "a name", "as structure.label", "the name of its segment in a .seg.nrrd or DICOM SEG, of its mask's file, or of its label in labels.json", "-";
        STRUCTURE_FILE = "structure.file" "a path relative to the case file", "as structure.label", "a file of its own: a mask, whose voxels that are not 0 belong to the structure whatever the label map says of them, or with label or segment one label of several. On another grid than the map's: every voxel of the map that it touches", "-";
        ENTRY_LABEL = "path.entry_label" "a number from 1 to 65535 or a name of labels.json", "none: anywhere on the bone", "with plunge or ream and no entry_mm: the channel leaves the bone in this label", "-";
        ENTRY_BALL = "path.entry_ball" "a table { center_mm, radius_mm }", "none: anywhere on the bone", "the same in a ball", "-";
        CHANNEL_DIRECTION = "path.direction" "`safest`, or [x, y, z] in ct, into the bone", "from entry_mm to target_mm where both are given; else required", "with plunge or ream: where the channel leads; `safest`: to target_mm, with the largest weighted clearance to every structure", "-";
        HOLD = "hold" "tables [[hold]]", ABSENT, "where a streamed plan draws the burr back and waits for the user, as nerve monitoring needs; the path is the same without", "-";
        HOLD_STRUCTURE = "hold.structure" "the name of a [[structure]]", REQUIRED, "to which the distance is", "-";
        MODEL = "robot.model" "`bone-attached`, `ur3e`, `ur5e`, `ur10e`, `ur16e`, `ur20`, `ur30` or the path of a .urdf file", "\"bone-attached\"", "the arm", "D: bone-attached robot";
        CALIBRATION = "robot.calibration" "a path relative to the case file", "none: nominal kinematics, with a warning", "a UR's own calibration: YAML or calibration.conf with delta_theta, delta_a, delta_d, delta_alpha, or the ROS driver's extraction", "-";
        BRANCH = "robot.branch" "a number from 0 to 7, or words of `shoulder-left` | `shoulder-right`, `elbow-up` | `elbow-down`, `wrist-positive` | `wrist-negative` joined by `/`",
            "any; those whose links stay above the mounting plane come first", "which branches of a UR's inverse may be taken, for the whole path: 4·shoulder + 2·wrist + elbow; seen from the base toward the wrist, the upper arm is left or right of it, the elbow above or below the line from the shoulder to the wrist, and q5 positive or negative", "-";
        BASE_FROM_CT = "robot.base_from_ct" "a table { rotation | quaternion_wxyz | rpy_rad, translation_mm } or { fiducials }",
            "assumed: base x, y, z along work y, -x, z; the target's centre at the bone-attached arm's base, or before a UR's base by 0.55 and above it by 0.05 of its reach; needed for a URDF", "registration: where the patient is", "assumed, stated in plan.toml";
        FLANGE_FROM_BURR = "robot.flange_from_burr" "a table { translation_mm, rpy_rad }", "the URDF ends at the burr; needed for a UR", "where the burr is mounted", "-";
    }
}

pub(super) mod room;
pub(super) mod tool;

/// Every key of a case, for the documentation.
pub(super) fn case_entries() -> Vec<Entry> {
    [entries(), room::entries(), tool::entries()].concat()
}

/// A key as the documentation shows it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    /// Full path.
    pub path: &'static str,
    /// Unit and range, words, or a description.
    pub expects: String,
    /// When absent.
    pub default: String,
    /// What it is.
    pub meaning: &'static str,
    /// Where the default comes from.
    pub source: &'static str,
    /// The default of a number.
    pub fallback: Option<Fallback>,
}

impl From<&Number> for Entry {
    fn from(n: &Number) -> Self {
        let unit = if n.unit.is_none() { String::new() } else { format!(" {}", n.unit) };
        let default = match n.default {
            Value(v) => v.to_string(),
            Words(words) | Derived(words) | Chosen(words) => words.into(),
        };
        Entry {
            path: n.path,
            expects: format!("{} to {}{unit}", n.min, n.max),
            default,
            meaning: n.meaning,
            source: n.source,
            fallback: Some(n.default),
        }
    }
}

impl<T: Copy + PartialEq> From<&Choice<T>> for Entry {
    fn from(c: &Choice<T>) -> Self {
        let words: Vec<_> = c.words().iter().map(|w| format!("`{w}`")).collect();
        let default = c.options.first().map_or(String::new(), |(word, _)| format!("\"{word}\""));
        Entry {
            path: c.path,
            expects: words.join(", "),
            default,
            meaning: c.meaning,
            source: c.source,
            fallback: None,
        }
    }
}

impl From<&Other> for Entry {
    fn from(o: &Other) -> Self {
        Entry {
            path: o.path,
            expects: o.expects.into(),
            default: o.default.into(),
            meaning: o.meaning,
            source: o.source,
            fallback: None,
        }
    }
}
