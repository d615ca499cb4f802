//! placeholder

pub mod ball;
pub mod burr;
pub mod cost;
pub mod metrics;
pub mod mrr;
pub mod speed;
