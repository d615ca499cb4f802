//! The path of the motion: straight pieces in joint space joined by rounded corners.
//!
//! Invariants: consecutive kept waypoints differ; q(s), q'(s) and q''(s) are continuous except at stops; at equal s burr and
//! axis are within the corner tolerance of the polyline through the kept waypoints, to first order in a corner's size.
//! That polyline differs from the given one by at most the part of the tolerance that merging uses.

use nalgebra::Vector3;

use super::input::{CornerTolerance, JointPath, PathLimits};
use super::merge::{Kept, joint_mm};

/// A corner is long enough when its curvature needs at most this share of the joints' acceleration limit at full joint
/// speed.
const CURVATURE_SHARE: f64 = 0.25;

/// Least length of a corner with little curvature, mm: over shorter lengths differences of ṡ² are rounding errors.
const SHORTEST_BLEND_MM: f64 = 1e-3;

/// A part of the path with one formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PathElement {
    /// Kept segment i, from kept waypoint i to i + 1; x = s − s(i).
    Straight(u32),
    /// Rounded corner about kept waypoint i; x = s − its start, in 0..2l.
    Blend(u32),
}

/// A rounded corner, u = x/(2l) in 0..1: B' = d₁ + (d₂ − d₁)(3u² − 2u³), B = q − l d₁ + x d₁ + 2l (d₂ − d₁)(u³ − u⁴/2).
///
/// B'' = (d₂ − d₁) 6u(1 − u)/(2l) is 0 at both ends, at most 1.5 |d₂ − d₁|/(2l); |B'''| ≤ 6 |d₂ − d₁|/(2l)².
#[derive(Debug, Clone, Copy)]
pub(super) struct Corner<'a> {
    /// d₁, shape (n).
    before: &'a [f64],
    /// d₂, shape (n).
    after: &'a [f64],
    /// l, mm.
    pub half_mm: f64,
    /// q, mm or rad, shape (n).
    waypoint: &'a [f64],
}

impl<'a> Corner<'a> {
    /// d₁ and d₂ of every joint.
    fn directions(self) -> impl Iterator<Item = (&'a f64, &'a f64)> {
        self.before.iter().zip(self.after)
    }

    /// max|B'|, max|B''| and max|B'''| of every joint.
    pub fn bounds(self) -> impl Iterator<Item = [f64; 3]> + use<'a> {
        let per_mm = 0.5 / self.half_mm;
        self.directions().map(move |(d1, d2)| {
            let turn = (d2 - d1).abs();
            [d1.abs().max(d2.abs()), 1.5 * turn * per_mm, 6.0 * turn * per_mm * per_mm]
        })
    }
}

/// Kept waypoints, the segments between them and the corners at them. M kept waypoints of n joints.
#[derive(Debug)]
pub(super) struct Geometry {
    pub dof: usize,
    /// Kept waypoint of every given one, shape (N).
    pub kept_of: Vec<u32>,
    /// For kept segment i, the given waypoint at which its move ends, shape (M−1); other moves of the segment were merged.
    pub move_to: Vec<u32>,
    /// Joint positions of the kept waypoints, shape (M × n).
    q: Vec<f64>,
    /// dq/ds of the kept segments, shape (M−1 × n).
    direction: Vec<f64>,
    /// d(burr's centre)/ds and d(axis)/ds of the kept segments, shape (M−1).
    pose_direction: Vec<[f64; 6]>,
    /// s at the kept waypoints, mm, shape (M).
    pub s_mm: Vec<f64>,
    /// Length of the kept segments in s, mm, shape (M−1); above 0.
    pub length_mm: Vec<f64>,
    /// Burr's path length per s on the kept segments, in 0..=1, shape (M−1).
    pub burr_per_s: Vec<f64>,
    /// l of the corners, mm, shape (M); 0: none.
    pub half_blend_mm: Vec<f64>,
    /// Whether the arm must stand still at a kept waypoint, shape (M).
    pub stop: Vec<bool>,
}

impl Geometry {
    /// Merges, measures and rounds the polyline. `path` was checked.
    pub fn new(path: &JointPath<'_>, limits: &PathLimits) -> Self {
        let kept = Kept::new(path, limits);
        let mut geometry = Self::through(&kept, path, limits);
        let share = if kept.merged { 1.0 - 2.0 * Kept::MERGE_SHARE } else { 1.0 };
        let CornerTolerance { burr_mm, axis_rad } = limits.corner;
        geometry
            .round_corners(limits, CornerTolerance { burr_mm: share * burr_mm, axis_rad: share * axis_rad });
        geometry
    }

    /// The polyline through the kept waypoints, corners still sharp.
    fn through(kept: &Kept, path: &JointPath<'_>, limits: &PathLimits) -> Self {
        let dof = limits.dof();
        let given = |k: usize| &path.q[k * dof..(k + 1) * dof];
        let segments = kept.of.len() - 1;
        let mut geometry = Self {
            dof,
            kept_of: kept.kept_of.clone(),
            move_to: kept.moves().collect(),
            q: kept.of.iter().flat_map(|&k| given(k)).copied().collect(),
            direction: Vec::with_capacity(segments * dof),
            pose_direction: Vec::with_capacity(segments),
            s_mm: vec![0.0],
            length_mm: Vec::with_capacity(segments),
            burr_per_s: Vec::with_capacity(segments),
            half_blend_mm: vec![0.0; kept.of.len()],
            stop: kept.stop.clone(),
        };
        for ends in kept.of.windows(2) {
            let burr_mm: f64 = path.burr_mm[ends[0] + 1..=ends[1]].iter().sum();
            let length_mm = burr_mm.max(joint_mm(path, limits, ends[0], ends[1]));
            let steps = given(ends[0]).iter().zip(given(ends[1]));
            geometry.direction.extend(steps.map(|(from, to)| (to - from) / length_mm));
            let [from, to] = [ends[0], ends[1]].map(|k| &path.pose[k]);
            geometry.pose_direction.push(std::array::from_fn(|k| (to[k] - from[k]) / length_mm));
            geometry.s_mm.push(geometry.s_mm[geometry.s_mm.len() - 1] + length_mm);
            geometry.length_mm.push(length_mm);
            geometry.burr_per_s.push(burr_mm / length_mm);
        }
        geometry
    }

    /// Number of kept waypoints, at least 1.
    pub fn count(&self) -> usize {
        self.stop.len()
    }

    /// Joint positions of kept waypoint i.
    pub fn waypoint(&self, i: usize) -> &[f64] {
        &self.q[i * self.dof..(i + 1) * self.dof]
    }

    /// dq/ds of kept segment i.
    pub fn direction(&self, i: usize) -> &[f64] {
        &self.direction[i * self.dof..(i + 1) * self.dof]
    }

    /// The rounded corner about kept waypoint i, which must have one.
    pub fn corner(&self, i: usize) -> Corner<'_> {
        Corner {
            before: self.direction(i - 1),
            after: self.direction(i),
            half_mm: self.half_blend_mm[i],
            waypoint: self.waypoint(i),
        }
    }

    /// q, q', q'' and q''' at x on an element, handed to `take` joint by joint.
    pub fn at(&self, element: PathElement, x: f64, mut take: impl FnMut(usize, [f64; 4])) {
        match element {
            PathElement::Straight(i) => {
                let i = i as usize;
                let length = self.length_mm[i];
                // measured from the nearer end, so that both waypoints are met exactly
                let (from, x) = if x <= 0.5 * length { (i, x) } else { (i + 1, x - length) };
                for (j, (q, d)) in self.waypoint(from).iter().zip(self.direction(i)).enumerate() {
                    take(j, [q + d * x, *d, 0.0, 0.0]);
                }
            }
            PathElement::Blend(i) => {
                let corner = self.corner(i as usize);
                let l = corner.half_mm;
                let u = x / (2.0 * l);
                let per_mm = 0.5 / l;
                let step = u * u * (3.0 - 2.0 * u);
                let area = 2.0 * l * u * u * u * (1.0 - 0.5 * u);
                let (bend, snap) = (6.0 * u * (1.0 - u) * per_mm, 6.0 * (1.0 - 2.0 * u) * per_mm * per_mm);
                for (j, (q, (d1, d2))) in corner.waypoint.iter().zip(corner.directions()).enumerate() {
                    let turn = d2 - d1;
                    take(j, [q + (x - l) * d1 + area * turn, d1 + step * turn, bend * turn, snap * turn]);
                }
            }
        }
    }

    /// The burr's way per mm of s at a place of kept segment i, in 0..=1: on a rounded corner the length of the mean of both sides'
    /// directions, weighted as q' is.
    pub fn burr_per_s_at(&self, i: usize, s_mm: f64) -> f64 {
        let blended = |corner: usize| {
            let l = self.half_blend_mm[corner];
            let u = (0.5 * (s_mm - self.s_mm[corner] + l) / l).clamp(0.0, 1.0);
            let step = u * u * (3.0 - 2.0 * u);
            let [before, after] = [corner - 1, corner].map(|k| {
                // the chord's direction, as long as the way per s: an arc is longer than its chord
                let d = Vector3::from_column_slice(&self.pose_direction[k][..3]);
                let chord = d.norm();
                if chord > 0.0 { d * (self.burr_per_s[k] / chord) } else { d }
            });
            (before + (after - before) * step).norm()
        };
        if i > 0 && s_mm < self.s_mm[i] + self.half_blend_mm[i] {
            blended(i)
        } else if s_mm > self.s_mm[i + 1] - self.half_blend_mm[i + 1] {
            blended(i + 1)
        } else {
            self.burr_per_s[i]
        }
    }

    /// How far the burr is from kept waypoint i where it passes it, mm: 3l/16 of the change of its direction.
    pub fn burr_off_mm(&self, i: usize) -> f64 {
        let l = self.half_blend_mm[i];
        if l <= 0.0 {
            return 0.0;
        }
        let [a, b] = [i - 1, i].map(|k| &self.pose_direction[k]);
        3.0 / 16.0 * l * (0..3).map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt()
    }

    /// Every element in the order of travel, with s where it starts and its length, mm.
    pub fn elements(&self) -> Vec<(f64, f64, PathElement)> {
        let mut elements = Vec::with_capacity(2 * self.count());
        for i in 0..self.count() - 1 {
            let (length, l1, l2) = (self.length_mm[i], self.half_blend_mm[i], self.half_blend_mm[i + 1]);
            // between two corners that meet there is no straight element, only a rounding error
            if length - l1 - l2 > 1e-12 * length {
                elements.push((self.s_mm[i] + l1, length - l1 - l2, PathElement::Straight(i as u32)));
            }
            if l2 > 0.0 {
                elements.push((self.s_mm[i + 1] - l2, 2.0 * l2, PathElement::Blend(i as u32 + 1)));
            }
        }
        elements
    }

    /// x on an element for s.
    pub fn place(&self, element: PathElement, s_mm: f64) -> f64 {
        match element {
            PathElement::Straight(i) => (s_mm - self.s_mm[i as usize]).clamp(0.0, self.length_mm[i as usize]),
            PathElement::Blend(i) => {
                let l = self.half_blend_mm[i as usize];
                (s_mm - self.s_mm[i as usize] + l).clamp(0.0, 2.0 * l)
            }
        }
    }

    /// Greatest ṡ² on kept segment i within the joints' velocity limits.
    pub fn joint_sigma(&self, i: usize, limits: &PathLimits) -> f64 {
        let slowest = self.direction(i).iter().zip(&limits.velocity).map(|(d, v)| d.abs() / v);
        slowest.fold(0.0, f64::max).powi(-2)
    }

    /// Rounds the corner at every inner waypoint, or makes it a stop where the tolerance allows no rounding.
    fn round_corners(&mut self, limits: &PathLimits, tolerance: CornerTolerance) {
        for i in 1..self.count().saturating_sub(1) {
            if self.stop[i] || self.is_straight(i) {
                continue;
            }
            let l = self.half_blend(i, limits, tolerance);
            self.half_blend_mm[i] = l;
            self.stop[i] = l <= 0.0;
        }
    }

    /// l at kept waypoint i: as long as curvature and jerk need, but at most half of both segments and within the tolerance.
    ///
    /// At the same s, B deviates from the polyline by ∫ (d₂ − d₁)(3u² − 2u³) up to the waypoint: 3l/16 (d₂ − d₁).
    fn half_blend(&self, i: usize, limits: &PathLimits, tolerance: CornerTolerance) -> f64 {
        let sigma = self.joint_sigma(i - 1, limits).min(self.joint_sigma(i, limits));
        let mut wanted = SHORTEST_BLEND_MM;
        for (j, (d1, d2)) in self.direction(i - 1).iter().zip(self.direction(i)).enumerate() {
            let turn = (d2 - d1).abs();
            wanted = wanted
                .max(0.75 * turn * sigma / (CURVATURE_SHARE * limits.acceleration[j]))
                .max(0.5 * (6.0 * turn * sigma * sigma.sqrt() / (CURVATURE_SHARE * limits.jerk[j])).sqrt());
        }
        let room = 0.5 * self.length_mm[i - 1].min(self.length_mm[i]);
        let [a, b] = [i - 1, i].map(|k| &self.pose_direction[k]);
        let turn = |range: std::ops::Range<usize>| range.map(|k| (b[k] - a[k]).powi(2)).sum::<f64>().sqrt();
        let most = |tolerance: f64, turn: f64| 16.0 / 3.0 * tolerance / turn;
        // without a change of direction tol / 0 = ∞, or 0/0 = NaN, which min ignores
        wanted.min(room).min(most(tolerance.burr_mm, turn(0..3))).min(most(tolerance.axis_rad, turn(3..6)))
    }

    /// Whether the directions before and after kept waypoint i are equal up to rounding of the input.
    fn is_straight(&self, i: usize) -> bool {
        let per_mm = self.length_mm[i - 1].recip() + self.length_mm[i].recip();
        let directions = self.direction(i - 1).iter().zip(self.direction(i));
        directions.zip(self.waypoint(i)).all(|((d1, d2), q)| {
            let step = d1.abs() * self.s_mm[i].max(1.0);
            (d2 - d1).abs() <= 16.0 * f64::EPSILON * (q.abs() + step) * per_mm
        })
    }
}
