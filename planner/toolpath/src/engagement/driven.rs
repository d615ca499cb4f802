//! The path as an arm drives it: straight pieces between vertices, of which a rounded corner has several.
//!
//! A piece lies where the burr passes, but its direction is that of a chord. In a rounded corner the burr turns all the way: at the vertex where it
//! leaves a line it still has the line's direction, at one within the corner that between the pieces before and behind, and from one vertex to the
//! next its direction changes from the one to the other. With the chords' directions, a force that begins or ends within the corner would
//! be that of a burr which turns too late or too early, by up to a quarter of the corner where it has two chords.

use std::ops::Range;

use bonemill_geometry::capsule::segment_distance_squared;
use bonemill_geometry::{Point, Work};
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use crate::path::PathPoint;

/// Shorter than this a way has no direction, mm.
const STILL_MM: f64 = 1e-9;
/// A move that comes this near to a rounded corner comes back to it, mm: some times a skin's thickness, beyond which little of the skin
/// is met at once.
const BACK_MM: f64 = 0.06;

/// A corner of a path as an arm rounds it.
#[derive(Debug, Clone, PartialEq)]
pub struct RoundedCorner {
    /// The waypoint at the corner, or several in the same place.
    pub waypoints: Range<usize>,
    /// Places of the burr's centre, as many before the one where it passes the corner as behind: from where it leaves the line before the
    /// corner to where it meets the line behind.
    pub at: Vec<Point<Work>>,
}

/// The driven path.
#[derive(Debug)]
pub(super) struct DrivenPath {
    /// The waypoints, with the places of a rounded corner in the place of one.
    pub vertices: Vec<Vector3<f64>>,
    /// The vertex at which the move to each waypoint ends.
    pub end_of: Vec<u32>,
    /// How many vertices of a rounded corner lie before the one at which it ends; as many lie behind.
    pub rounding: Vec<u32>,
    /// The direction of the line to each waypoint; 0 where the burr does not move.
    lines: Vec<Vector3<f64>>,
}

/// A place on the driven path.
#[derive(Debug, Clone, Copy)]
pub(super) struct DrivenPlace {
    /// The burr's centre.
    pub center: Vector3<f64>,
    /// The direction in which it moves there.
    pub direction: Unit<Vector3<f64>>,
    /// The vertex that it has passed last, and the direction of the way from there.
    pub before: u32,
    pub along: Unit<Vector3<f64>>,
}

impl DrivenPath {
    /// A path whose `corners`, in the path's order, are rounded.
    pub fn new(points: &[PathPoint], corners: &[RoundedCorner]) -> Self {
        let (mut vertices, mut end_of) = (Vec::with_capacity(points.len()), Vec::with_capacity(points.len()));
        let mut rounding = vec![0; points.len()];
        let mut rounded = corners.iter().peekable();
        while end_of.len() < points.len() {
            let i = end_of.len();
            match rounded.next_if(|corner| corner.waypoints.start == i) {
                Some(RoundedCorner { waypoints, at }) => {
                    let before = at.len() as u32 / 2;
                    rounding[waypoints.clone()].fill(before);
                    end_of.resize(waypoints.end, vertices.len() as u32 + before);
                    vertices.extend(at.iter().map(|place| place.coords));
                }
                None => {
                    end_of.push(vertices.len() as u32);
                    vertices.push(points[i].position.coords);
                }
            }
        }
        let line = |i: usize| points[i].position - points[i.saturating_sub(1)].position;
        let lines = (0..points.len()).map(|i| line(i).try_normalize(STILL_MM).unwrap_or_default()).collect();
        Self { vertices, end_of, rounding, lines }
    }

    /// The vertices at which the move to a waypoint begins and ends; `None` where the burr does not move.
    fn ends(&self, index: usize) -> Option<[u32; 2]> {
        let ends = [self.end_of[index.checked_sub(1)?], self.end_of[index]];
        (ends[0] < ends[1]).then_some(ends)
    }

    /// Length of the piece to a vertex, mm.
    fn length_mm(&self, vertex: u32) -> f64 {
        (self.vertices[vertex as usize] - self.vertices[vertex as usize - 1]).norm()
    }

    fn way_mm(&self, [from, to]: [u32; 2]) -> f64 {
        (from + 1..=to).map(|n| self.length_mm(n)).sum()
    }

    /// Direction of the piece to a vertex.
    fn direction_to(&self, vertex: u32) -> Option<Unit<Vector3<f64>>> {
        let (from, to) =
            (self.vertices.get(vertex.checked_sub(1)? as usize)?, self.vertices.get(vertex as usize)?);
        Unit::try_new(to - from, STILL_MM)
    }

    /// The waypoint in whose rounded corner the piece to vertex n lies, on the move to waypoint `index`.
    fn corner(&self, index: usize, [first, last]: [u32; 2], n: u32) -> Option<usize> {
        let is_behind = n <= first + self.rounding[index - 1];
        let corner = if is_behind { index - 1 } else { index };
        (is_behind || n > last - self.rounding[index]).then_some(corner)
    }

    /// The direction in which the burr passes a vertex of the rounded corner at a waypoint.
    fn direction_at(&self, waypoint: usize, vertex: u32) -> Vector3<f64> {
        let (middle, half) = (self.end_of[waypoint], self.rounding[waypoint]);
        let piece = |n: u32| self.direction_to(n).map_or_else(Vector3::zeros, Unit::into_inner);
        if vertex == middle - half {
            self.lines[self.end_of.partition_point(|end| *end < middle)]
        } else if vertex == middle + half {
            let behind = self.end_of.partition_point(|end| *end <= middle);
            self.lines.get(behind).copied().unwrap_or_default()
        } else {
            (piece(vertex) + piece(vertex + 1)).try_normalize(STILL_MM).unwrap_or_default()
        }
    }

    /// The place at a share, 0 to 1, of the way of the move to a waypoint; `None` where the burr does not move. Beyond 1: at the move's end, turned by the
    /// rest of the share from its direction to that of the next move.
    pub fn place(&self, index: usize, share: f64) -> Option<DrivenPlace> {
        let ends = self.ends(index)?;
        let mut left_mm = share.min(1.0) * self.way_mm(ends);
        let mut n = ends[0] + 1;
        while n < ends[1] && left_mm > self.length_mm(n) {
            left_mm -= self.length_mm(n);
            n += 1;
        }
        let along = self.direction_to(n)?;
        let part = (left_mm / self.length_mm(n)).min(1.0);
        let between = |from: Vector3<f64>, to, part| Unit::try_new(from.lerp(&to, part), STILL_MM);
        let direction = if share > 1.0 {
            between(along.into_inner(), self.direction_to(n + 1)?.into_inner(), share - 1.0)?
        } else if let Some(corner) = self.corner(index, ends, n) {
            let [from, to] = [n - 1, n].map(|vertex| self.direction_at(corner, vertex));
            between(from, to, part).unwrap_or(along)
        } else {
            along
        };
        let [from, to] = [n - 1, n].map(|vertex| self.vertices[vertex as usize]);
        Some(DrivenPlace { center: from.lerp(&to, part), direction, before: n - 1, along })
    }

    /// Places in the rounded corners of the move to a waypoint, as shares of its way: at each of the `fractions` of every piece there.
    pub fn in_corners(&self, index: usize, fractions: &[f64]) -> Vec<f64> {
        let Some(ends) = self.ends(index) else { return Vec::new() };
        let way_mm = self.way_mm(ends);
        let places = |n: u32| {
            let (before_mm, length_mm) = (self.way_mm([ends[0], n - 1]), self.length_mm(n));
            fractions.iter().map(move |fraction| (before_mm + fraction * length_mm) / way_mm)
        };
        let is_in = |n: &u32| way_mm > 0.0 && self.corner(index, ends, *n).is_some();
        (ends[0] + 1..=ends[1]).filter(is_in).flat_map(places).collect()
    }
}

/// Where each move comes nearest to the corner of a move before the one before it.
pub(super) fn comes_back(points: &[PathPoint], corners: &[RoundedCorner]) -> Vec<Option<f64>> {
    let at = |i: usize| points[i].position.coords;
    let corners: Vec<_> =
        corners.iter().map(|corner| (corner.waypoints.end, at(corner.waypoints.start))).collect();
    let comes_back = |i: usize| {
        let (from, to) = (at(i.checked_sub(1)?), at(i));
        let earlier = corners.iter().take_while(|(behind, _)| *behind < i);
        let away = earlier.map(|(_, corner)| (segment_distance_squared(corner, &from, &to), corner));
        let (squared, corner) = away.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let along = to - from;
        let share = (corner - from).dot(&along) / along.norm_squared().max(f64::MIN_POSITIVE);
        (squared < BACK_MM * BACK_MM).then(|| share.clamp(0.0, 1.0))
    };
    (0..points.len()).into_par_iter().map(comes_back).collect()
}
