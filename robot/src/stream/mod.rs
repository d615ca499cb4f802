//! Streaming: a plan's motion to an arm, judged in millimetres, bounded whatever breaks, resumable.
//!
//! A [`StreamPlan`] is checked once: rows, limits, the clearance that is left in every row, and how fast each may be passed so that
//! the burr's travel after any failure stays below it ([`bound`]). A [`Session`] makes every decision of a run, step by step, and
//! touches no arm, clock or file. [`drive`] carries them out over an [`ArmLink`] and a [`Clock`]: hardware, a rehearsal, or the
//! [`simulated`] arm in simulated time, which is how faults are tried by the million. [`log`] writes what happened and reads it back.
//!
//! Invariants: no target on a state older than 20 ms or after a fault; tolerances are never wider than the clearance left; what was
//! missed is never caught up; every wait has a deadline; the same inputs give the same decisions. Not here: sockets, clients of
//! controllers, files, the planner.

#![allow(
    clippy::neg_cmp_op_on_partial_ord,
    reason = "what is not a number must fail a check, so checks say what holds"
)]

pub mod approach;
mod bend;
pub mod bound;
mod cause;
mod check;
mod drive;
mod error;
mod follower;
mod link;
pub mod log;
mod plan;
mod session;
mod settings;
pub mod simulated;
mod track;
mod tube;
mod watch;

pub(crate) use check::{TOOL_MM, TOOL_RAD};

pub use cause::{Cause, Event, Question, RunEnd, SpindleEnd};
pub use drive::{Operator, drive};
pub use error::StreamError;
pub use link::{
    ArmLink, ArmState, Clock, Identity, Joints, LinkFault, Order, PLAYING, ROBOT_RUNNING, SAFETY_NORMAL,
    STOPPED,
};
pub use log::{Aside, Log, LogWriter};
pub use plan::{HoldPlace, Near, Standing, StreamInput, StreamPlan, StructureKept, WaypointNear};
pub use session::{Decision, Seen, Session};
pub use settings::{Settings, StreamTiming};
pub use track::Track;
