//! A motion as it is streamed: joints row by row, with the burr's place, the shaft's axis and the way so far.
//!
//! Rows are even steps of the controller's period; a place between rows is a fraction of one ([`Track::joints`]). Lengths are mm
//! in base, axes are unit vectors from the burr to the handpiece. Nothing here knows time beyond the row's number.

use std::ops::RangeInclusive;

use bonemill_arm::Arm;
use nalgebra::Vector3;
use rayon::prelude::*;

use crate::stream::link::Joints;

/// Joints over rows, and what the arm's kinematics makes of them.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Joint positions; at least two rows.
    q: Vec<Joints>,
    /// Least slowing of each joint in any stop, a second².
    stops: Joints,
    /// The burr's centre, mm.
    burr_mm: Vec<Vector3<f64>>,
    /// The shaft's axis.
    axis: Vec<Vector3<f64>>,
    /// Length of the burr's way up to each row, mm.
    arc_mm: Vec<f64>,
}

/// The place of a track that is nearest to a burr.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NearestOnTrack {
    /// Distance to it, mm.
    pub distance_mm: f64,
    /// Where it is, in rows.
    pub row: f64,
}

/// Greatest speeds on a piece of track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fastest {
    /// The longest that a joint takes to stop from its speed, s.
    pub stop_s: f64,
    /// Of the burr, mm/s.
    pub burr_mm_s: f64,
}

impl Track {
    /// The track of joint vectors that the arm's kinematics accept: finite, two at least. `stops` is the least slowing of each joint.
    pub fn new(arm: &Arm, stops: Joints, q: Vec<Joints>) -> Self {
        let poses: Vec<_> = q
            .par_iter()
            .map(|q| {
                let tool = arm.tool_at(q);
                (tool.translation_mm, tool.rotation * Vector3::z())
            })
            .collect();
        let (burr_mm, axis): (Vec<Vector3<f64>>, Vec<_>) = poses.into_iter().unzip();
        let mut way_mm = 0.0;
        let steps = std::iter::once(0.0).chain(burr_mm.windows(2).map(|w| (w[1] - w[0]).norm()));
        let arc_mm = steps.map(|step| {
            way_mm += step;
            way_mm
        });
        Self { arc_mm: arc_mm.collect(), q, stops, burr_mm, axis }
    }

    /// The rows from one to before another, which exist.
    pub(crate) fn piece(&self, from: usize, to: usize) -> Self {
        Self {
            q: self.q[from..to].to_vec(),
            stops: self.stops,
            burr_mm: self.burr_mm[from..to].to_vec(),
            axis: self.axis[from..to].to_vec(),
            arc_mm: self.arc_mm[from..to].to_vec(),
        }
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.q.len()
    }

    /// The last row.
    pub fn last_row(&self) -> f64 {
        (self.rows() - 1) as f64
    }

    /// Joint positions of all rows.
    pub fn q(&self) -> &[Joints] {
        &self.q
    }

    /// Least slowing of each joint in any stop, rad/s² or mm/s².
    pub fn stops(&self) -> Joints {
        self.stops
    }

    /// The burr's centre in all rows, mm.
    pub fn burr_mm(&self) -> &[Vector3<f64>] {
        &self.burr_mm
    }

    /// The shaft's axis in all rows.
    pub fn axes(&self) -> &[Vector3<f64>] {
        &self.axis
    }

    /// The row at or before a place, and how far on the next one the place is.
    fn between(&self, row: f64) -> (usize, f64) {
        let row = row.clamp(0.0, self.last_row());
        let before = (row as usize).min(self.rows() - 2);
        (before, row - before as f64)
    }

    /// Joint positions at a place, straight between rows; a row's own are given unchanged.
    pub fn joints(&self, row: f64) -> Joints {
        let (n, share) = self.between(row);
        if share == 0.0 {
            return self.q[n];
        }
        if share == 1.0 {
            return self.q[n + 1];
        }
        std::array::from_fn(|j| self.q[n][j] + share * (self.q[n + 1][j] - self.q[n][j]))
    }

    /// The burr's centre at a place, mm.
    pub fn burr_at(&self, row: f64) -> Vector3<f64> {
        let (n, share) = self.between(row);
        self.burr_mm[n].lerp(&self.burr_mm[n + 1], share)
    }

    /// Length of the burr's way up to a place, mm.
    pub fn arc_at(&self, row: f64) -> f64 {
        let (n, share) = self.between(row);
        self.arc_mm[n] + share * (self.arc_mm[n + 1] - self.arc_mm[n])
    }

    /// The way between two places, mm.
    pub fn way_mm(&self, from_row: f64, to_row: f64) -> f64 {
        (self.arc_at(to_row) - self.arc_at(from_row)).abs()
    }

    /// The place on the way from `from_row` to `to_row` (at least that) that is nearest to a burr.
    pub fn nearest(&self, from_row: f64, to_row: f64, burr_mm: &Vector3<f64>) -> NearestOnTrack {
        let mut best =
            NearestOnTrack { distance_mm: (self.burr_at(from_row) - burr_mm).norm(), row: from_row };
        let (first, _) = self.between(from_row);
        let (last, _) = self.between(to_row);
        for n in first..=last {
            let step = self.burr_mm[n + 1] - self.burr_mm[n];
            let square = step.norm_squared();
            let share = if square > 0.0 { (burr_mm - self.burr_mm[n]).dot(&step) / square } else { 0.0 };
            let row = (n as f64 + share.clamp(0.0, 1.0)).clamp(from_row, to_row);
            let distance_mm = (self.burr_at(row) - burr_mm).norm();
            if distance_mm < best.distance_mm {
                best = NearestOnTrack { distance_mm, row };
            }
        }
        best
    }

    /// Least angle between an axis and those on the way between two places, rad.
    pub fn axis_off_rad(&self, from_row: f64, to_row: f64, axis: &Vector3<f64>) -> f64 {
        let (first, _) = self.between(from_row);
        let (last, _) = self.between(to_row);
        let angles = self.axis[first..=last + 1].iter().map(|planned| planned.cross(axis).norm());
        angles.fold(f64::INFINITY, f64::min).min(1.0).asin()
    }

    /// The joint that is farthest outside of what the rows between two places span, for how hard it slows, and how far it is.
    pub fn joints_off(&self, from_row: f64, to_row: f64, q: &Joints) -> (usize, f64) {
        let (first, _) = self.between(from_row);
        let (last, _) = self.between(to_row);
        let off = |j: usize| {
            let told = self.q[first..=last + 1].iter().map(|row| row[j]);
            let (low, high) = told.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            (low - q[j]).max(q[j] - high).max(0.0)
        };
        let weighted = (0..6).map(|j| (j, off(j) / self.stops[j]));
        let (worst, _) = weighted.fold((0, 0.0), |a, b| if b.1 > a.1 { b } else { a });
        (worst, off(worst))
    }

    /// The greatest speeds on the steps from some rows, which exist, to their next ones, a period apart.
    pub fn fastest(&self, rows: RangeInclusive<usize>, period_s: f64) -> Fastest {
        let mut most = Fastest { stop_s: 0.0, burr_mm_s: 0.0 };
        for n in rows.filter(|n| n + 1 < self.rows()) {
            let joints = (0..6).map(|j| (self.q[n + 1][j] - self.q[n][j]).abs() / self.stops[j]);
            most.stop_s = joints.fold(most.stop_s, f64::max);
            most.burr_mm_s = most.burr_mm_s.max(self.arc_mm[n + 1] - self.arc_mm[n]);
        }
        Fastest { stop_s: most.stop_s / period_s, burr_mm_s: most.burr_mm_s / period_s }
    }
}
