//! A small patient for tests of the command: images as bytes that are easy to damage, a case, and a folder for planning.

pub mod body;
pub mod faults;
pub mod figure_faults;
pub mod figures;
pub mod force_faults;
pub mod image;
pub mod place;
pub mod relay;
