//! Straight channels: a drill or a reamer pushed along its axis, from a case to a plan.

pub mod axis;
pub mod clearance;
pub mod registration_error;
pub mod risk;
pub mod safest;
pub mod surface;
