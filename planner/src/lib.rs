//! placeholder

pub mod ball;
pub mod burr;
pub mod cost;
pub mod metrics;
pub mod mrr;
pub mod speed;

/// Property tests of this crate draw the same cases in every run.
#[cfg(test)]
fn fixed(cases: u32) -> proptest::test_runner::Config {
    let rng_seed = proptest::test_runner::RngSeed::Fixed(20_161_201);
    proptest::test_runner::Config { cases, rng_seed, failure_persistence: None, ..Default::default() }
}
