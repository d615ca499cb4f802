//! Where the burr may be, its path, what it meets there, and which directions of the shaft are free.
//!
//! [`space`] -> [`path`] with its removal times -> [`access`] of the shank and [`engagement`] of the burr -> [`orientation`], the
//! choice among free directions.

pub mod access;
pub mod engagement;
mod neighbours;
pub mod orientation;
pub mod path;
pub mod space;
