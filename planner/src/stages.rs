//! The stages of every job, by the names that [`Progress::stage`](crate::Progress::stage) is told, in the order in which they first begin.
//!
//! They are told to [`Progress::expect`](crate::Progress::expect) by whoever runs a job, since what is written before and after it differs.

/// Drawing a phantom.
pub const PHANTOM: &[&str] = &["make phantom", "write phantom"];
/// [`crate::plan()`].
pub const PLAN: &[&str] = &[
    "read images",
    "scene",
    "free space",
    "solid",
    "arm",
    "references",
    "lines",
    "path",
    "access",
    "engagement",
    "orientation",
    "inverse kinematics",
    "forces",
    "time law, coverage",
];
/// [`crate::channel::plan`].
pub const CHANNEL: &[&str] = &["read images", "channel", "scene", "joints"];
/// [`crate::verify::verify`] of a milled target.
pub const VERIFY: &[&str] = &[
    "read images",
    "check motion",
    "check rows",
    "check forces",
    "check clearances",
    "classify bone",
    "count voxels",
    "remove bone",
    "check shank",
];
/// [`crate::verify::verify`] of a channel.
pub const VERIFY_CHANNEL: &[&str] = &["read images", "check motion", "check the channel"];
/// [`crate::uncertainty::simulate_errors`].
pub const DRAW_ERRORS: &[&str] = &["draw errors"];
/// [`crate::simulate::simulate`] of a milled target.
pub const SIMULATE: &[&str] = &["read images", "scene", "forward kinematics", "simulate", "distances"];
/// [`crate::simulate::simulate`] of a channel.
pub const SIMULATE_CHANNEL: &[&str] = &["read images", "forward kinematics", "simulate"];
/// A burr's coefficients from a log.
pub const CALIBRATE: &[&str] = &["read images", "scene", "mill along the log", "fit"];
