//! Motion: joint vectors along a path of points and axes ([`resolve`]), and the time law along them ([`timelaw`]), which
//! keeps velocity, acceleration and jerk limits at every instant.
//!
//! The same input gives the same output, bit for bit, on any number of threads.

pub mod resolve;
pub mod timelaw;
