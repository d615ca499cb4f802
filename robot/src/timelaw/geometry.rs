//! The path that is driven: straight pieces in joint space joined by parabolas.
//!
//! Invariants: consecutive kept waypoints differ; q(s) and q'(s) are continuous except at stops; at equal s the path is
//! within the corner tolerance (Σ lever |Δq|) of the polyline through the kept waypoints, and that within what merging
//! took of the same tolerance of the given one.

use super::input::{JointPath, PathLimits};

/// Speed at which a move that hardly shifts the burr is measured, mm/s: a move gets at least the length that the burr
/// would cover at this speed in the time that the joints need. A cut's typical speed (Dillon et al. 2016: 1.5 mm/s), so
/// that ṡ stays about even from cuts to rotations. It shapes parabolas between the two, and nothing else.
const REFERENCE_SPEED_MM_S: f64 = 1.5;

/// Share of the corner tolerance within which a waypoint counts as its predecessor. Waypoints nearer than this only
/// carry noise in their direction, and would slow the arm down for it.
const MERGE_SHARE: f64 = 1.0 / 32.0;

/// Waypoints nearer than this are one, stops and ends included, mm.
const SAME_MM: f64 = 1e-12;

/// A parabola is long enough when its curvature takes this share of the joints' acceleration at full joint speed.
const CURVATURE_SHARE: f64 = 0.25;

/// A piece of the path with one formula.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    /// Kept segment i, from kept waypoint i to i + 1; x = s − s(i).
    Straight(u32),
    /// Parabola about kept waypoint i; x = s − its start, in 0..2l.
    Blend(u32),
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
        let mut geometry = kept.segments(path, limits);
        let share = if kept.merged { 1.0 - 2.0 * MERGE_SHARE } else { 1.0 };
        geometry.round_corners(limits, share * limits.corner_tolerance_mm);
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

    /// q and q' of joint j at x on an element; q'' is [`Geometry::curvature`].
    pub fn at(&self, element: Element, x: f64, j: usize) -> (f64, f64) {
        match element {
            Element::Straight(i) => {
                let i = i as usize;
                let (d, length) = (self.direction(i)[j], self.length_mm[i]);
                // from the nearer end, so that both waypoints are met exactly
                let q = if x <= 0.5 * length {
                    self.waypoint(i)[j] + d * x
                } else {
                    self.waypoint(i + 1)[j] - d * (length - x)
                };
                (q, d)
            }
            Element::Blend(i) => {
                let i = i as usize;
                let l = self.half_blend_mm[i];
                let (d1, d2) = (self.direction(i - 1)[j], self.direction(i)[j]);
                let u = x / (2.0 * l);
                let q = self.waypoint(i)[j] + l * (u * u * d2 - (1.0 - u) * (1.0 - u) * d1);
                (q, (1.0 - u) * d1 + u * d2)
            }
        }
    }

    /// q'' of joint j on an element: c = (d₂ − d₁)/(2l) on a parabola.
    pub fn curvature(&self, element: Element, j: usize) -> f64 {
        match element {
            Element::Straight(_) => 0.0,
            Element::Blend(i) => {
                let i = i as usize;
                (self.direction(i)[j] - self.direction(i - 1)[j]) / (2.0 * self.half_blend_mm[i])
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
        let wanted = sigma * curve_s2 / (2.0 * CURVATURE_SHARE);
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

/// Which waypoints are driven through; the others are as good as one of these.
struct Kept {
    /// Indices of given waypoints, increasing, shape (M).
    of: Vec<usize>,
    /// Kept waypoint of every given one, shape (N).
    kept_of: Vec<u32>,
    stop: Vec<bool>,
    merged: bool,
}

impl Kept {
    fn new(path: &JointPath<'_>, limits: &PathLimits) -> Self {
        let count = path.burr_mm.len();
        let mut is_stop = vec![false; count];
        for &stop in path.stops {
            is_stop[stop] = true;
        }
        is_stop[0] = true;
        is_stop[count - 1] = true;
        let near_mm = MERGE_SHARE * limits.corner_tolerance_mm;
        let mut kept = Self { of: vec![0], kept_of: vec![0], stop: vec![true], merged: false };
        for (k, &stops) in is_stop.iter().enumerate().skip(1) {
            let last = kept.of.len() - 1;
            let apart_mm = apart_mm(path, limits, kept.of[last], k);
            if apart_mm <= SAME_MM {
                kept.stop[last] |= stops;
            } else if apart_mm > near_mm || (stops && kept.stop[last]) {
                kept.of.push(k);
                kept.stop.push(stops);
            } else {
                kept.merged = true;
                if stops {
                    // a stop is met exactly: it takes the place of the waypoint just before it
                    kept.of[last] = k;
                    kept.stop[last] = true;
                }
            }
            kept.kept_of.push(kept.of.len() as u32 - 1);
        }
        kept
    }

    /// The moves that lead from one kept waypoint's cluster to the next one's.
    fn moves(&self) -> impl Iterator<Item = u32> {
        let leads_on = |(k, pair): (usize, &[u32])| (pair[0] != pair[1]).then_some(k as u32 + 1);
        self.kept_of.windows(2).enumerate().filter_map(leads_on)
    }

    /// The polyline through the kept waypoints, corners still sharp.
    fn segments(&self, path: &JointPath<'_>, limits: &PathLimits) -> Geometry {
        let dof = limits.dof();
        let given = |k: usize| &path.q[k * dof..(k + 1) * dof];
        let segments = self.of.len() - 1;
        let mut geometry = Geometry {
            dof,
            kept_of: self.kept_of.clone(),
            move_to: self.moves().collect(),
            q: self.of.iter().flat_map(|&k| given(k)).copied().collect(),
            direction: Vec::with_capacity(segments * dof),
            length_mm: Vec::with_capacity(segments),
            burr_per_s: Vec::with_capacity(segments),
            half_blend_mm: vec![0.0; self.of.len()],
            stop: self.stop.clone(),
        };
        for ends in self.of.windows(2) {
            let burr_mm: f64 = path.burr_mm[ends[0] + 1..=ends[1]].iter().sum();
            let length_mm = burr_mm.max(joint_mm(path, limits, ends[0], ends[1]));
            let steps = given(ends[0]).iter().zip(given(ends[1]));
            geometry.direction.extend(steps.map(|(from, to)| (to - from) / length_mm));
            geometry.length_mm.push(length_mm);
            geometry.burr_per_s.push(burr_mm / length_mm);
        }
        geometry
    }
}

/// How far two waypoints are apart, as burr and joints notice it: the greater of Σ lever |Δq| and [`joint_mm`].
fn apart_mm(path: &JointPath<'_>, limits: &PathLimits, from: usize, to: usize) -> f64 {
    let dof = limits.dof();
    let steps = path.q[from * dof..].iter().zip(&path.q[to * dof..]).zip(&limits.lever_mm);
    let burr: f64 = steps.map(|((a, b), lever)| (b - a).abs() * lever).sum();
    burr.max(joint_mm(path, limits, from, to))
}

/// What the burr covers at the reference speed while the joints go from one waypoint to the other, mm.
fn joint_mm(path: &JointPath<'_>, limits: &PathLimits, from: usize, to: usize) -> f64 {
    let dof = limits.dof();
    let steps = path.q[from * dof..].iter().zip(&path.q[to * dof..]).zip(&limits.velocity);
    REFERENCE_SPEED_MM_S * steps.map(|((a, b), v)| (b - a).abs() / v).fold(0.0, f64::max)
}
