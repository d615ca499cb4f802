//! The burr's free space, its path, its engagement, and the shaft's free directions.
//!
//! Data flows [`space`] -> [`path`] with its removal times -> [`access`] of the shank and [`engagement`] of the burr ->
//! [`orientation`], the choice among free directions.

pub mod access;
pub mod engagement;
pub mod neighbours;
pub mod orientation;
pub mod path;
pub mod scene;
pub mod space;
