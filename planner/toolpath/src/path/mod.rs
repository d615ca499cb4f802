//! The burr's path (D II-A): layers along the approach, serpentine lines, finishing passes, links.
//!
//! A [`Pass`] is a polyline of cuts; the [`Builder`] joins passes by links through free space and keeps the removal-time
//! field. Roughing (`rough`) lays straight lines layer by layer; a line follows the floor of the free space where that is
//! higher than the layer. The cusps that remain along walls and floors are a few per cent of the volume; finishing
//! (`finish`) follows the voxels that are left.
//!
//! Invariants: every position is clear ([`BurrSpace::is_clear`]); a link or retract removes no material; the path is the
//! same for any number of threads.

mod ball_rows;
mod builder;
mod cells;
mod finish;
mod raster;
mod rough;
mod search;

pub use bonemill_cutting::cutter::MoveKind;
pub use builder::Builder;
pub use raster::{Lines, RasterFrame, SenseRule};

use std::collections::HashSet;

use bonemill_cutting::stock::removal::RemovalTime;
use bonemill_geometry::{Point, Work};

use crate::space::BurrSpace;

/// One position of the burr's centre; kind and layer belong to the move that ends here.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathPoint {
    /// Burr's centre.
    pub position: Point<Work>,
    /// What the move is for.
    pub kind: MoveKind,
    /// Layer, 0 at the top; finishing passes have the number after the last layer.
    pub layer: u32,
    /// The point of a pass to which the move leads: (pass, point).
    pub leads_to: (u32, u32),
}

/// The burr's centres along a path.
pub fn centers(points: &[PathPoint]) -> Vec<Point<Work>> {
    points.iter().map(|point| point.position).collect()
}

/// A polyline of cuts.
#[derive(Debug, Clone, PartialEq)]
pub struct Pass {
    /// Its layer.
    pub layer: u32,
    /// Positions of the burr's centre, at least one.
    pub points: Vec<Point<Work>>,
    /// Whether the pass was put off: at its original place in the order the shank had no free direction, or the burr pushed toward a structure.
    pub put_off: bool,
    /// Whether the burr must enter from above the bone, where the shaft turns freely, because it cannot turn on the way from the
    /// pass before.
    pub from_above: bool,
}

/// Lengths that shape the path, mm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathSpacing {
    /// Thickness of a layer.
    pub layer_mm: f64,
    /// Distance of neighbouring lines.
    pub stepover_mm: f64,
    /// Distance of neighbouring waypoints.
    pub step_mm: f64,
}

/// A path with its removal-time field and its passes.
#[derive(Debug)]
pub struct MillPath {
    /// Waypoints; the first stands in free space.
    pub points: Vec<PathPoint>,
    /// T(x): the waypoint whose move first covers a voxel.
    pub removal: RemovalTime,
    /// The passes, in the order in which they are cut.
    pub passes: Vec<Pass>,
    /// Number of passes that no link could join.
    pub unjoined: usize,
    /// Number of roughing layers.
    pub layers: u32,
}

/// Relative rounding error of a step.
pub const STEP_ROUNDING: f64 = 1e-9;

impl MillPath {
    /// The same path with some of its moves divided into steps of at most `step_mm`.
    pub fn stepped(&self, space: &BurrSpace, moves: &HashSet<usize>, step_mm: f64) -> Self {
        let mut points = Vec::with_capacity(self.points.len() + 4 * moves.len());
        for (i, point) in self.points.iter().enumerate() {
            if let Some(from) =
                i.checked_sub(1).filter(|_| moves.contains(&i)).map(|i| self.points[i].position)
            {
                let count = pieces(from.distance_mm(&point.position), step_mm);
                let at = |n: usize| from + (point.position - from) * (n as f64 / count as f64);
                points.extend((1..count).map(|n| PathPoint { position: at(n), ..*point }));
            }
            points.push(*point);
        }
        let mut removal = RemovalTime::new(space.grid());
        removal.sweep(0..points.len() as u32, |n| points[n as usize].position, space.ball(), |_| ());
        let Self { passes, unjoined, layers, .. } = self;
        Self { points, removal, passes: passes.clone(), unjoined: *unjoined, layers: *layers }
    }
}

/// Number of equal steps of at most `step_mm` in a length, at least 1.
fn pieces(length_mm: f64, step_mm: f64) -> usize {
    // a length that exceeds the step by rounding is still one step
    (length_mm / (step_mm * (1.0 + STEP_ROUNDING))).ceil().max(1.0) as usize
}

/// Lays the path through all target that the ball can reach.
pub fn lay_path(space: &BurrSpace, spacing: PathSpacing, lines: &Lines) -> MillPath {
    let mut builder = Builder::new(space, spacing);
    let layers = rough::rough(&mut builder, lines);
    finish::finish(&mut builder, layers, lines);
    builder.into_path(layers)
}

/// The passes without some of their points; a pass is divided where points are missing. The missing points become passes at
/// the end, as layer `layer`, when more bone is removed; points that were put off before are left out.
pub fn put_off_points(passes: &[Pass], points: &HashSet<(u32, u32)>, layer: u32) -> Vec<Pass> {
    let (mut kept, mut put_off) = (Vec::new(), Vec::new());
    for (pass, number) in passes.iter().zip(0u32..) {
        let is_out = |n: &u32| points.contains(&(number, *n));
        let numbers: Vec<u32> = (0..pass.points.len() as u32).collect();
        for run in numbers.chunk_by(|a, b| is_out(a) == is_out(b)) {
            let points = run.iter().map(|n| pass.points[*n as usize]).collect();
            if !is_out(&run[0]) {
                kept.push(Pass { points, from_above: pass.from_above && run[0] == 0, ..*pass });
            } else if !pass.put_off {
                put_off.push(Pass { layer, points, put_off: true, from_above: false });
            }
        }
    }
    kept.extend(put_off);
    kept
}

/// The passes, divided before some of their points; the part that begins there is entered from above the bone.
pub fn enter_from_above(passes: &[Pass], points: &HashSet<(u32, u32)>) -> Vec<Pass> {
    let parts = passes.iter().zip(0u32..).flat_map(|(pass, number)| {
        let is_cut = move |n: usize| points.contains(&(number, n as u32));
        let starts = (0..pass.points.len()).filter(move |n| *n == 0 || is_cut(*n));
        let ends = (1..=pass.points.len()).filter(move |n| *n == pass.points.len() || is_cut(*n));
        starts.zip(ends).map(move |(start, end)| Pass {
            points: pass.points[start..end].to_vec(),
            from_above: is_cut(start) || (start == 0 && pass.from_above),
            ..*pass
        })
    });
    parts.collect()
}

/// Joins passes into a new path. A pass that was put off is left out if it would remove nothing.
pub fn join_passes(space: &BurrSpace, spacing: PathSpacing, passes: Vec<Pass>, layers: u32) -> MillPath {
    let mut builder = Builder::new(space, spacing);
    for pass in passes {
        if !pass.put_off || pass.points.iter().any(|p| builder.gain(*p, 1) > 0) {
            builder.add(pass);
        }
    }
    builder.into_path(layers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_step_is_longer_than_asked_for() {
        let step_mm = 0.25;
        assert_eq!([0.0, 0.1, 0.25, 0.25 * (1.0 + 1e-12)].map(|mm| pieces(mm, step_mm)), [1; 4]);
        assert_eq!([0.2502, 0.5, 1.2].map(|mm| pieces(mm, step_mm)), [2, 2, 5]);
    }

    #[test]
    fn points_are_put_off_once() {
        let at = |n: u32| Point::new(f64::from(n), 0.0, 0.0);
        let pass = |layer, points: &[u32], put_off| Pass {
            layer,
            points: points.iter().map(|n| at(*n)).collect(),
            put_off,
            from_above: false,
        };
        let passes = [pass(0, &[0, 1, 2, 3, 4], false), pass(1, &[5, 6], false), pass(2, &[7, 8, 9], true)];
        let blocked = HashSet::from([(0, 1), (0, 2), (1, 0), (1, 1), (2, 1)]);
        let expected = [
            pass(0, &[0], false),
            pass(0, &[3, 4], false),
            pass(2, &[7], true),
            pass(2, &[9], true),
            pass(2, &[1, 2], true),
            pass(2, &[5, 6], true),
        ];
        assert_eq!(put_off_points(&passes, &blocked, 2), expected);
    }

    #[test]
    fn passes_are_cut_where_the_burr_comes_from_above() {
        let at = |n: u32| Point::new(f64::from(n), 0.0, 0.0);
        let pass = |points: &[u32], put_off, from_above| Pass {
            layer: 3,
            points: points.iter().map(|n| at(*n)).collect(),
            put_off,
            from_above,
        };
        let passes = [pass(&[0, 1, 2, 3], false, false), pass(&[4], true, true), pass(&[5, 6], false, false)];
        let cut = HashSet::from([(0, 1), (0, 3), (2, 0)]);
        let expected = [
            pass(&[0], false, false),
            pass(&[1, 2], false, true),
            pass(&[3], false, true),
            pass(&[4], true, true),
            pass(&[5, 6], false, true),
        ];
        assert_eq!(enter_from_above(&passes, &cut), expected);
    }
}
