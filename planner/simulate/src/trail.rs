//! The newest stretch of the burr's path, stored exactly and not yet removed from the lattice.
//!
//! Forces are computed on the burr's surface, and directly behind it lies the surface that it has just cut. Where that meets
//! older cuts, interpolated depths would round the ridge off, and the force would miss bone along the rim of the cut. So the
//! newest stretch is stored exactly: points are tested against its capsules, and the lattice is updated some distance behind.
//!
//! Straight steps are merged into one piece. A piece may replace a curved path within `tolerance_mm`, so that a path moved by
//! hand at a thousand steps per second stays a few capsules. A straight path is stored exactly, however it is divided.

use bonemill_geometry::capsule::segment_distance_squared;
use bonemill_geometry::{Point, Work};
use nalgebra::Vector3;

use super::carve::Piece;

/// Largest number of stored pieces.
const MOST_PIECES: usize = 24;

/// A polyline of burr centres that ends at the burr.
#[derive(Debug, Clone)]
pub struct Trail {
    corners: Vec<Vector3<f64>>,
    /// Deviation of the last piece from the path that it replaces, mm.
    bent_mm: f64,
    tolerance_mm: f64,
    /// Whether the ball at the first corner is removed from the lattice.
    begun: bool,
}

/// A piece of the trail.
#[derive(Debug, Clone, Copy)]
pub struct TrailPiece {
    /// Where it starts.
    pub from: Vector3<f64>,
    /// Where it ends.
    pub to: Vector3<f64>,
    /// Whether the burr has just moved along it, so that its surface is the burr's own.
    pub is_own: bool,
}

impl Trail {
    /// The trail of a burr that starts at `at`.
    pub fn new(at: Point<Work>, tolerance_mm: f64) -> Self {
        Self { corners: vec![at.coords], bent_mm: 0.0, tolerance_mm, begun: false }
    }

    /// Where the burr is.
    pub fn end(&self) -> Vector3<f64> {
        self.corners.last().copied().unwrap_or_default()
    }

    /// Extends the trail straight to a point.
    pub fn extend(&mut self, to: Vector3<f64>) {
        let count = self.corners.len();
        if to == self.end() {
            return;
        }
        if count >= 2 {
            // the path so far is within `bent` of a–b, and no point of a–b is farther from a–to than b
            let off =
                segment_distance_squared(&self.corners[count - 1], &self.corners[count - 2], &to).sqrt();
            if self.bent_mm + off <= self.tolerance_mm {
                self.bent_mm += off;
                self.corners[count - 1] = to;
                return;
            }
        }
        self.bent_mm = 0.0;
        self.corners.push(to);
    }

    /// Length of the trail, mm.
    pub fn length_mm(&self) -> f64 {
        self.corners.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    }

    /// Whether there are so many pieces that the oldest must be removed.
    pub fn is_crowded(&self) -> bool {
        self.corners.len() > MOST_PIECES
    }

    /// The pieces, the oldest first; before the first step one piece of length 0, a ball.
    pub fn pieces(&self) -> impl DoubleEndedIterator<Item = (Vector3<f64>, Vector3<f64>)> + '_ {
        let ball = (self.corners.len() == 1 && !self.begun).then(|| (self.end(), self.end()));
        ball.into_iter().chain(self.corners.windows(2).map(|pair| (pair[0], pair[1])))
    }

    /// The pieces of [`Trail::pieces`], the newest first, divided at `near_mm` from the end; each tells whether it lies within
    /// that distance.
    pub fn newest(&self, near_mm: f64) -> Vec<TrailPiece> {
        let mut left_mm = near_mm;
        let mut out = Vec::with_capacity(self.corners.len() + 1);
        for (from, to) in self.pieces().rev() {
            let length = (to - from).norm();
            if left_mm <= 0.0 {
                out.push(TrailPiece { from, to, is_own: false });
            } else if length <= left_mm {
                out.push(TrailPiece { from, to, is_own: true });
            } else {
                let split = to + (from - to) * (left_mm / length);
                out.push(TrailPiece { from: split, to, is_own: true });
                out.push(TrailPiece { from, to: split, is_own: false });
            }
            left_mm -= length;
        }
        out
    }

    /// Removes and returns all pieces except the last `keep_mm`.
    pub fn take_all_but(&mut self, keep_mm: f64) -> Vec<Piece> {
        let mut excess = self.length_mm() - keep_mm;
        let mut taken = Vec::new();
        let mut done = 0;
        if keep_mm <= 0.0 && !self.begun && self.corners.len() == 1 {
            taken.push(self.piece(self.end(), self.end()));
        }
        while excess > 0.0 && done + 1 < self.corners.len() {
            let (from, to) = (self.corners[done], self.corners[done + 1]);
            let length = (to - from).norm();
            if length <= excess {
                taken.push(self.piece(from, to));
                done += 1;
            } else {
                let split = from + (to - from) * (excess / length);
                taken.push(self.piece(from, split));
                self.corners[done] = split;
            }
            excess -= length;
        }
        self.corners.drain(..done);
        taken
    }

    /// Removes and returns pieces until the trail is not crowded.
    pub fn thin_out(&mut self) -> Vec<Piece> {
        let mut taken = Vec::new();
        let excess = self.corners.len().saturating_sub(MOST_PIECES / 2);
        for n in 0..excess {
            taken.push(self.piece(self.corners[n], self.corners[n + 1]));
        }
        self.corners.drain(..excess);
        taken
    }

    fn piece(&mut self, from: Vector3<f64>, to: Vector3<f64>) -> Piece {
        let continues = std::mem::replace(&mut self.begun, true);
        Piece { from: Point::from_coords(from), to: Point::from_coords(to), continues }
    }
}
