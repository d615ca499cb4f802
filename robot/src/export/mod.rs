//! Writes trajectories in the formats of controllers, to a writer that the caller opens.
//!
//! Input is in mm and rad; ROS and UR formats are in metres and rad, G-code in mm and degrees. A test reads each format
//! back and compares it. Numbers are decimals with a fixed resolution, so the same motion gives the same bytes.

mod blocks;
mod csv;
mod decimal;
mod gcode;
mod ros;
mod rows;
mod scene;
mod urscript;

pub use blocks::{JointMove, Tolerance, straight_blocks};
pub use csv::write_trajectory_csv;
pub use gcode::{Gcode, GcodeMove, is_cartesian, write_gcode};
pub use ros::{write_ros_json, write_ros_yaml};
pub use rows::{Between, ExportRows};
pub use scene::planning_scene;
pub use urscript::{ScriptHold, ScriptNotes, UrScript, write_urscript};
