//! Boxes: the limits of ṡ and s̈ on each stretch of the path, for one window length T.
//!
//! A box means ṡ ≤ v and |s̈| ≤ A. For every joint, with P, c, e the greatest |q'|, |q''|, |q'''| of the stretch:
//!
//! ```text
//! P v ≤ q̇max      c v² ≤ q̈max/2      e v³ ≤ 0.6 q⃛max      P A ≤ q̈max/2 (q̈max where c = 0)
//! f + 2 P A/T ≤ q⃛max,  f the greatest |q''' ṡ³ + 3 q'' ṡ s̈| of the corner
//! ```
//!
//! In a corner q''' is greatest at the ends and q'' in the middle: with x = |1 − 2u|, f = max e v³ x + 3 c v A (1 − x²). It is
//! e v³ as long as 6 c v A ≤ e v³, that is A ≤ v²/(3l), and at most 3 c v A + e v³/2 beyond.
//!
//! A box applies up to v T around its stretch ([`spread`]), because the window averages motion from no farther away.
//! Invariants: stretches lie end to end over the whole path; v and A are above 0 and finite.

use super::geometry::{Geometry, PathElement};
use super::input::PathLimits;

/// A stretch of the path with one box.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    /// Its length, mm; above 0.
    pub length_mm: f64,
    /// v, mm/s.
    pub speed_mm_s: f64,
    /// A, mm/s².
    pub acceleration_mm_s2: f64,
    /// The stretch's own box, which also applies around it.
    own: SpeedBounds,
    /// Whether s stands still at its start.
    pub starts_at_rest: bool,
}

/// Upper limit of all speeds, mm/s, so that numbers stay finite where no limit applies.
const ABSURD_MM_S: f64 = 1e6;

/// Share of the jerk limit that a corner's shape may use.
const SNAP_SHARE: f64 = 0.6;

/// The box of an element without speed caps: v and A for a window of length T.
#[derive(Debug, Clone, Copy, PartialEq)]
struct SpeedBounds {
    speed_mm_s: f64,
    acceleration_mm_s2: f64,
}

fn straight(geometry: &Geometry, limits: &PathLimits, i: usize, window_s: f64) -> SpeedBounds {
    let (mut speed, mut acceleration) = (ABSURD_MM_S, ABSURD_MM_S);
    for (j, d) in geometry.direction(i).iter().enumerate() {
        let d = d.abs();
        if d > 0.0 {
            speed = speed.min(limits.velocity[j] / d);
            acceleration = acceleration.min(limits.acceleration[j].min(0.5 * limits.jerk[j] * window_s) / d);
        }
    }
    SpeedBounds { speed_mm_s: speed, acceleration_mm_s2: acceleration }
}

fn blend(geometry: &Geometry, limits: &PathLimits, i: usize, window_s: f64) -> SpeedBounds {
    let corner = geometry.corner(i);
    let mut speed = ABSURD_MM_S;
    for (j, [slope, bend, snap]) in corner.bounds().enumerate() {
        speed = speed
            .min(limits.velocity[j] / slope)
            .min((0.5 * limits.acceleration[j] / bend).sqrt())
            .min((SNAP_SHARE * limits.jerk[j] / snap).cbrt());
    }
    let natural = speed * speed / (3.0 * corner.half_mm);
    let mut acceleration = ABSURD_MM_S;
    for (j, [slope, bend, snap]) in corner.bounds().enumerate() {
        let (jerk, turning) = (limits.jerk[j], snap * speed.powi(3));
        let gentle = (jerk - turning) * window_s / (2.0 * slope);
        let hard = (jerk - 0.5 * turning) / (3.0 * bend * speed + 2.0 * slope / window_s);
        let allowed = if gentle <= natural { gentle } else { natural.max(hard) };
        acceleration = acceleration.min(0.5 * limits.acceleration[j] / slope).min(allowed);
    }
    SpeedBounds { speed_mm_s: speed, acceleration_mm_s2: acceleration }
}

/// The stretches of a path under speed caps of its kept segments (mm/s; ∞ where the burr stands still).
pub(super) fn stretches(
    geometry: &Geometry,
    limits: &PathLimits,
    caps_mm_s: &[f64],
    window_s: f64,
) -> Vec<Stretch> {
    // there is no speed cap where the burr stands still: cap / 0 = ∞
    let capped = |cap: f64, burr_per_s: f64, speed: f64| speed.min(cap / burr_per_s);
    let corner = |i: usize| -> Option<SpeedBounds> {
        (geometry.half_blend_mm[i] > 0.0).then(|| {
            let mut allowed = blend(geometry, limits, i, window_s);
            let burr_per_s = geometry.burr_per_s[i - 1].max(geometry.burr_per_s[i]);
            // in a corner before a rotation in place the burr still moves
            let cap = caps_mm_s[i - 1].min(caps_mm_s[i]);
            allowed.speed_mm_s = capped(cap, burr_per_s, allowed.speed_mm_s);
            allowed
        })
    };
    let mut stretches = Vec::with_capacity(2 * geometry.count());
    for (i, &cap) in caps_mm_s.iter().enumerate() {
        let (l1, l2) = (geometry.half_blend_mm[i], geometry.half_blend_mm[i + 1]);
        let length = geometry.length_mm[i] - l1 - l2;
        let mut starts_at_rest = geometry.stop[i];
        let mut push = |length_mm: f64, own: SpeedBounds| {
            let SpeedBounds { speed_mm_s, acceleration_mm_s2 } = own;
            stretches.push(Stretch { length_mm, speed_mm_s, acceleration_mm_s2, own, starts_at_rest });
            starts_at_rest = false;
        };
        if length > 1e-12 * geometry.length_mm[i] {
            let mut own = straight(geometry, limits, i, window_s);
            own.speed_mm_s = capped(cap, geometry.burr_per_s[i], own.speed_mm_s);
            push(length, own);
        }
        if let Some(own) = corner(i + 1) {
            push(2.0 * l2, own);
        }
    }
    let forth = spread(stretches.into_iter(), window_s, false);
    let mut back = spread(forth.into_iter().rev(), window_s, true);
    back.reverse();
    back
}

/// A box that still applies for some distance.
#[derive(Debug, Clone, Copy)]
struct Zone {
    left_mm: f64,
    holds: SpeedBounds,
}

/// Extends every box by v T behind its stretch, in the given order; stretches are divided where a box's zone ends. A zone
/// ends at a rest, because there the window contains only one side. `reversed`: stretches come last to first.
fn spread(stretches: impl Iterator<Item = Stretch>, window_s: f64, reversed: bool) -> Vec<Stretch> {
    let mut spread: Vec<Stretch> = Vec::with_capacity(2 * stretches.size_hint().0);
    let mut zones: Vec<Zone> = Vec::new();
    for stretch in stretches {
        if stretch.starts_at_rest && !reversed {
            zones.clear();
        }
        divide(&stretch, &zones, reversed, &mut spread);
        for zone in &mut zones {
            zone.left_mm -= stretch.length_mm;
        }
        let new = Zone { left_mm: stretch.own.speed_mm_s * window_s, holds: stretch.own };
        // a zone that ends sooner and is not stricter than the new one is dropped
        zones.retain(|zone| {
            zone.left_mm > 0.0
                && (zone.left_mm > new.left_mm
                    || zone.holds.speed_mm_s < new.holds.speed_mm_s
                    || zone.holds.acceleration_mm_s2 < new.holds.acceleration_mm_s2)
        });
        zones.push(new);
        if stretch.starts_at_rest && reversed {
            zones.clear();
        }
    }
    spread
}

/// Divides a stretch by the zones that reach into it.
fn divide(stretch: &Stretch, zones: &[Zone], reversed: bool, into: &mut Vec<Stretch>) {
    let binds = |zone: &&Zone| {
        zone.holds.speed_mm_s < stretch.speed_mm_s
            || zone.holds.acceleration_mm_s2 < stretch.acceleration_mm_s2
    };
    let shortest = 1e-9 * stretch.length_mm;
    let mut from_mm = 0.0;
    let mut is_first = true;
    while from_mm < stretch.length_mm {
        let covering = || zones.iter().filter(binds).filter(|zone| zone.left_mm > from_mm + shortest);
        let nearest = covering().map(|zone| zone.left_mm).fold(stretch.length_mm, f64::min);
        let to_mm = if nearest + shortest >= stretch.length_mm { stretch.length_mm } else { nearest };
        let mut part = Stretch { length_mm: to_mm - from_mm, ..*stretch };
        for Zone { holds, .. } in covering() {
            part.speed_mm_s = part.speed_mm_s.min(holds.speed_mm_s);
            part.acceleration_mm_s2 = part.acceleration_mm_s2.min(holds.acceleration_mm_s2);
        }
        // the rest is at the start, which comes last when reversed
        part.starts_at_rest =
            stretch.starts_at_rest && if reversed { to_mm == stretch.length_mm } else { is_first };
        into.push(part);
        (from_mm, is_first) = (to_mm, false);
    }
}

/// The element that a place on the path belongs to, as an index into [`Geometry::elements`].
pub(super) fn element_at(elements: &[(f64, f64, PathElement)], s_mm: f64) -> usize {
    elements.partition_point(|(start, ..)| *start <= s_mm).saturating_sub(1)
}
