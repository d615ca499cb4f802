//! The candidate directions of the shaft, and the turns between them.
//!
//! They are a finite set on the sphere: in a plane for an arm with one tilt ([`Directions::in_plane`]), or over a cap about
//! the approach for an arm with two ([`Directions::cap`]). For every direction a fan is stored: all other directions by
//! their angle from it, and for each of them the direction that is passed last on the way there. So testing whether a turn
//! passes a blocked direction takes one lookup per direction passed, and no edge of the layered graph over a path is stored.
//!
//! Invariants: there is at least one direction; the tilt limit itself is among the directions wherever they reach it, so
//! that rounding never exceeds it; the set is symmetric in x and in y wherever the plane is.

use std::f64::consts::PI;

use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::{TiltFamily, nearest_to_z};

/// Largest number of directions of a set. A cap of 60° has 721 at 4°.
pub const MOST_DIRECTIONS: usize = 1024;
/// Largest number of slots of a fan: a slot's number is stored in a byte, and four words hold one bit for each slot.
const MOST_SLOTS: usize = 256;
/// Largest number of steps in a plane, so that directions to either side fit into a fan.
const MOST_STEPS: f64 = 124.0;
/// A tilt may exceed its limit by this much because of rounding, rad.
const ROUNDING_RAD: f64 = 1e-9;
/// Directions nearer than this many spacings are neighbours, with no direction between them.
const NEIGHBOURS: f64 = 1.5;

/// A set of directions with their fans.
#[derive(Debug, Clone, PartialEq)]
pub struct Directions {
    axes: Vec<Unit<Vector3<f64>>>,
    /// The angle of each direction in its family, rad; `None` for a cap.
    angles_rad: Option<Vec<f64>>,
    limit_rad: f64,
    spacing_rad: f64,
    fans: Vec<Fan>,
}

/// All directions in the order of their angle from one direction, which comes first.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Fan {
    /// The number of the direction in each slot.
    pub node: Vec<u16>,
    /// The slot that is passed last on the way to each slot, along the shortest way over neighbours; 0 for neighbours.
    pub parent: Vec<u8>,
    /// Angle of each slot, rad, ascending.
    pub angle_rad: Vec<f32>,
    /// Square of the angle, rad².
    pub square: Vec<f64>,
}

impl Directions {
    /// Directions in a plane, about `step_rad` apart, over the whole family; `limit_rad` is the largest tilt from +z of a cut.
    ///
    /// The direction nearest to +z and, where the family reaches it, the limit itself on both sides are in the set.
    pub fn in_plane(family: &TiltFamily, step_rad: f64, limit_rad: f64) -> Self {
        let nearest = nearest_to_z(family);
        let span = family.upper_rad - family.lower_rad;
        let wanted = step_rad.max(1.01 * span / MOST_STEPS);
        // tilt(q): cos = cos(least tilt) cos(q − nearest); the limit is reached at nearest ± half
        let cosine = limit_rad.cos() / family.axis(nearest).z.clamp(-1.0, 1.0);
        let half = if cosine.abs() < 1.0 { cosine.acos() } else { 0.0 };
        let dividing = half / (half / wanted).round().max(1.0);
        // if dividing the range so that it meets the limit needs too many steps, the limit gets no direction
        let spacing_rad = if dividing * MOST_STEPS >= span && dividing > 0.0 { dividing } else { wanted };
        let count = |room: f64| (room.max(0.0) / spacing_rad + 1e-9).floor() as i64;
        let (below, above) = (count(nearest - family.lower_rad), count(family.upper_rad - nearest));
        let angle = |n: i64| (nearest + n as f64 * spacing_rad).clamp(family.lower_rad, family.upper_rad);
        let angles_rad: Vec<f64> = (-below..=above).map(angle).collect();
        let axes = angles_rad.iter().map(|q| family.axis(*q)).collect();
        Self::of(axes, Some(angles_rad), limit_rad, spacing_rad)
    }

    /// Directions over the cap of tilts up to `limit_rad` about +z, about `step_rad` apart: rings of 6, 12, 18, … directions.
    pub fn cap(step_rad: f64, limit_rad: f64) -> Self {
        let rings = (limit_rad / step_rad.max(1e-6)).ceil().max(0.0) as usize;
        Self::of_rings(rings.min(most_rings()), step_rad, limit_rad)
    }

    /// The same cap with every spacing divided into `times` parts, or into as many as [`MOST_DIRECTIONS`] allows; also the number
    /// that each of this set's directions has there. `None` for a plane, and where no division fits.
    pub fn finer(&self, times: usize) -> Option<(Self, Vec<u16>)> {
        let rings = self.rings().filter(|rings| *rings > 0)?;
        let times = (2..=times).rev().find(|times| rings * times <= most_rings())?;
        let finer = Self::of_rings(rings * times, self.spacing_rad / times as f64, self.limit_rad);
        let there = |ring: usize, place: usize| (first_of_ring(times * ring) + times * place) as u16;
        let places = |ring: usize| if ring == 0 { 1 } else { 6 * ring };
        let numbers = (0..=rings).flat_map(|ring| (0..places(ring)).map(move |place| there(ring, place)));
        Some((finer, numbers.collect()))
    }

    /// Number of rings of a cap; `None` for a plane.
    fn rings(&self) -> Option<usize> {
        (0..=most_rings())
            .find(|rings| first_of_ring(rings + 1) == self.len())
            .filter(|_| self.angles_rad.is_none())
    }

    fn of_rings(rings: usize, step_rad: f64, limit_rad: f64) -> Self {
        let spacing_rad = if rings == 0 { step_rad } else { limit_rad / rings as f64 };
        let mut axes = vec![Vector3::z_axis()];
        for ring in 1..=rings {
            let (sin, cos) = (ring as f64 * spacing_rad).sin_cos();
            for place in 0..6 * ring {
                let (s, c) = (place as f64 * PI / (3 * ring) as f64).sin_cos();
                axes.push(Unit::new_normalize(Vector3::new(sin * c, sin * s, cos)));
            }
        }
        Self::of(axes, None, limit_rad, spacing_rad)
    }

    fn of(
        axes: Vec<Unit<Vector3<f64>>>,
        angles_rad: Option<Vec<f64>>,
        limit_rad: f64,
        spacing_rad: f64,
    ) -> Self {
        let near: Vec<_> =
            (0..axes.len()).into_par_iter().map(|n| neighbours_of(&axes, n, spacing_rad)).collect();
        let fans = (0..axes.len()).into_par_iter().map(|n| fan(&axes, &near, n, spacing_rad)).collect();
        Self { axes, angles_rad, limit_rad, spacing_rad, fans }
    }

    /// Number of directions, at least 1.
    pub fn len(&self) -> usize {
        self.axes.len()
    }

    /// Always false: a set has at least one direction.
    pub fn is_empty(&self) -> bool {
        self.axes.is_empty()
    }

    /// Unit axes from the burr to the handpiece, in work.
    pub fn axes(&self) -> &[Unit<Vector3<f64>>] {
        &self.axes
    }

    /// The angle of each direction in its family, rad; `None` for a cap.
    pub fn angles_rad(&self) -> Option<&[f64]> {
        self.angles_rad.as_deref()
    }

    /// Approximate angle between neighbours, rad.
    pub fn spacing_rad(&self) -> f64 {
        self.spacing_rad
    }

    /// Whether a cut may have this axis.
    pub fn is_within_limit(&self, axis: &Vector3<f64>) -> bool {
        tilt_rad(axis) <= self.limit_rad + ROUNDING_RAD
    }

    /// The direction nearest to an axis; the first of equally near ones.
    pub fn nearest(&self, axis: &Vector3<f64>) -> usize {
        let mut best = (0, f64::NEG_INFINITY);
        for (n, a) in self.axes.iter().enumerate() {
            let cosine = a.dot(axis);
            if cosine > best.1 + 1e-12 {
                best = (n, cosine);
            }
        }
        best.0
    }

    /// The direction nearest to direction `from` among those for which `is_free` is true.
    pub fn nearest_of(&self, from: usize, is_free: impl Fn(usize) -> bool) -> Option<usize> {
        self.fans.get(from)?.node.iter().map(|n| usize::from(*n)).find(|n| is_free(*n))
    }

    /// The direction nearest to the approach among those for which `is_free` is true; if there is none, the direction nearest to
    /// the approach.
    pub fn straightest(&self, is_free: impl Fn(usize) -> bool) -> usize {
        let upright = self.nearest(&Vector3::z());
        self.nearest_of(upright, is_free).unwrap_or(upright)
    }

    /// Angle between two directions, rad.
    pub fn angle_rad(&self, a: usize, b: usize) -> f64 {
        angle_between(&self.axes[a], &self.axes[b])
    }

    /// An upper bound of the angle between two directions, rad, at most 5 % above it up to 1 rad; computed without a
    /// transcendental function.
    pub(super) fn angle_at_most(&self, a: usize, b: usize) -> f64 {
        let chord = (self.axes[a].into_inner() - self.axes[b].into_inner()).norm();
        // 2 asin(c/2) is convex, so it lies below its chord from 0 to π/3 at c = 1
        if chord <= 1.0 { chord * (PI / 3.0) } else { PI }
    }

    /// The neighbours of `n`, nearest first, without `n` itself.
    pub fn neighbours(&self, n: usize) -> impl Iterator<Item = usize> + '_ {
        self.within(n, NEIGHBOURS * self.spacing_rad).skip(1)
    }

    /// Directions within an angle of `n`, rad: `n` itself, then the others, nearest first; at most as many as a fan has.
    pub fn within(&self, n: usize, angle_rad: f64) -> impl Iterator<Item = usize> + '_ {
        let fan = &self.fans[n];
        let end = fan.angle_rad.partition_point(|a| f64::from(*a) <= angle_rad);
        fan.node[..end].iter().map(|m| usize::from(*m))
    }

    pub(super) fn fan(&self, n: usize) -> &Fan {
        &self.fans[n]
    }
}

/// The number of a ring's first direction: 1 + 3 n (n + 1) directions lie in rings 0 to n.
fn first_of_ring(ring: usize) -> usize {
    if ring == 0 { 0 } else { 1 + 3 * ring * (ring - 1) }
}

/// Largest number of rings of a cap.
fn most_rings() -> usize {
    (0..).take_while(|rings| first_of_ring(rings + 1) <= MOST_DIRECTIONS).last().unwrap_or(0)
}

/// Angle of an axis from +z, rad; accurate also near 0, where acos loses half its digits.
pub fn tilt_rad(axis: &Vector3<f64>) -> f64 {
    axis.x.hypot(axis.y).atan2(axis.z)
}

/// Angle between two unit axes, rad.
pub fn angle_between(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

/// The neighbours of a direction, with their angles.
fn neighbours_of(axes: &[Unit<Vector3<f64>>], of: usize, spacing_rad: f64) -> Vec<(usize, f64)> {
    let least_cosine = (NEIGHBOURS * spacing_rad).cos() - 1e-6;
    let near = axes.iter().enumerate().filter(|(_, a)| a.dot(&axes[of]) >= least_cosine);
    let angles = near.map(|(n, a)| (n, angle_between(&axes[of], a)));
    angles.filter(|(n, angle)| *n != of && *angle <= NEIGHBOURS * spacing_rad).collect()
}

fn fan(axes: &[Unit<Vector3<f64>>], near: &[Vec<(usize, f64)>], from: usize, spacing_rad: f64) -> Fan {
    let cosines: Vec<f64> = axes.iter().map(|a| a.dot(&axes[from])).collect();
    // the directions that can have a slot, with a margin for rounding
    let mut greatest = cosines.clone();
    let least_cosine = match greatest.get(MOST_SLOTS) {
        Some(_) => *greatest.select_nth_unstable_by(MOST_SLOTS, |a, b| b.total_cmp(a)).1 - 1e-6,
        None => f64::NEG_INFINITY,
    };
    let within = (0..axes.len()).filter(|n| cosines[*n] >= least_cosine);
    let mut by_angle: Vec<(f64, usize)> = within.map(|n| (angle_between(&axes[from], &axes[n]), n)).collect();
    // angles that are equal up to rounding count as equal; then the order in the set decides, the same on every machine
    by_angle.sort_by_key(|(angle, n)| ((angle * 1e9).round() as i64, *n));
    by_angle.truncate(MOST_SLOTS);
    // the shortest way over neighbours, each nearer than the next one
    let mut parent = Vec::with_capacity(by_angle.len());
    let mut length: Vec<f64> = Vec::with_capacity(by_angle.len());
    let mut slot_of = vec![usize::MAX; axes.len()];
    for (slot, (angle, node)) in by_angle.iter().enumerate() {
        let (mut before, mut shortest) = (0, *angle);
        if *angle > NEIGHBOURS * spacing_rad {
            shortest = f64::INFINITY;
            for (m, last) in &near[*node] {
                // directions that already have a slot are not farther
                let s = slot_of[*m];
                if s < slot && by_angle[s].0 < angle - 1e-9 && length[s] + last < shortest - 1e-12 {
                    (before, shortest) = (s, length[s] + last);
                }
            }
        }
        slot_of[*node] = slot;
        parent.push(before as u8);
        length.push(shortest);
    }
    Fan {
        node: by_angle.iter().map(|(_, n)| *n as u16).collect(),
        parent,
        angle_rad: by_angle.iter().map(|(angle, _)| *angle as f32).collect(),
        square: by_angle.iter().map(|(angle, _)| angle * angle).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn family(zero: Vector3<f64>) -> TiltFamily {
        TiltFamily {
            hinge: Vector3::x_axis(),
            zero: Unit::new_normalize(zero),
            lower_rad: -1.22,
            upper_rad: 1.22,
        }
    }

    #[test]
    fn the_limit_is_a_direction_on_both_sides_also_in_a_leaning_plane() {
        for zero in [Vector3::z(), Vector3::new(0.3, 0.1, 1.0)] {
            let limit = 50.3f64.to_radians();
            let set = Directions::in_plane(&family(zero), 2f64.to_radians(), limit);
            let at_limit = set.axes().iter().filter(|a| (tilt_rad(a) - limit).abs() < 1e-9).count();
            assert_eq!(at_limit, 2);
            assert!(set.axes().iter().any(|a| tilt_rad(a) > limit), "links may tilt farther");
            assert!((set.spacing_rad() / 2f64.to_radians() - 1.0).abs() < 0.05);
        }
    }

    #[test]
    fn a_plane_that_never_comes_within_the_limit_has_no_direction_for_cuts() {
        let set = Directions::in_plane(&family(Vector3::new(1.0, 0.0, 0.2)), 0.05, 0.5);
        assert!(!set.axes().iter().any(|a| set.is_within_limit(a)));
    }

    #[test]
    fn a_cap_ends_at_its_limit_and_is_even() {
        let limit = 60f64.to_radians();
        let set = Directions::cap(6f64.to_radians(), limit);
        assert_eq!(set.len(), 331);
        assert!(set.axes().iter().all(|a| set.is_within_limit(a)));
        for n in 0..set.len() {
            let nearest = set.neighbours(n).map(|m| set.angle_rad(n, m)).fold(f64::INFINITY, f64::min);
            assert!(nearest > 0.8 * set.spacing_rad() && nearest < 1.06 * set.spacing_rad());
            // mirrored in x and in y
            let [mut x, mut y] = [set.axes()[n].into_inner(); 2];
            (x.x, y.y) = (-x.x, -y.y);
            for m in [x, y] {
                assert!(angle_between(&set.axes()[set.nearest(&m)], &m) < 1e-12);
            }
        }
    }

    #[test]
    fn fine_sets_are_capped_and_no_limit_leaves_the_approach() {
        assert!(Directions::cap(0.01, 1.0).len() <= MOST_DIRECTIONS);
        assert!(Directions::in_plane(&family(Vector3::z()), 1e-4, 1.0).len() <= MOST_SLOTS / 2);
        assert_eq!(Directions::cap(0.1, 0.0).len(), 1);
    }

    #[test]
    fn a_finer_cap_holds_every_direction_of_the_coarser() {
        for (step, limit, times, divided) in
            [(0.2, 1.0, 3, 3), (0.21, 1.05, 2, 2), (0.05, 0.7, 5, 1), (0.1, 0.8, 3, 2)]
        {
            let coarse = Directions::cap(step, limit);
            let Some((fine, numbers)) = coarse.finer(times) else {
                assert_eq!(divided, 1);
                continue;
            };
            assert!((coarse.spacing_rad() / fine.spacing_rad() - divided as f64).abs() < 1e-9);
            assert_eq!(numbers.len(), coarse.len());
            for (axis, number) in coarse.axes().iter().zip(numbers) {
                assert!(angle_between(axis, &fine.axes()[usize::from(number)]) < 1e-12);
            }
        }
        assert!(Directions::in_plane(&family(Vector3::z()), 0.1, 1.0).finer(2).is_none());
        assert!(Directions::cap(0.1, 0.0).finer(3).is_none());
    }

    /// The way leads from neighbour to neighbour and stays near the great circle.
    #[test]
    fn the_way_of_a_fan_is_connected_and_nearly_straight() {
        for set in [
            Directions::cap(10f64.to_radians(), 60f64.to_radians()),
            Directions::in_plane(&family(Vector3::z()), 0.05, 1.0),
        ] {
            for n in 0..set.len() {
                let fan = set.fan(n);
                assert_eq!(usize::from(fan.node[0]), n);
                for slot in 1..fan.node.len() {
                    let (mut here, mut length) = (slot, 0.0);
                    while here != 0 {
                        let next = usize::from(fan.parent[here]);
                        assert!(next < here);
                        let step = set.angle_rad(usize::from(fan.node[here]), usize::from(fan.node[next]));
                        assert!(step <= NEIGHBOURS * set.spacing_rad() + 1e-9, "{step}");
                        length += step;
                        here = next;
                    }
                    let straight = f64::from(fan.angle_rad[slot]);
                    // the worst ratio of a hexagonal lattice is 1.155, and short ways deviate by a part of a spacing
                    let most = 1.16 * straight + 0.25 * set.spacing_rad();
                    assert!(length <= most, "{length} for {straight}");
                }
            }
        }
    }
}
