//! CT and labels in, scene out.

pub mod surface;
