//! The shank during a whole move, while it turns from one axis to the next.
//!
//! The move is tested at places so close together that no point of the thin shank moves farther than [`STRIDE_MM`] between
//! two of them, with a shank that is widened by the volume swept between them. If this does not decide, the distance is
//! halved and the shank made less wide, up to [`HALVINGS`] times. The move is blocked if at some place the shank lacks even
//! the room for the arm's tolerance, or if the last halving, at which the shank is widened by 3 µm, does not show that it
//! is free.

use bonemill_geometry::{Point, Work};
use nalgebra::{Unit, Vector3};

use super::{Access, Narrower, PosedShank, STRIDE_MM};
use crate::path::PathPoint;

/// Distance from the burr at which a turn's motion is measured: the thin shank's end, mm.
const LEVER_MM: f64 = 30.0;
/// Largest number of places tested between two waypoints; more than any move needs.
const MOST_BETWEEN: f64 = 4000.0;
/// Number of halvings of the distance before an undecided move counts as blocked.
const HALVINGS: i32 = 3;
/// Upper limit of the reduction that is searched, mm.
const MOST_MISSING_MM: f64 = 8.0;
/// Accuracy of the missing room, mm.
const MISSING_MM: f64 = 1e-3;

/// A move of the burr's centre from `a` to `b` while the shaft turns from `from` to `to`; `index`: the move's number.
#[derive(Debug, Clone, Copy)]
pub struct Turn<'a> {
    /// Number of the move. Bone that this move itself removes still stands.
    pub index: u32,
    /// Where it begins.
    pub a: Point<Work>,
    /// Where it ends.
    pub b: Point<Work>,
    /// The axis at its beginning.
    pub from: &'a Unit<Vector3<f64>>,
    /// The axis at its end.
    pub to: &'a Unit<Vector3<f64>>,
}

impl<'a> Turn<'a> {
    /// The move that ends at waypoint i of a path, with the axes at its ends.
    pub fn along(points: &[PathPoint], i: usize, [from, to]: [&'a Unit<Vector3<f64>>; 2]) -> Self {
        Self { index: i as u32, a: points[i - 1].position, b: points[i].position, from, to }
    }

    /// Places between the move's ends, no more than `stride_mm` apart.
    fn places(&self, stride_mm: f64) -> impl Iterator<Item = (Point<Work>, Unit<Vector3<f64>>)> {
        let Self { a, b, from, to, .. } = *self;
        let travel_mm = a.distance_mm(&b) + LEVER_MM * from.angle(to);
        let pieces = (travel_mm / stride_mm).ceil().clamp(1.0, MOST_BETWEEN) as usize;
        (1..pieces).map(move |k| {
            let t = k as f64 / pieces as f64;
            // between nearly equal axes the chord is the arc
            (a + (b - a) * t, Unit::try_new(from.lerp(to, t), 1e-9).unwrap_or(*to))
        })
    }
}

impl Access<'_> {
    /// Whether the shank is free throughout a move at whose ends it is known to be free.
    pub fn is_turn_free(&self, turn: &Turn) -> bool {
        let tolerance_alone = Narrower { between_share: 1.0, by_mm: 0.0 };
        for halving in 0..=HALVINGS {
            let nearer = 0.5f64.powi(halving);
            let narrower = Narrower { between_share: 1.0 - nearer, by_mm: 0.0 };
            let mut is_certain = true;
            for place in turn.places(nearer * STRIDE_MM) {
                if self.is_place_free(turn.index, &place, narrower) {
                    continue;
                }
                if halving == HALVINGS || !self.is_place_free(turn.index, &place, tolerance_alone) {
                    return false;
                }
                is_certain = false;
            }
            if is_certain {
                return true;
            }
        }
        false
    }

    /// By how much the thin shank would have to be narrower to be free throughout a move, mm; infinite where a narrower shank
    /// does not help, as when the handpiece is blocked.
    pub fn missing_mm(&self, turn: &Turn) -> f64 {
        let is_free = |by_mm: f64| {
            let narrower = Narrower { between_share: 1.0, by_mm };
            turn.places(STRIDE_MM).all(|place| self.is_place_free(turn.index, &place, narrower))
        };
        let [mut low_mm, mut high_mm] = [0.0, MOST_MISSING_MM];
        if !is_free(high_mm) {
            return f64::INFINITY;
        }
        while high_mm - low_mm > MISSING_MM {
            let middle_mm = 0.5 * (low_mm + high_mm);
            if is_free(middle_mm) { high_mm = middle_mm } else { low_mm = middle_mm }
        }
        high_mm
    }

    fn is_place_free(
        &self,
        index: u32,
        (center, axis): &(Point<Work>, Unit<Vector3<f64>>),
        narrower: Narrower,
    ) -> bool {
        self.blocked_pose(&PosedShank { index, center: *center, axis, narrower }).is_none()
    }
}
