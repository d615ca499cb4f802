//! Helpers and bodies that tests of several crates share.

pub mod pocket;

use std::io::Write;

/// A configuration of the crate proptest with which property tests draw the same cases in every run.
#[macro_export]
macro_rules! fixed {
    ($cases:expr) => {
        proptest::test_runner::Config {
            cases: $cases,
            rng_seed: proptest::test_runner::RngSeed::Fixed(20_161_201),
            failure_persistence: None,
            ..Default::default()
        }
    };
}

/// Says that a test is left out and why, past what the test runner holds back: `.ci/run` counts these lines.
pub fn skipped(why: impl std::fmt::Display) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let _ = writeln!(std::io::stderr(), "SKIPPED: {test}: {why}");
}
