//! Plans how a robot mills bone: path, burr angle, speed and forces from a CT with vital structures (Dillon et al. 2016).
//!
//! Data flows one way: case → scene → [`path`] with its [`removal`] times → [`access`] → [`engagement`] →
//! [`orientation`] → forces ([`burr`]) → [`speed`] → joint trajectory → files ([`plan`](mod@plan)). [`pipeline`] is that order and
//! nothing else. A ball's sweep does not depend on the shaft, so the move that removes each voxel is one static field;
//! that makes waypoints independent, and everything after the path parallel.
//!
//! Units are mm, s, N, rad, g/cm³, mg. Library code prints nothing and does not panic on data; only [`plan`](mod@plan) touches files.

pub mod access;
pub mod ball;
pub mod burr;
pub mod calibrate;
pub mod case;
pub mod compare;
pub mod cost;
pub mod engagement;
pub mod metrics;
pub mod mrr;
mod neighbours;
pub mod orientation;
pub mod path;
mod percent;
pub mod pipeline;
pub mod plan;
mod progress;
pub mod removal;
pub mod report;
pub mod runs;
pub mod show;
pub mod simulate;
pub mod space;
pub mod speed;
pub mod sweep;
pub mod toward;
pub mod uncertainty;
pub mod verify;
pub mod voxels;

pub use pipeline::{Plan, PlanError, plan};
pub use progress::Progress;

/// Property tests of this crate draw the same cases in every run.
#[cfg(test)]
fn fixed(cases: u32) -> proptest::test_runner::Config {
    let rng_seed = proptest::test_runner::RngSeed::Fixed(20_161_201);
    proptest::test_runner::Config { cases, rng_seed, failure_persistence: None, ..Default::default() }
}
