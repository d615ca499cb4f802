//! Trajectories as bytes. Exporters write to what they are handed; whoever opens a file decides where.
//!
//! Inside everything is mm and rad; ROS and UR get metres, G-code mm and degrees. Each format is read back and compared in a
//! test. Numbers are decimals with a fixed resolution, so that the same motion is the same bytes.

mod blocks;
mod csv;
mod decimal;
mod gcode;
mod ros;
mod rows;
mod urscript;

pub use blocks::{Block, Tolerance, straight_blocks};
pub use csv::write_trajectory_csv;
pub use gcode::{Gcode, GcodeMove, is_cartesian, write_gcode};
pub use ros::{write_ros_json, write_ros_yaml};
pub use rows::{Between, ExportRows};
pub use urscript::{UrScript, write_urscript};
