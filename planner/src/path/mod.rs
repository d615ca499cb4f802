//! The burr's path (D II-A): layers along the approach, serpentine lines, finishing along what the lines leave, links.
//!
//! A [`Pass`] is a polyline that cuts; the [`Builder`] joins passes by links through free space and keeps the
//! removal-time field. Roughing ([`rough`]) lays straight lines layer by layer, each following the floor of the free
//! space where that is higher than the layer. Their cusps along walls and floors are a few per cent of the volume;
//! finishing ([`finish`]) follows exactly the voxels that are left.
//!
//! Invariants: every position is clear ([`BurrSpace::is_clear`]); a link or retract removes no material; the path is the
//! same for any number of threads.

mod builder;
mod finish;
mod raster;
mod rough;
mod search;

pub use builder::Builder;
pub use raster::RasterFrame;

use std::collections::HashSet;

use bonemill_geometry::{Point, Work};

use crate::removal::RemovalTime;
use crate::space::BurrSpace;

/// What a move is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum MoveKind {
    /// Removes bone, or lies between moves that do.
    Cut,
    /// Crosses free space.
    Link,
    /// Goes out of the bone along the approach, or back in.
    Retract,
}

impl MoveKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Cut, Self::Link, Self::Retract];

    /// The word in files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Cut => "cut",
            Self::Link => "link",
            Self::Retract => "retract",
        }
    }

    /// The kind of a word in a file.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.word() == word)
    }
}

/// One position of the burr's centre; kind and layer belong to the move that ends here.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Burr's centre.
    pub position: Point<Work>,
    /// What the move is for.
    pub kind: MoveKind,
    /// Layer, 0 at the top; finishing has the number after the last layer.
    pub layer: u32,
    /// The point of a pass that the move leads to: (pass, point).
    pub leads_to: (u32, u32),
}

/// A polyline that cuts.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// Its layer.
    pub layer: u32,
    /// Positions of the burr's centre, at least one.
    pub points: Vec<Point<Work>>,
}

/// Lengths that shape the path, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSpacing {
    /// Depth of a layer.
    pub layer_mm: f64,
    /// Distance of neighbouring lines.
    pub stepover_mm: f64,
    /// Distance of neighbouring waypoints.
    pub step_mm: f64,
}

/// A path with its removal-time field and the passes that it is made of.
#[derive(Debug)]
pub struct MillPath {
    /// Waypoints; the first stands in free space.
    pub points: Vec<PathPoint>,
    /// T(x): the waypoint whose move first covers a voxel.
    pub removal: RemovalTime,
    /// What it is made of.
    pub passes: Vec<Pass>,
    /// Passes that no link could join.
    pub unjoined: usize,
    /// Milling layers, finishing not counted.
    pub layers: u32,
}

/// Lays the path through all that the ball can reach.
pub fn lay_path(space: &BurrSpace, spacing: PathSpacing, frame: &RasterFrame) -> MillPath {
    let mut builder = Builder::new(space, spacing);
    let layers = rough::rough(&mut builder, frame);
    finish::finish(&mut builder, layers);
    builder.into_path(layers)
}

/// The roughing alone: what a comparison of directions needs.
pub fn lay_rough(space: &BurrSpace, spacing: PathSpacing, frame: &RasterFrame) -> MillPath {
    let mut builder = Builder::new(space, spacing);
    let layers = rough::rough(&mut builder, frame);
    builder.into_path(layers)
}

/// What is left of the passes without some of their points: passes fall apart where points are missing.
pub fn without_points(passes: &[Pass], dropped: &HashSet<(u32, u32)>) -> Vec<Pass> {
    let mut left = Vec::new();
    for (pass, number) in passes.iter().zip(0u32..) {
        let mut points = Vec::new();
        for (point, n) in pass.points.iter().zip(0u32..) {
            if !dropped.contains(&(number, n)) {
                points.push(*point);
            } else if !points.is_empty() {
                left.push(Pass { layer: pass.layer, points: std::mem::take(&mut points) });
            }
        }
        if !points.is_empty() {
            left.push(Pass { layer: pass.layer, points });
        }
    }
    left
}

/// The same passes, or what is left of them, joined anew.
pub fn join_passes(space: &BurrSpace, spacing: PathSpacing, passes: Vec<Pass>, layers: u32) -> MillPath {
    let mut builder = Builder::new(space, spacing);
    for pass in passes {
        builder.add(pass);
    }
    builder.into_path(layers)
}
