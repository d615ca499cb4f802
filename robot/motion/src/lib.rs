//! Motion: joint vectors along a path of points and axes ([`resolve`]), and the law of time along them ([`timelaw`]), which keeps
//! velocity, acceleration and jerk limits at every instant.
//!
//! Same input, same output, bit for bit, on any number of threads.

pub mod resolve;
pub mod timelaw;
