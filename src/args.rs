//! The parsed command line. Nothing is checked against the file system here.

use std::path::PathBuf;

use bonemill_imaging::phantom::PhantomKind;
use bonemill_planner::calibrate::Coefficient;
use bonemill_planner::case::draft::ROBOTS;
use bonemill_planner::plan::{Need, PlanFileError, StoredPlan};
use bonemill_planner::simulate::ModelName;
use clap::error::{ContextKind, ContextValue};
use clap::{ArgGroup, CommandFactory, FromArgMatches, Parser, Subcommand};

/// Plans how a robot mills bone: path, burr angle, speed and joint trajectory from CT.
///
/// Exit code 0: done; 1: the plan fell short, with the reasons; 2: bad input, or output that was lost; 130: stopped by a signal.
#[derive(Debug, Parser)]
#[command(version)]
pub struct Args {
    /// Print nothing but errors
    #[arg(long, global = true)]
    pub quiet: bool,
    /// Print one JSON object with figures, warnings and seconds by stage, and no progress
    #[arg(long, global = true)]
    pub json: bool,
    /// Number of worker threads; the result does not depend on it
    #[arg(long, global = true, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    pub threads: Option<u16>,
    #[command(subcommand)]
    pub command: Command,
}

/// What the command prints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Talk {
    /// Errors only.
    Quiet,
    /// Progress and a summary for people.
    People,
    /// One JSON object.
    Machine,
}

impl Args {
    /// The arguments of this process.
    ///
    /// # Errors
    /// What clap has to say: a usage error, or the help or version that was asked for.
    pub fn read() -> Result<Self, clap::Error> {
        let read = with_negative_numbers(Self::command()).try_get_matches().map_err(without_wrong_tip);
        Self::from_arg_matches(&read?)
    }

    /// What the command prints; `--json` has precedence over `--quiet`.
    pub fn talk(&self) -> Talk {
        match (self.json, self.quiet) {
            (true, _) => Talk::Machine,
            (false, true) => Talk::Quiet,
            (false, false) => Talk::People,
        }
    }
}

/// A usage error without the tip to pass an unknown option as a value, which would be taken for a file.
fn without_wrong_tip(mut error: clap::Error) -> clap::Error {
    let is_wrong = |value: &ContextValue| matches!(value, ContextValue::StyledStrs(tips) if tips.iter().any(|tip| tip.to_string().starts_with("to pass ")));
    if error.get(ContextKind::Suggested).is_some_and(is_wrong) {
        error.remove(ContextKind::Suggested);
    }
    error
}

/// The command with options that take a number such as -5 as a value, to be refused by its range and not as an unknown option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let of_value = |arg: clap::Arg| {
        let takes_value = arg.get_action().takes_values();
        if takes_value { arg.allow_negative_numbers(true) } else { arg }
    };
    command.mut_args(of_value).mut_subcommands(with_negative_numbers)
}

impl Command {
    /// Whether the command tidies up after a signal instead of ending at once. It does not while it waits for poses on standard
    /// input or has a viewer open.
    pub fn is_stopped_tidily(&self) -> bool {
        match self {
            Self::View(_) => false,
            Self::Simulate(simulate) => !simulate.stream,
            _ => true,
        }
    }
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a test body: CT, labels and a commented case file
    Phantom(PhantomArgs),
    /// Make a commented case file from a CT and labels: target and structures by their usual names
    Case(CaseArgs),
    /// Plan a case, or a phantom
    Plan(PlanArgs),
    /// Search where a UR may stand beside the patient, with a map
    Stand(StandArgs),
    /// Turn a part (STL, OBJ, PLY) into a proven milling program: orientation, block, toolpath, G-code
    Prosthesis(ProsthesisArgs),
    /// Keep the catalogue of blocks that parts are milled from
    Stock(StockArgs),
    /// Write a plan's motion for a controller: ROS, URScript or G-code
    Export(ExportArgs),
    /// Show a plan in the rerun viewer, or write a file for it (needs a build with the feature `rerun`)
    View(ViewArgs),
    /// Check a plan by code that did not make it, and write verification.toml beside it
    Verify(VerifyArgs),
    /// Replay a plan's trajectory through the bone: removal and forces, into simulation.csv and the report
    Simulate(SimulateArgs),
    /// Show two plans side by side: cases, paths, volumes, distances, forces, times
    Compare(CompareArgs),
    /// Set a streamed run beside its plan: path error, timing, force
    Report(ReportArgs),
    /// Print the case file's keys with units, ranges, defaults and their sources, as Markdown
    Keys(KeysArgs),
    /// Print the columns and keys of a plan's files with units, frames and meanings, as Markdown
    Columns,
}

#[derive(Debug, clap::Args)]
pub struct PhantomArgs {
    /// Kind of phantom: block (the foam block of Dillon et al. 2016), temporal (a mastoid computed from a seed), tibia (a shaft to be drilled) or glenoid (to be reamed)
    #[arg(long)]
    pub kind: PhantomKind,
    /// Seed: each gives another body of the same kind
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Folder to write; it must not exist or must be empty
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
}

/// A label is named by its name or number.
#[derive(Debug, clap::Args)]
pub struct CaseArgs {
    /// CT: an image file, or a folder with a DICOM series
    #[arg(value_name = "CT")]
    pub ct: PathBuf,
    /// The label map, or a folder of masks; further files are label maps or masks, target and structures among them, named by their files
    #[arg(value_name = "LABELS", required = true)]
    pub labels: Vec<PathBuf>,
    /// Case file to write
    #[arg(long, value_name = "CASE.toml")]
    pub out: PathBuf,
    /// Replace the case file if it exists
    #[arg(long)]
    pub force: bool,
    /// Name of the CT's series, or its SeriesInstanceUID, where its folder has several; the refusal without it lists them
    #[arg(long, value_name = "NAME|UID")]
    pub ct_series: Option<String>,
    /// The label to be removed, where names do not tell it
    #[arg(long, value_name = "NAME|NUMBER")]
    pub target: Option<String>,
    /// Remove the bone in a ball instead: its centre in RAS+ and its radius, mm
    #[arg(long, num_args = 4, value_names = ["X", "Y", "Z", "RADIUS"], conflicts_with = "target")]
    pub target_ball_mm: Option<Vec<f64>>,
    /// Or in a cone's frustum: the middles of its ends and their radii, mm
    #[arg(long, num_args = 8, value_names = ["X", "Y", "Z", "RADIUS", "X", "Y", "Z", "RADIUS"], conflicts_with_all = ["target", "target_ball_mm"])]
    pub target_frustum_mm: Option<Vec<f64>>,
    /// A label to be spared that its name does not tell; may be repeated
    #[arg(long, value_name = "NAME|NUMBER")]
    pub structure: Vec<String>,
    /// A label not to be spared, whatever its name tells; may be repeated
    #[arg(long, value_name = "NAME|NUMBER")]
    pub ignore: Vec<String>,
    /// The arm; for a UR a handpiece straight on the flange is assumed
    #[arg(long, default_value = ROBOTS[0], value_parser = clap::builder::PossibleValuesParser::new(ROBOTS))]
    pub robot: String,
    /// A line or curve of 3D Slicer (.mrk.json, .fcsv): its first point outside, its last inside the bone; the shaft is to stand along it
    #[arg(long, value_name = "F.mrk.json")]
    pub approach: Option<PathBuf>,
    /// Registration: 3D Slicer's transform (.h5, .tfm, .txt) under which the CT lies where the robot's base sees it, Slicer's world being the base
    #[arg(long, value_name = "T.tfm", conflicts_with = "fiducials")]
    pub registration: Option<PathBuf>,
    /// Points of 3D Slicer (.mrk.json, .fcsv), at least three, that the arm will touch in this order; what it finds is to be entered in the case
    #[arg(long, value_name = "F.mrk.json")]
    pub fiducials: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
#[command(group = ArgGroup::new("source").required(true))]
pub struct PlanArgs {
    /// Case file; `bonemill keys` lists its keys
    #[arg(group = "source", value_name = "CASE.toml")]
    pub case: Option<PathBuf>,
    /// Plan a phantom instead (block, temporal, tibia or glenoid); its files are kept in the plan
    #[arg(long, group = "source", value_name = "KIND")]
    pub phantom: Option<PhantomKind>,
    /// The phantom's seed
    #[arg(long, default_value_t = 1, requires = "phantom", conflicts_with = "case")]
    pub seed: u64,
    /// Folder to write: new, empty, or a plan, which is replaced
    #[arg(long, value_name = "PLAN")]
    pub out: PathBuf,
    /// Keep copies of CT, labels and the other inputs in the plan, so that the folder can be moved or sent; DICOM files keep their
    /// header with the patient's name
    #[arg(long)]
    pub pack: bool,
    /// Leave slices of the CT out of report.html, so that the page can go where the scan may not
    #[arg(long)]
    pub no_slices: bool,
    /// Plan at this level, whatever the case says of grid, step and accuracy; the changed case is kept in the plan
    #[arg(long, value_name = "LEVEL", value_parser = ["coarse", "default", "fine"], conflicts_with = "pack")]
    pub accuracy: Option<String>,
}

/// Lengths are in ct (RAS+: +x right, +y front, +z toward the head) from the target's centre.
#[derive(Debug, clap::Args)]
pub struct StandArgs {
    /// Case file with a UR; its registration, if it has one, is not looked at
    #[arg(value_name = "CASE.toml")]
    pub case: PathBuf,
    /// Which way is up in ct: 0 1 0 for a patient who lies on the back
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], required = true)]
    pub up: Vec<f64>,
    /// Least x, y and z of the base's origin, mm
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], required = true)]
    pub from_mm: Vec<f64>,
    /// Largest x, y and z, mm; the same as the least where there is no choice
    #[arg(long, num_args = 3, value_names = ["X", "Y", "Z"], required = true)]
    pub to_mm: Vec<f64>,
    /// Largest distance between the places that are tried, mm
    #[arg(long, default_value_t = 50.0, value_name = "MM")]
    pub step_mm: f64,
    /// Write a map of the places
    #[arg(long, value_name = "MAP.svg")]
    pub map: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
#[command(group = ArgGroup::new("part").required(true))]
pub struct ProsthesisArgs {
    /// Job file; `bonemill keys --prosthesis` lists what may stand in it
    #[arg(group = "part", value_name = "JOB.toml")]
    pub job: Option<PathBuf>,
    /// Take a drawn prosthesis instead; it is kept in the folder
    #[arg(long, group = "part", value_name = "KIND")]
    pub phantom: Option<PartKind>,
    /// The drawing's seed; 1 to 25 stand for the published set
    #[arg(long, default_value_t = 1, requires = "phantom", conflicts_with = "job")]
    pub seed: u64,
    /// Folder to write: new, empty, or that of a prosthesis, which is replaced
    #[arg(long, value_name = "OUT")]
    pub out: PathBuf,
}

/// Parts that can be drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum PartKind {
    /// A skull prosthesis after the statistics of Castelli et al. 2020
    Prosthesis,
}

#[derive(Debug, clap::Args)]
pub struct StockArgs {
    /// The catalogue, a TOML file
    #[arg(long, global = true, value_name = "STOCK.toml", default_value = "stock.toml")]
    pub catalogue: PathBuf,
    #[command(subcommand)]
    pub command: StockCommand,
}

#[derive(Debug, Subcommand)]
pub enum StockCommand {
    /// Add blocks of a kind
    Add {
        /// The kind's number
        #[arg(value_name = "ID")]
        id: String,
        /// Its three sides, mm
        #[arg(long, num_args = 3, value_names = ["A", "B", "C"], required = true)]
        size_mm: Vec<f64>,
        /// How many
        #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
        count: u32,
    },
    /// Take a kind out of the catalogue with all of its blocks; to correct its sides, remove and add it
    Remove {
        /// The kind's number
        #[arg(value_name = "ID")]
        id: String,
    },
    /// List every kind, its sides and how many are left
    List,
    /// Take one block out
    Take {
        /// The kind's number
        #[arg(value_name = "ID")]
        id: String,
    },
    /// Put one block back
    Return {
        /// The kind's number
        #[arg(value_name = "ID")]
        id: String,
    },
}

#[derive(Debug, clap::Args)]
pub struct KeysArgs {
    /// Those of a prosthesis' job file instead
    #[arg(long)]
    pub prosthesis: bool,
}

/// A format that a controller reads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum ExportFormat {
    /// trajectory_msgs/JointTrajectory, as JSON and as the YAML that `ros2 topic pub` takes
    Ros,
    /// A program for a UR controller
    Urscript,
    /// For Cartesian machines
    Gcode,
    /// A scene for 3D Slicer: the cavity, the rest of the target, path, forces and tool beside the CT, to look at
    Slicer,
}

/// A finished plan.
#[derive(Debug, clap::Args)]
pub struct PlanFolder {
    /// Folder of a plan
    #[arg(value_name = "PLAN")]
    pub plan: PathBuf,
    /// A further folder in which to search the plan's inputs (CT, labels, case …), by name or by content
    #[arg(long, value_name = "DIR")]
    pub inputs: Option<PathBuf>,
}

impl PlanFolder {
    /// Reads the plan.
    pub fn load(&self, need: Need) -> Result<StoredPlan, PlanFileError> {
        StoredPlan::load_with(&self.plan, self.inputs.as_deref(), need)
    }
}

#[derive(Debug, clap::Args)]
pub struct ExportArgs {
    #[command(flatten)]
    pub folder: PlanFolder,
    /// Format of the files
    #[arg(long)]
    pub format: ExportFormat,
    /// Folder for the files, which are named after the plan; slicer: a folder of its own, new, empty or an earlier scene
    #[arg(long, value_name = "DIR", default_value = ".")]
    pub out: PathBuf,
    /// Rows per second, at most those of the trajectory; by default chosen so that the burr stays on the trajectory
    #[arg(long = "rate", value_name = "HZ")]
    pub rate_hz: Option<f64>,
    /// gcode: write links as G0; only for a machine that drives G0 along a straight line
    #[arg(long)]
    pub rapid: bool,
    /// Export a plan without a passed verification or a registration; the files' names say so, and their heads where the format has comments
    #[arg(long)]
    pub unverified: bool,
}

#[derive(Debug, clap::Args)]
pub struct ViewArgs {
    #[command(flatten)]
    pub folder: PlanFolder,
    /// Write this file instead of opening the viewer
    #[arg(long, value_name = "F.rrd")]
    pub save: Option<PathBuf>,
    /// Also show a streamed run while its log grows, until the run ends
    #[arg(long, value_name = "LOG", conflicts_with = "save")]
    pub follow: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub struct VerifyArgs {
    #[command(flatten)]
    pub folder: PlanFolder,
    /// List also the checks that passed
    #[arg(long)]
    pub all: bool,
    /// Also evaluate the plan under N sets of random errors: how likely it touches each structure, and the spread of forces
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub samples: Option<u32>,
    #[command(flatten)]
    pub errors: ErrorArgs,
}

/// A number that is not negative.
fn not_negative(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| value.is_finite() && *value >= 0.0);
    value.ok_or_else(|| "expected a number of at least 0".into())
}

/// Standard deviations of the errors. The defaults are assumed.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Errors to draw (with --samples)")]
pub struct ErrorArgs {
    /// Standard deviation of the registration along each axis, mm
    #[arg(long, value_parser = not_negative, value_name = "MM", default_value_t = 0.3, requires = "samples")]
    pub registration_mm: f64,
    /// Standard deviation of the registration about each axis through the middle of the path, degrees
    #[arg(long, value_parser = not_negative, value_name = "DEG", default_value_t = 0.3, requires = "samples")]
    pub registration_deg: f64,
    /// Standard deviation of each structure's boundary, mm
    #[arg(long, value_parser = not_negative, value_name = "MM", default_value_t = 0.15, requires = "samples")]
    pub boundary_mm: f64,
    /// Standard deviation of the density, as a share
    #[arg(long, value_parser = not_negative, value_name = "SHARE", default_value_t = 0.1, requires = "samples")]
    pub density_share: f64,
    /// Standard deviation of the cutting coefficients, as a share
    #[arg(long, value_parser = not_negative, value_name = "SHARE", default_value_t = 0.25, requires = "samples")]
    pub k_share: f64,
    /// Probability with which every structure must stay untouched
    #[arg(long, value_name = "P", default_value_t = 0.95, requires = "samples")]
    pub keep: f64,
    /// Seed of the random errors
    #[arg(long, value_name = "SEED", default_value_t = 1, requires = "samples")]
    pub draw_seed: u64,
}

#[derive(Debug, clap::Args)]
pub struct SimulateArgs {
    #[command(flatten)]
    pub folder: PlanFolder,
    /// Longest step of the burr, mm
    #[arg(long, value_name = "MM", default_value_t = 0.1, conflicts_with = "rate_hz")]
    pub step_mm: f64,
    /// Fixed number of poses per second instead
    #[arg(long, value_name = "HZ")]
    pub rate_hz: Option<f64>,
    /// Force model: fluted, lumped or lumped-as-printed
    #[arg(long, value_name = "NAME", default_value_t)]
    pub model: ModelName,
    /// Read one pose per line from stdin (time_s x y z axis_x axis_y axis_z, ct) and print a line of forces for each
    #[arg(long, conflicts_with_all = ["calibrate", "rate_hz", "step_mm"])]
    pub stream: bool,
    /// Fit coefficients to a log instead: a burr's to poses and forces, those of a drill or reamer to depth, thrust and torque
    #[arg(long, value_name = "LOG.csv", conflicts_with_all = ["rate_hz", "step_mm", "model"])]
    pub calibrate: Option<PathBuf>,
    /// The burr's coefficients to fit [default: k_t,k_r,k_a,k_te,k_re,k_ae]
    #[arg(long, value_name = "KEYS", value_delimiter = ',', requires = "calibrate")]
    pub coefficients: Option<Vec<Coefficient>>,
}

#[derive(Debug, clap::Args)]
pub struct CompareArgs {
    /// Folder of the first plan
    #[arg(value_name = "A")]
    pub first: PathBuf,
    /// Folder of the second plan
    #[arg(value_name = "B")]
    pub second: PathBuf,
    /// Print every figure, not only those that matter most
    #[arg(long)]
    pub all: bool,
    /// Also write an HTML page
    #[arg(long, value_name = "PAGE.html")]
    pub out: Option<PathBuf>,
}

#[derive(Debug, clap::Args)]
pub struct ReportArgs {
    /// Folder of the plan that was streamed
    #[arg(value_name = "PLAN")]
    pub plan: PathBuf,
    /// The run's log, as `python -m bonemill stream --log` writes it
    #[arg(long, value_name = "LOG")]
    pub run: PathBuf,
    /// Also write a page
    #[arg(long, value_name = "PAGE.html")]
    pub out: Option<PathBuf>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_arguments_are_consistent() {
        with_negative_numbers(Args::command()).debug_assert();
    }

    #[test]
    fn a_plan_has_exactly_one_source() {
        let parse = |line: &str| Args::try_parse_from(line.split(' '));
        assert!(parse("bonemill plan case.toml --out p").is_ok());
        assert!(parse("bonemill plan --phantom block --seed 3 --out p --json --threads 2").is_ok());
        for wrong in [
            "bonemill plan --out p",
            "bonemill plan case.toml --phantom block --out p",
            "bonemill plan case.toml --seed 3 --out p",
            "bonemill plan case.toml",
            "bonemill plan --phantom skull --out p",
            "bonemill plan case.toml --out p --threads 0",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
