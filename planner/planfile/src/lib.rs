//! A plan's files: `plan.toml`, `waypoints.csv` and the directory that holds them, written whole or not at all.
//!
//! Nothing in these files depends on the time, the place or the number of threads, so that two runs can be compared byte by
//! byte. A plan is bound to its inputs by their SHA-256; reading a plan whose inputs changed is an error.

mod addition;
mod cells;
mod channel;
pub mod columns;
mod contents;
mod csv;
mod cutting_edges;
mod directory;
mod dropped;
mod error;
mod files;
mod force_log;
mod forces;
mod gaps;
mod hash;
mod holds;
mod inputs;
pub mod page;
mod plunge;
mod record;
mod stored;
pub mod toward;
mod trajectory;
mod value;
mod verdict;
mod waypoint;

pub use addition::{REPORT, ReportPart, add_to_report, replace};
pub use cells::{push_number, structure_name};
pub use channel::ChannelRecord;
pub use contents::PlanContents;
pub use csv::{read_waypoints, write_waypoints};
pub use cutting_edges::read_cutting_edges;
pub use directory::{
    PROSTHESIS_HEADER, Replace, SCENE_HEADER, StagedDirectory, is_prosthesis, relative_path,
};
pub use dropped::read_dropped;
pub use error::{MissingInput, PlanFileError};
pub use files::{FILES, NOTES, copy_files};
pub use force_log::{DrillLogRow, ForceLogRow, read_drill_log, read_force_log};
pub use forces::{FORCES, ForceToward, read_forces, write_forces};
pub use gaps::{Gap, least_gaps};
pub use hash::Sha256;
pub use holds::{HoldPoint, hold_points};
pub use inputs::{CASE_COPY, FoundInputs, KEPT, Need, copy_input, pack_inputs};
pub use plunge::{PLUNGE, PlungeRow, plunge_text};
pub use record::{Input, Metrics, PlanFrames, PlanRecord, PlanningGrid};
pub use stored::StoredPlan;
pub use trajectory::Trajectory;
pub use value::Value;
pub use verdict::{Unverified, VERDICT, Verified, digests, read_case_text, verified};
pub use waypoint::Waypoint;
