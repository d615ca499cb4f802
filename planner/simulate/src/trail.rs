//! The last stretch of the burr's way, kept as it is: not yet in the lattice.
//!
//! Forces look at the burr's surface, and just behind it lies the surface that it made itself. Where that meets older
//! cuts, an interpolated depth rounds the ridge off, and the burr would see too little bone along the rim of what it
//! cuts. So the newest stretch stays exact: points are tested against its capsules, and the lattice follows a little
//! behind.
//!
//! Steps that go on straight become one piece. A piece may stand for a bent way within `tolerance_mm`, so that a
//! hand's path of a thousand steps a second stays a handful of capsules; a way that is straight is kept exactly,
//! however it is cut.

use bonemill_geometry::{Point, Work};
use bonemill_stock::sweep::segment_distance_squared;
use nalgebra::Vector3;

use super::carve::Piece;

/// More pieces than this are not kept, whatever their length.
const MOST_PIECES: usize = 24;

/// A polyline of burr centres that ends where the burr is.
#[derive(Debug, Clone)]
pub struct Trail {
    corners: Vec<Vector3<f64>>,
    /// How far the last piece may be from the way it stands for, mm.
    bent_mm: f64,
    tolerance_mm: f64,
    /// Whether the ball at the first corner has been taken out of the lattice.
    begun: bool,
}

/// A piece as a burr at the trail's end sees it.
#[derive(Debug, Clone, Copy)]
pub struct TrailPiece {
    /// Where it starts.
    pub from: Vector3<f64>,
    /// Where it ends.
    pub to: Vector3<f64>,
    /// Whether the burr has just come along it: its surface is the burr's own.
    pub is_own: bool,
}

impl Trail {
    /// A burr that appears at `at`.
    pub fn new(at: Point<Work>, tolerance_mm: f64) -> Self {
        Self { corners: vec![at.coords], bent_mm: 0.0, tolerance_mm, begun: false }
    }

    /// Where the burr is.
    pub fn end(&self) -> Vector3<f64> {
        self.corners.last().copied().unwrap_or_default()
    }

    /// Goes straight to a point.
    pub fn extend(&mut self, to: Vector3<f64>) {
        let count = self.corners.len();
        if to == self.end() {
            return;
        }
        if count >= 2 {
            // the way so far is within `bent` of a–b, and a–b nowhere farther from a–to than b is
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

    /// Length of the way, mm.
    pub fn length_mm(&self) -> f64 {
        self.corners.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
    }

    /// Whether so many pieces are kept that the oldest must go.
    pub fn is_crowded(&self) -> bool {
        self.corners.len() > MOST_PIECES
    }

    /// Pieces, the oldest first; before the first step a piece of no length, the ball.
    pub fn pieces(&self) -> impl DoubleEndedIterator<Item = (Vector3<f64>, Vector3<f64>)> + '_ {
        let ball = (self.corners.len() == 1 && !self.begun).then(|| (self.end(), self.end()));
        ball.into_iter().chain(self.corners.windows(2).map(|pair| (pair[0], pair[1])))
    }

    /// Pieces as [`Trail::pieces`], the newest first and cut at `near_mm` from the end; each with whether it lies
    /// within that.
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

    /// Gives up all but the last `keep_mm`.
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

    /// Gives up pieces until it is not crowded.
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
