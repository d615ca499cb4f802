//! The stages of every job, by the names that [`Progress::stage`](crate::Progress::stage) is told, in the order in which they first begin,
//! each with how long it takes until the next begins, in tenths of a second: on the temporal phantom, and on the tibia for a channel.
//! Drawing errors and calibrating depend on how much is asked for; their figures are guesses.
//!
//! They are told to [`Progress::expect`](crate::Progress::expect) by whoever runs a job, since what is written before and after it
//! differs.

use bonemill_case::{Case, Job};
use bonemill_geometry::Stage;

/// Before a plan is worked on.
pub const READ_PLAN: Stage = ("read plan", 3);
/// After a plan or a simulation.
pub const WRITE_FILES: Stage = ("write files", 2);
/// After a verification.
pub const WRITE_VERDICT: Stage = ("write verdict", 1);
/// Drawing a phantom.
pub const PHANTOM: &[Stage] = &[("make phantom", 2), ("write phantom", 1)];
/// [`crate::plan()`].
pub const PLAN: &[Stage] = &[
    ("read images", 1),
    ("scene", 5),
    ("free space", 1),
    ("solid", 1),
    ("arm", 1),
    ("references", 36),
    ("lines", 43),
    ("path", 2),
    ("access", 10),
    ("engagement", 1),
    ("orientation", 8),
    ("inverse kinematics", 1),
    ("forces", 43),
    ("time law, coverage", 24),
];
/// [`crate::channel::plan`].
pub const CHANNEL: &[Stage] = &[("read images", 1), ("channel", 1), ("scene", 2), ("joints", 2)];
/// [`crate::stand::search`].
pub const STAND: &[Stage] = &[("read images", 1), ("scene", 5), ("places", 100)];
/// [`crate::verify::verify`] of a milled target.
pub const VERIFY: &[Stage] = &[
    ("read images", 2),
    ("check motion", 5),
    ("check links", 1),
    ("check rows", 3),
    ("check forces", 45),
    ("check clearances", 12),
    ("classify bone", 17),
    ("count voxels", 12),
    ("remove bone", 16),
    ("check shank", 5),
];
/// [`crate::verify::verify`] of a channel.
pub const VERIFY_CHANNEL: &[Stage] =
    &[("read images", 1), ("check motion", 1), ("check links", 1), ("check the channel", 3)];
/// [`crate::uncertainty::simulate_errors`].
pub const DRAW_ERRORS: &[Stage] = &[("draw errors", 20)];
/// [`crate::simulate::simulate`] of a milled target.
pub const SIMULATE: &[Stage] =
    &[("read images", 1), ("scene", 4), ("forward kinematics", 6), ("simulate", 13), ("distances", 1)];
/// [`crate::simulate::simulate`] of a channel.
pub const SIMULATE_CHANNEL: &[Stage] = &[("read images", 1), ("forward kinematics", 2), ("simulate", 1)];
/// [`crate::slicer::export`], but for its files.
pub const SLICER: &[Stage] = &[("read images", 1), ("scene", 5), ("removal", 1), ("causes of the rest", 5)];
/// A burr's coefficients from a log.
pub const CALIBRATE: &[Stage] = &[("read images", 1), ("scene", 5), ("mill along the log", 20), ("fit", 5)];

/// Those of [`crate::verify::verify`].
pub fn of_verification(case: &Case) -> &'static [Stage] {
    match case.job {
        Job::Bone => VERIFY,
        Job::Channel(_) => VERIFY_CHANNEL,
    }
}

/// Those of [`crate::simulate::simulate`].
pub fn of_simulation(case: &Case) -> &'static [Stage] {
    match case.job {
        Job::Bone => SIMULATE,
        Job::Channel(_) => SIMULATE_CHANNEL,
    }
}
