//! The bone as one contiguous array of occupied and empty voxels.
//!
//! **Source:** Faieghi et al., II-A.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use bonemill_planner::cutter::SolidOfRevolution;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Density of bone in the array; 0 is void.
pub const BONE: u8 = 100;

/// A cube of voxels.
pub struct Voxmap {
    voxels: Vec<AtomicU8>,
    /// Voxels along a side.
    pub side: usize,
    /// Side of a voxel, mm.
    pub spacing_mm: f64,
    /// Corner of the cube, mm.
    pub origin_mm: Vector3<f64>,
}

/// A voxmap larger than the memory that is there.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("a voxmap of {side}³ needs {needed_gb:.1} GB, and {free_gb:.1} GB are free")]
pub struct TooLarge {
    side: usize,
    needed_gb: f64,
    free_gb: f64,
}

impl Voxmap {
    /// A cube of bone of `length_mm`; `free_bytes` is the memory that may be taken.
    ///
    /// # Errors
    /// [`TooLarge`] when that is less than a byte a voxel.
    pub fn new(
        side: usize,
        length_mm: f64,
        origin_mm: Vector3<f64>,
        free_bytes: f64,
    ) -> Result<Self, TooLarge> {
        let needed = (side as f64).powi(3);
        if needed > free_bytes {
            return Err(TooLarge { side, needed_gb: needed * 1e-9, free_gb: free_bytes * 1e-9 });
        }
        let voxels = (0..side * side * side).into_par_iter().map(|_| AtomicU8::new(BONE)).collect();
        Ok(Self { voxels, side, spacing_mm: length_mm / side as f64, origin_mm })
    }

    /// Place in the array of the voxel that holds a point.
    #[inline]
    pub fn place(&self, p: &Vector3<f64>) -> Option<usize> {
        let at = (p - self.origin_mm) / self.spacing_mm;
        let most = self.side as f64;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.z >= 0.0 && at.x < most && at.y < most && at.z < most;
        inside.then(|| at.x as usize + self.side * (at.y as usize + self.side * at.z as usize))
    }

    /// Whether there is bone at a place.
    #[inline]
    pub fn is_bone(&self, place: usize) -> bool {
        self.voxels[place].load(Relaxed) > 0
    }

    /// Takes the bone at a place.
    #[inline]
    pub fn clear(&self, place: usize) {
        self.voxels[place].store(0, Relaxed);
    }

    /// Whether a ball touches the cube.
    #[inline]
    pub fn touches_ball(&self, center_mm: &Vector3<f64>, radius_mm: f64) -> bool {
        let length = self.side as f64 * self.spacing_mm;
        let at = center_mm - self.origin_mm;
        let outside = at.map(|c| (c - c.clamp(0.0, length)).powi(2));
        outside.sum() <= radius_mm * radius_mm
    }

    /// Takes an upright cutter with its tip at a place out of the bone.
    pub fn take(&self, solid: &SolidOfRevolution, tip_mm: &Vector3<f64>) {
        let middle = |n: usize| (n as f64 + 0.5) * self.spacing_mm;
        (0..self.side).into_par_iter().for_each(|k| {
            let Some(radius) = solid.radius_at_mm(self.origin_mm.z + middle(k) - tip_mm.z) else { return };
            for j in 0..self.side {
                let y = self.origin_mm.y + middle(j) - tip_mm.y;
                let half = radius * radius - y * y;
                if half <= 0.0 {
                    continue;
                }
                let x = |x: f64| {
                    ((tip_mm.x + x - self.origin_mm.x) / self.spacing_mm - 0.5).clamp(0.0, self.side as f64)
                };
                let row = self.side * (j + self.side * k);
                for i in x(-half.sqrt()).ceil() as usize..(x(half.sqrt()).floor() as usize + 1).min(self.side)
                {
                    self.clear(row + i);
                }
            }
        });
    }
}
