//! The time law: position, velocity and acceleration of every joint at every instant, in closed form.

use std::sync::Arc;

use super::geometry::{Element, Geometry};
use super::pass;
use super::prepared::{BLEND_INTERVALS, Interval, PreparedPath};

/// A stretch of constant s̈ with its start in time.
#[derive(Debug, Clone, Copy)]
struct Piece {
    start_s: f64,
    /// x at its start, mm of s on its element.
    start_mm: f64,
    speed_mm_s: f64,
    acceleration_mm_s2: f64,
    element: Element,
}

/// Joint positions, velocities and accelerations at one instant; mm and rad by joint, shape (dof) each.
#[derive(Debug, Clone, PartialEq)]
pub struct JointState {
    /// Positions, mm or rad.
    pub q: Vec<f64>,
    /// Velocities, mm/s or rad/s.
    pub qd: Vec<f64>,
    /// Accelerations, mm/s² or rad/s²; at an instant where they jump, those that follow.
    pub qdd: Vec<f64>,
}

/// A motion along a prepared path: at rest at both ends, within all limits at every instant between.
///
/// q(t) = q(s(t)), q̇ = q' ṡ, q̈ = q'' ṡ² + q' s̈, with s̈ constant on each piece.
#[derive(Debug, Clone)]
pub struct TimeLaw {
    geometry: Arc<Geometry>,
    pieces: Vec<Piece>,
    duration_s: f64,
    waypoint_times_s: Vec<f64>,
}

impl TimeLaw {
    /// Lays the speed profile `sigma` (per node, under `sigma_max` per interval) out in time.
    pub(super) fn new(path: &PreparedPath, sigma_max: &[f64], sigma: &[f64]) -> Self {
        let geometry = Arc::clone(&path.geometry);
        let mut pieces = Vec::with_capacity(path.intervals.len());
        let mut kept_times_s = vec![0.0; geometry.count()];
        let mut start_s = 0.0;
        pass::for_each_phase(path, sigma_max, sigma, |k, phase| {
            let interval = &path.intervals[k];
            let piece = Piece {
                start_s,
                start_mm: phase.start_mm,
                speed_mm_s: phase.speed_mm_s[0],
                acceleration_mm_s2: phase.acceleration_mm_s2,
                element: interval.element,
            };
            push_unless_continued(&mut pieces, piece);
            start_s += phase.duration_s();
            if let Some(passed) = passed_at_end(&geometry, interval) {
                kept_times_s[passed] = start_s;
            }
        });
        let waypoint_times_s = geometry.kept_of.iter().map(|&i| kept_times_s[i as usize]).collect();
        Self { geometry, pieces, duration_s: start_s, waypoint_times_s }
    }

    /// Number of joints.
    pub fn dof(&self) -> usize {
        self.geometry.dof
    }

    /// From rest to rest, s; 0 for a path that goes nowhere.
    pub fn duration_s(&self) -> f64 {
        self.duration_s
    }

    /// When each given waypoint is passed, s, never decreasing, shape (waypoints): at a cut corner the parabola's middle.
    pub fn waypoint_times_s(&self) -> &[f64] {
        &self.waypoint_times_s
    }

    /// Joint state at a time; before the start and from the end on the arm stands at the first and the last waypoint.
    pub fn sample(&self, time_s: f64) -> JointState {
        let zeros = vec![0.0; self.dof()];
        let mut state = JointState { q: zeros.clone(), qd: zeros.clone(), qdd: zeros };
        self.sample_into(time_s, &mut state.q, &mut state.qd, Some(&mut state.qdd));
        state
    }

    /// [`TimeLaw::sample`] into given slices.
    ///
    /// # Panics
    /// Where a slice has fewer than dof values.
    pub fn sample_into(&self, time_s: f64, q: &mut [f64], qd: &mut [f64], qdd: Option<&mut [f64]>) {
        let piece = self.pieces.partition_point(|piece| piece.start_s <= time_s);
        self.evaluate(piece.checked_sub(1), time_s, q, qd, qdd);
    }

    /// A reader that goes forth in time without searching.
    pub(super) fn cursor(&self, time_s: f64) -> Cursor<'_> {
        Cursor { law: self, next: self.pieces.partition_point(|piece| piece.start_s <= time_s) }
    }

    /// State at a time on a piece; `None` is before the first.
    fn evaluate(
        &self,
        piece: Option<usize>,
        time_s: f64,
        q: &mut [f64],
        qd: &mut [f64],
        qdd: Option<&mut [f64]>,
    ) {
        let piece = piece.and_then(|at| self.pieces.get(at));
        let Some(piece) = piece.filter(|_| time_s < self.duration_s) else {
            let end = if time_s < self.duration_s { 0 } else { self.geometry.count() - 1 };
            q[..self.dof()].copy_from_slice(self.geometry.waypoint(end));
            qd.fill(0.0);
            if let Some(qdd) = qdd {
                qdd.fill(0.0);
            }
            return;
        };
        let &Piece { start_mm, speed_mm_s, acceleration_mm_s2, element, .. } = piece;
        let elapsed_s = time_s - piece.start_s;
        // rounding at a stop must not turn the arm round
        let speed = (speed_mm_s + acceleration_mm_s2 * elapsed_s).max(0.0);
        let x = start_mm + 0.5 * (speed_mm_s + speed) * elapsed_s;
        match qdd {
            None => self.geometry.at(element, x, |j, [position, slope, _]| {
                q[j] = position;
                qd[j] = slope * speed;
            }),
            Some(qdd) => self.geometry.at(element, x, |j, [position, slope, curvature]| {
                q[j] = position;
                qd[j] = slope * speed;
                qdd[j] = curvature * speed * speed + slope * acceleration_mm_s2;
            }),
        }
    }
}

/// Reads a law at times that never decrease.
pub(super) struct Cursor<'a> {
    law: &'a TimeLaw,
    /// The first piece that starts later than the last time asked for.
    next: usize,
}

impl Cursor<'_> {
    /// Positions and velocities at `time_s`, not before the last one asked for.
    pub fn read(&mut self, time_s: f64, q: &mut [f64], qd: &mut [f64]) {
        while self.law.pieces.get(self.next).is_some_and(|piece| piece.start_s <= time_s) {
            self.next += 1;
        }
        self.law.evaluate(self.next.checked_sub(1), time_s, q, qd, None);
    }
}

/// Adds a piece, but not where the last one goes on at the same even speed.
fn push_unless_continued(pieces: &mut Vec<Piece>, piece: Piece) {
    let goes_on = |last: &Piece| {
        last.element == piece.element
            && last.acceleration_mm_s2 == 0.0
            && piece.acceleration_mm_s2 == 0.0
            && last.speed_mm_s == piece.speed_mm_s
    };
    if !pieces.last().is_some_and(goes_on) {
        pieces.push(piece);
    }
}

/// The kept waypoint that the end of an interval passes, if any; the last of several phases wins.
fn passed_at_end(geometry: &Geometry, interval: &Interval) -> Option<usize> {
    match interval.element {
        Element::Straight(i) => {
            let next = i as usize + 1;
            (geometry.half_blend_mm[next] <= 0.0).then_some(next)
        }
        Element::Blend(i) => (interval.part + 1 == BLEND_INTERVALS / 2).then_some(i as usize),
    }
}
