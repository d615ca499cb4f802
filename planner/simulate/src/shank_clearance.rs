//! Watches the shank along the burr's path: finds the first contact of a step, and how far each part may move before it must
//! be tested again.
//!
//! Bone is only removed, so a clearance stays valid until that part of the shank has moved as far; most steps need no test.
//! The stored clearances only decide whether a part is tested again, so they may be dropped at any time.

use bonemill_cutting::cutter::ShankCylinder;
use bonemill_geometry::capsule::segment_distance_squared;
use nalgebra::{Unit, Vector3};

use super::engine::Pose;
use super::lattice::Lattice;
use super::shank::{Shaft, ShankContact, ShankView};
use super::trail::Trail;

/// Distance around the shank within which bone is searched, mm, and its growth per mm behind the burr, where a turn moves the
/// shank more. A larger distance means fewer searches.
const LOOK_MM: f64 = 1.0;
const LOOK_PER_MM: f64 = 0.03;
/// The shank is tested in pieces of at most this length, mm; each has its own clearance.
const SHANK_PIECE_MM: f64 = 5.0;
/// Largest number of places along a step at which the shank is tested.
const MOST_PLACES: f64 = 1000.0;

/// The shank in pieces.
#[derive(Debug, Clone)]
pub(super) struct ShankClearance {
    pieces: Vec<Piece>,
    /// The thinnest cylinder's radius, mm; `None` without a shank.
    thin_mm: Option<f64>,
    burr_mm: f64,
}

/// A piece of one of the shank's cylinders.
#[derive(Debug, Clone, Copy)]
struct Piece {
    cylinder: ShankCylinder,
    /// The cylinder that it is a part of.
    whole: ShankCylinder,
    /// How far it may move before it can touch anything, mm.
    clear_mm: f64,
}

impl ShankClearance {
    pub(super) fn new(shank: &[ShankCylinder], burr_mm: f64) -> Self {
        Self {
            pieces: shank.iter().flat_map(pieces).collect(),
            thin_mm: shank.iter().map(|c| c.radius_mm).reduce(f64::min),
            burr_mm,
        }
    }

    /// The first contact between two poses; `trail` leads to the second and contains the path that is not in the lattice yet.
    pub(super) fn contact<T: Copy + Into<f64> + Sync>(
        &mut self,
        lattice: &Lattice<'_, T>,
        trail: &Trail,
        from: &Pose,
        to: &Pose,
    ) -> Option<ShankContact> {
        let thin_mm = self.thin_mm?;
        let turn = (to.axis.into_inner() - from.axis.into_inner()).norm();
        let way_mm = (to.center - from.center).norm();
        let mut moved_mm = 0f64;
        let mut close = Vec::new();
        for (n, piece) in self.pieces.iter_mut().enumerate() {
            let moves_mm = way_mm + piece.cylinder.to_mm * turn;
            piece.clear_mm -= moves_mm;
            if piece.clear_mm <= 0.0 {
                close.push(n);
                moved_mm = moved_mm.max(moves_mm);
            }
        }
        let places = (moved_mm / thin_mm).ceil().clamp(1.0, MOST_PLACES) as usize;
        for place in 1..=places {
            let part = place as f64 / places as f64;
            let axis = from.axis.lerp(&to.axis, part);
            let center = from.center + (to.center - from.center) * part;
            let shaft = Shaft { center: center.coords, axis: Unit::try_new(axis, 1e-9).unwrap_or(to.axis) };
            let mut deepest: Option<ShankContact> = None;
            for &n in &close {
                let view = self.view(lattice, trail, &shaft, &self.pieces[n]);
                self.pieces[n].clear_mm = if view.contact.is_some() { 0.0 } else { view.clear_mm };
                deepest = deepest
                    .into_iter()
                    .chain(view.contact)
                    .reduce(|a, b| if b.depth_mm > a.depth_mm { b } else { a });
            }
            if deepest.is_some() {
                // the step is not made, so these clearances belong to another pose
                close.iter().for_each(|&n| self.pieces[n].clear_mm = 0.0);
                return deepest;
            }
        }
        None
    }

    fn view<T: Copy + Into<f64> + Sync>(
        &self,
        lattice: &Lattice<'_, T>,
        trail: &Trail,
        shaft: &Shaft,
        piece: &Piece,
    ) -> ShankView {
        let r2 = self.burr_mm * self.burr_mm;
        let is_swept =
            |p: &Vector3<f64>| trail.pieces().any(|(a, b)| segment_distance_squared(p, &a, &b) <= r2);
        let look_mm = LOOK_MM + LOOK_PER_MM * piece.cylinder.to_mm;
        let mut view = lattice.view_shank(shaft, &piece.cylinder, look_mm, is_swept);
        lattice.view_far(shaft, &piece.cylinder, &piece.whole, &mut view);
        view
    }
}

/// A cylinder in pieces of equal length.
fn pieces(whole: &ShankCylinder) -> impl Iterator<Item = Piece> {
    let whole = *whole;
    let ShankCylinder { from_mm, to_mm, radius_mm } = whole;
    let count = ((to_mm - from_mm) / SHANK_PIECE_MM).ceil().max(1.0) as usize;
    let at = move |n: usize| from_mm + (to_mm - from_mm) * (n as f64 / count as f64);
    (0..count).map(move |n| {
        let cylinder = ShankCylinder { from_mm: at(n), to_mm: at(n + 1), radius_mm };
        Piece { cylinder, whole, clear_mm: 0.0 }
    })
}
