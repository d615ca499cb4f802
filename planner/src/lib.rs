//! Plans how a robot mills bone: path, burr angle, speed and forces from a CT with vital structures (Dillon et al. 2016).
//!
//! This crate re-exports the planner's crates under one name. Data flows one way: [`case`] -> [`scene`] -> [`path`] with its
//! [`removal`] times -> [`access`] -> [`engagement`] -> [`orientation`] -> forces ([`burr`]) -> [`speed`] -> joint trajectory -> files
//! ([`plan`](mod@plan)). [`pipeline`] calls these stages in that order, and [`stages`] lists those of every job.
//!
//! Units are mm, s, N, rad, g/cm³, mg. Library code prints nothing and does not panic on data.

pub mod pages;
pub mod stages;

pub use bonemill_case as case;
pub use bonemill_channel as channel;
pub use bonemill_cutting::cutter::{self as cutter, ball};
pub use bonemill_cutting::stock::{removal, runs, sweep, voxels};
pub use bonemill_cutting::{burr, calibrate, cost, edge, metrics, speed};
pub use bonemill_geometry::Progress;
pub use bonemill_imaging::part;
pub use bonemill_pipeline::{self as pipeline, Plan, plan};
pub use bonemill_planfile::{self as plan, toward};
pub use bonemill_setup::{PlanError, Setup, Stopwatch, mesh_tool, room, stand, survey};
pub use bonemill_simulate as simulate;
pub use bonemill_toolpath::scene;
pub use bonemill_toolpath::{access, engagement, orientation, path, space};
pub use bonemill_verify::{self as verify, uncertainty};
pub use pages::{compare, report, run, save, show, slicer, stream_input};
