//! The path that is driven: straight pieces in joint space joined by parabolas.
//!
//! Invariants: consecutive kept waypoints differ; q(s) and q'(s) are continuous except at stops; at equal s the path is
//! within the corner tolerance (Σ lever |Δq|) of the polyline through the kept waypoints, and that within what merging
//! took of the same tolerance of the given one.

use super::input::{JointPath, PathLimits};
use super::merge::{Kept, joint_mm};

/// A parabola is long enough when its curvature takes this share of the joints' acceleration at full joint speed.
const CURVATURE_SHARE: f64 = 0.25;

/// No parabola is made shorter than this for want of curvature, mm: differences of σ over less are rounding.
const SHORTEST_BLEND_MM: f64 = 1e-3;

/// A piece of the path with one formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    /// Kept segment i, from kept waypoint i to i + 1; x = s − s(i).
    Straight(u32),
    /// Parabola about kept waypoint i; x = s − its start, in 0..2l.
    Blend(u32),
}

/// A parabola: B(u) = q − l(1−u)² d₁ + l u² d₂, u = x/(2l) in 0..1; B' = (1−u) d₁ + u d₂, B'' = (d₂ − d₁)/(2l) by s.
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

    /// max|B'| for u in `from..to` and |B''| of every joint; B' is linear, so its greatest stands at an end.
    pub fn bounds(self, from: f64, to: f64) -> impl Iterator<Item = (f64, f64)> + use<'a> {
        let per_mm = 0.5 / self.half_mm;
        self.directions().map(move |(d1, d2)| {
            let turn = d2 - d1;
            ((d1 + from * turn).abs().max((d1 + to * turn).abs()), turn.abs() * per_mm)
        })
    }
}

/// Kept waypoints, the segments between them and the parabolas at them. M kept waypoints of n joints.
#[derive(Debug)]
pub(super) struct Geometry {
    pub dof: usize,
    /// Kept waypoint of every given one, shape (N).
    pub kept_of: Vec<u32>,
    /// The given waypoint at which the one move of kept segment i that counts ends, shape (M−1); others were merged away.
    pub move_to: Vec<u32>,
    /// Joint positions of the kept waypoints, shape (M × n).
    q: Vec<f64>,
    /// dq/ds of the kept segments, shape (M−1 × n).
    direction: Vec<f64>,
    /// Length of the kept segments in s, mm, shape (M−1); above 0.
    pub length_mm: Vec<f64>,
    /// Burr's path length per s on the kept segments, in 0..=1, shape (M−1).
    pub burr_per_s: Vec<f64>,
    /// l of the parabolas, mm, shape (M); 0: none.
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
        geometry.round_corners(limits, share * limits.corner_tolerance_mm);
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

    /// The parabola about kept waypoint i, which must have one.
    pub fn corner(&self, i: usize) -> Corner<'_> {
        Corner {
            before: self.direction(i - 1),
            after: self.direction(i),
            half_mm: self.half_blend_mm[i],
            waypoint: self.waypoint(i),
        }
    }

    /// q, q' and q'' at x on an element, handed to `take` joint by joint.
    pub fn at(&self, element: Element, x: f64, mut take: impl FnMut(usize, [f64; 3])) {
        match element {
            Element::Straight(i) => {
                let i = i as usize;
                let length = self.length_mm[i];
                // from the nearer end, so that both waypoints are met exactly
                let (from, x) = if x <= 0.5 * length { (i, x) } else { (i + 1, x - length) };
                for (j, (q, d)) in self.waypoint(from).iter().zip(self.direction(i)).enumerate() {
                    take(j, [q + d * x, *d, 0.0]);
                }
            }
            Element::Blend(i) => {
                let corner = self.corner(i as usize);
                let l = corner.half_mm;
                let u = x / (2.0 * l);
                let (before, after) = (l * (1.0 - u) * (1.0 - u), l * u * u);
                for (j, (q, (d1, d2))) in corner.waypoint.iter().zip(corner.directions()).enumerate() {
                    take(j, [q - before * d1 + after * d2, (1.0 - u) * d1 + u * d2, (d2 - d1) / (2.0 * l)]);
                }
            }
        }
    }

    /// Greatest ṡ² on kept segment i within the joints' velocity limits.
    pub fn joint_sigma(&self, i: usize, limits: &PathLimits) -> f64 {
        let slowest = self.direction(i).iter().zip(&limits.velocity).map(|(d, v)| d.abs() / v);
        slowest.fold(0.0, f64::max).powi(-2)
    }

    /// Sets the parabola of every inner waypoint, or a stop where the tolerance allows none.
    fn round_corners(&mut self, limits: &PathLimits, tolerance_mm: f64) {
        for i in 1..self.count().saturating_sub(1) {
            if self.stop[i] || self.is_straight(i, limits) {
                continue;
            }
            let l = self.half_blend(i, limits, tolerance_mm);
            self.half_blend_mm[i] = l;
            self.stop[i] = l <= 0.0;
        }
    }

    /// l at kept waypoint i: as the curvature needs it, within half of both segments and the tolerance.
    ///
    /// The parabola B(u) = q − l(1−u)² d₁ + l u² d₂ differs from the polyline at the same s by l u² (d₂ − d₁) for u ≤ ½ and
    /// symmetrically beyond, so l/4 Σ w |d₂ − d₁| is its greatest deviation.
    fn half_blend(&self, i: usize, limits: &PathLimits, tolerance_mm: f64) -> f64 {
        let sigma = self.joint_sigma(i - 1, limits).min(self.joint_sigma(i, limits));
        let (mut turn_mm, mut curve_s2) = (0.0, 0f64);
        for (j, (d1, d2)) in self.direction(i - 1).iter().zip(self.direction(i)).enumerate() {
            let turn = (d2 - d1).abs();
            turn_mm += limits.lever_mm[j] * turn;
            curve_s2 = curve_s2.max(turn / limits.acceleration[j]);
        }
        let wanted = (sigma * curve_s2 / (2.0 * CURVATURE_SHARE)).max(SHORTEST_BLEND_MM);
        let room = 0.5 * self.length_mm[i - 1].min(self.length_mm[i]);
        // a joint without lever may turn as it likes: 4 tol / 0 = ∞, and 0/0 = NaN, which min passes over
        wanted.min(room).min(4.0 * tolerance_mm / turn_mm)
    }

    /// Whether the directions before and after kept waypoint i are the same but for rounding of the input.
    fn is_straight(&self, i: usize, limits: &PathLimits) -> bool {
        let per_mm = self.length_mm[i - 1].recip() + self.length_mm[i].recip();
        let q = self.waypoint(i);
        let size_mm: f64 = 1.0 + q.iter().zip(&limits.lever_mm).map(|(q, w)| q.abs() * w).sum::<f64>();
        let directions = self.direction(i - 1).iter().zip(self.direction(i));
        directions.zip(q).all(|((d1, d2), q)| {
            (d2 - d1).abs() <= 16.0 * f64::EPSILON * (q.abs() + d1.abs() * size_mm) * per_mm
        })
    }
}
