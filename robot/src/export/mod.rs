//! Trajectories as bytes. Exporters write to what they are handed; whoever opens a file decides where.

mod csv;
mod decimal;

pub use csv::write_trajectory_csv;
