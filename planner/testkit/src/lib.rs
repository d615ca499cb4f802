//! Helpers and bodies that tests of several crates share.

pub mod pocket;

/// A configuration with which property tests draw the same cases in every run.
pub fn fixed(cases: u32) -> proptest::test_runner::Config {
    let rng_seed = proptest::test_runner::RngSeed::Fixed(20_161_201);
    proptest::test_runner::Config { cases, rng_seed, failure_persistence: None, ..Default::default() }
}
