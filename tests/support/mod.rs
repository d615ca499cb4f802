//! A small patient for tests of the command: images as bytes that are easy to damage, a case, and a folder for planning.

#![allow(dead_code, reason = "every test program uses its own part of it")]
#![allow(clippy::panic, reason = "a test's helper fails by panicking")]

pub mod body;
pub mod faults;
pub mod figure_faults;
pub mod figures;
pub mod force_faults;
pub mod image;
pub mod place;
pub mod relay;
