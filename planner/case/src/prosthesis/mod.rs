//! The job of a prosthesis: which part, out of which block, with which cutter, on which machine; as validated values.
//!
//! Text becomes a [`ProsthesisJob`] in [`ProsthesisJob::parse`]; every number in it is finite and in range. The keys, their defaults and
//! sources are in one table, from which the documentation is generated too ([`reference()`]). Reading files is not done here.
//!
//! **Source:** Castelli et al. 2020; the defaults of the process are its Table 4, soft plastic.

mod keys;
mod parse;
mod write;

use std::path::PathBuf;

use bonemill_arm::ur::UrModel;

use crate::Given;

/// What is milled, out of what, with what.
#[derive(Debug, Clone, PartialEq)]
pub struct ProsthesisJob {
    /// The part.
    pub part: PartSpec,
    /// How it is laid into the block.
    pub orient: OrientMode,
    /// Where blocks come from, and what is left around the part.
    pub stock: StockSpec,
    /// The cutter.
    pub tool: CutterSpec,
    /// How it cuts.
    pub process: ProcessSpec,
    /// What moves it.
    pub machine: MachineSpec,
    /// Which keys the file gave.
    pub given: Given,
}

/// `[part]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PartSpec {
    /// STL, OBJ or PLY, relative to the job file.
    pub file: PathBuf,
    /// Unit of its coordinates: `mm`, `cm`, `m`, `inch` or `um`; `None`: mm if the size is plausible.
    pub unit: Option<&'static str>,
}

/// `[orient]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrientMode {
    /// The least sum of residual areas.
    LeastResidual,
    /// The least machining time.
    LeastTime,
    /// As the file gives the part.
    AsGiven,
}

/// A kind of block in stock.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockSpec {
    /// Its number.
    pub id: String,
    /// Its three sides, mm.
    pub size_mm: [f64; 3],
    /// How many there are.
    pub count: u32,
}

/// Where blocks come from.
#[derive(Debug, Clone, PartialEq)]
pub enum BlockSource {
    /// A TOML file, relative to the job file.
    Catalogue(PathBuf),
    /// A list in the job.
    Blocks(Vec<BlockSpec>),
}

/// `[stock]`.
#[derive(Debug, Clone, PartialEq)]
pub struct StockSpec {
    /// Blocks.
    pub source: BlockSource,
    /// Material left on either side of the part along x, y and z, mm.
    pub gap_mm: [f64; 3],
    /// Height of the gripped zone at the lower end in z, beside the gap, mm.
    pub grip_mm: f64,
}

/// Shape of a cutter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CutterKind {
    /// A flat end.
    Flat,
    /// A half ball.
    Ball,
    /// A flat end with rounded corners.
    Bull,
}

/// `[tool]`.
#[derive(Debug, Clone, PartialEq)]
pub struct CutterSpec {
    /// Shape.
    pub kind: CutterKind,
    /// Diameter, mm.
    pub diameter_mm: f64,
    /// Radius of the corner between end and side, mm: 0 for a flat end, half the diameter for a ball.
    pub corner_radius_mm: f64,
    /// Cutting edges.
    pub flutes: u32,
    /// From the tip to the holder, mm.
    pub length_mm: f64,
    /// Length and radius of the holder's cylinders from below, mm.
    pub holder_mm: Vec<[f64; 2]>,
}

/// Sense of cut beside the stock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CutSense {
    /// The teeth come out of the stock with the thin end of the chip.
    Climb,
    /// The other way.
    Conventional,
}

/// `[process]`. Shares are of the cutter's diameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProcessSpec {
    /// Spindle speed, rpm.
    pub spindle_rpm: f64,
    /// Feed a tooth, mm.
    pub feed_per_tooth_mm: f64,
    /// Greatest width of a cut.
    pub side_load: f64,
    /// Depth of a roughing level.
    pub depth_of_cut: f64,
    /// Greatest height of what finishing leaves, along the surface's normal, mm.
    pub finishing_step_mm: f64,
    /// Thickness of the holding strip, mm.
    pub strip_mm: f64,
    /// Height of repositioning moves above the stock, mm.
    pub clearance_mm: f64,
    /// Sense of cut.
    pub sense: CutSense,
}

/// What moves the cutter against the part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MachineKind {
    /// Three linear axes and a rotary one.
    FiveAxis,
    /// A robot arm.
    Ur(UrModel),
}

/// What an arm holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OnFlange {
    /// The spindle; a table turns the block between the sides.
    Spindle,
    /// The part in its block, by the block's grip; the spindle stands still.
    Part,
}

/// Whose G-code a program is written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GCode {
    /// LinuxCNC.
    LinuxCnc,
    /// Fanuc.
    Fanuc,
    /// Haas.
    Haas,
}

/// `[machine]`.
#[derive(Debug, Clone, PartialEq)]
pub struct MachineSpec {
    /// Kind.
    pub kind: MachineKind,
    /// Whose G-code its program is written in.
    pub dialect: GCode,
    /// What it holds, if it is an arm; [`OnFlange::Spindle`] for a milling machine.
    pub on_flange: OnFlange,
    /// Travel of the machine's X, Y and Z, mm.
    pub travel_mm: [f64; 3],
    /// Angles that the rotary axis reaches, lowest and highest, rad.
    pub rotary_range_rad: [f64; 2],
    /// Fastest feed, mm/min.
    pub max_feed_mm_min: f64,
    /// Speed of repositioning, mm/min.
    pub rapid_mm_min: f64,
    /// Speed of the rotary axis, rad/s.
    pub rotary_rad_s: f64,
    /// Acceleration of an axis, mm/s².
    pub acceleration_mm_s2: f64,
    /// Jerk of an axis, mm/s³.
    pub jerk_mm_s3: f64,
    /// The time that there is, min.
    pub max_time_min: Option<f64>,
}

pub(crate) use keys::entries;

/// The keys of a job file as Markdown.
pub fn reference() -> String {
    let introduction = "# The job file of a prosthesis\n\nA TOML file. Only `part.stl` must be given; every other key has the default below. A key that is not \
        listed is an error, and so are numbers that are not finite or outside the range. `C` is Castelli et al. 2020; `assumed` marks what no \
        source gives.\n\nThis page is generated from the table that the parser uses: `bonemill keys --prosthesis` prints it.\n";
    crate::reference::markdown(introduction, &entries())
}

#[cfg(test)]
mod tests;
