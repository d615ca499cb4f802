//! CT and labels in, scene out.

pub mod phantom;
pub mod surface;
