//! The arm along a planned path: joint positions, compliance, and the law of time with its file. Shared by all pipelines.
//!
//! A pipeline plans points and unit axes in work. This crate gives the joint vectors that lead through them ([`Placed`]), the arm's
//! compliance on the way ([`Compliance`]), its figures ([`ArmFacts`]), the limits of its time law
//! ([`path_limits`]), and `trajectory.csv` ([`write_trajectory`]). Which path, which axes and which speeds is not decided here.

mod compliance;
mod facts;
mod law;
mod link_distance;
mod placed;

pub use compliance::Compliance;
pub use facts::{ArmFacts, LowestLink, Stiffnesses};
pub use law::{path_limits, write_trajectory};
pub use link_distance::{LinkDistance, WHAT_TO_CHANGE};
pub use placed::{ArmMotion, Placed};
