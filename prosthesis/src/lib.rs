//! A prosthesis from its file to a proven program: the order of the stages, and the folder that is written.
//!
//! ```text
//! job.toml -> part (read, checked, repaired) -> laid into a block -> block from stock -> toolpath -> program -> proof -> files
//! ```
//!
//! [`plan`] runs the stages, [`save`] writes the folder, [`verify`](mod@verify) judges a folder by the program that stands in it. Invariants: the mesh that is
//! planned is the one in part.stl, bit for bit; a block that was taken from a catalogue goes back unless the plan was kept; nothing
//! in the files depends on when, where or on how many threads they were made.
//!
//! [`orient`] lays the part into a block's frame, [`machining`] plans how it is milled, [`program`] writes that down, and [`proof`] judges the program; it
//! knows geometry and itself only, which `tests/tidy.rs` checks. Not here: how a part is read and repaired ([`bonemill_imaging::part`]).

mod block;
pub mod catalogue;
mod error;
mod figures;
pub mod machining;
pub mod orient;
pub mod phantom;
mod picture;
mod placing;
mod plan;
pub mod program;
pub mod proof;
mod record;
mod report;
mod robot;
mod save;
mod settings;
pub mod show;
mod toolpath_csv;
pub mod verify;

use bonemill_geometry::Stage;

pub use block::TakenBlock;
pub use error::ProsthesisError;
pub use placing::Placing;
pub use plan::{ProsthesisPlan, Trial, most_uncut_mm, plan, read_part};
pub use record::{JobRecord, sealed};
pub use robot::RobotMotion;
pub use save::save;

/// Deepest cut into the part that a plan may have, mm.
pub const MOST_GOUGE_MM: f64 = crate::machining::GOUGE_TOLERANCE_MM;

/// The stages of [`plan()`], by the names that [`Progress::stage`](bonemill_geometry::Progress::stage) is told, each with its tenths of a
/// second for the drawn prosthesis, seed 1. An arm was not measured.
pub const STAGES: &[Stage] = &[
    ("read part", 1),
    ("lay part", 5),
    ("take block", 1),
    ("plan toolpath", 27),
    ("write program", 1),
    ("prove program", 31),
    ("move arm", 1),
];
/// Those of [`verify::verify`].
pub const VERIFY_STAGES: &[Stage] = &[("read files", 2), ("prove program", 31), ("compare toolpath", 4)];
