//! How long the moves take: by constant speeds, and by axes whose acceleration and jerk are limited.
//!
//! The published estimate is Σ length/speed. The limited law starts and ends every move at a speed that the corner allows, and reaches its feed by
//! ramps of limited acceleration and jerk; [`limited_s`] bounds the time from above by treating each straight stretch on its own.

use crate::job::{Job, Machine};
use crate::moves::Move;

/// Times of a program.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Times {
    /// By constant speeds, s. **Source:** Castelli et al. 2020, section 4.3.
    pub constant_s: f64,
    /// With limited acceleration and jerk, s.
    pub limited_s: f64,
    /// Of `constant_s`: at feed, s.
    pub cutting_s: f64,
}

/// Enters into every move when it ends by constant speeds, and gives the times.
pub fn times(moves: &mut [Move], job: &Job) -> Times {
    let (mut constant_s, mut cutting_s) = (0.0, 0.0);
    let mut before: Option<Move> = None;
    for step in moves.iter_mut() {
        let took = before.map_or(0.0, |before| duration_s(&before, step, &job.machine));
        constant_s += took;
        if step.kind.cuts() {
            cutting_s += took;
        }
        step.time_s = constant_s;
        before = Some(*step);
    }
    Times { constant_s, limited_s: limited_s(moves, &job.machine), cutting_s }
}

/// Of a move by constant speeds, s.
fn duration_s(from: &Move, to: &Move, machine: &Machine) -> f64 {
    let turn_s = (to.a_rad - from.a_rad).abs() / machine.rotary_rad_s;
    (to.tip_mm - from.tip_mm).norm() / to.feed_mm_min * 60.0 + turn_s
}

/// Corners slower than this angle's cosine are driven through: the junction speed keeps a deviation of 0.01 mm.
const JUNCTION_MM: f64 = 0.01;

/// With limited acceleration a and jerk j: a look-ahead over the moves, trapezoids in speed, a/j added where a move speeds up or slows down.
///
/// Speed at a junction of half-angle φ between moves: v² = a d sin φ/(1 − sin φ), d = 0.01 mm. Speeds are then made reachable forth and back,
/// v₁² ≤ v₀² + 2 a l.
///
/// **Source:** junction deviation as in the open controllers' look-ahead (Sungeun K. Jeon 2011, Grbl); the jerk's a/j per speed change is the time that a
/// moving average of length a/j adds to a trapezoid.
fn limited_s(moves: &[Move], machine: &Machine) -> f64 {
    let (a, jerk_s) = (machine.acceleration_mm_s2, machine.acceleration_mm_s2 / machine.jerk_mm_s3);
    let turns: f64 = moves.windows(2).map(|m| (m[1].a_rad - m[0].a_rad).abs() / machine.rotary_rad_s).sum();
    let legs: Vec<(nalgebra::Vector3<f64>, f64, f64)> = moves
        .windows(2)
        .map(|m| (m[1].tip_mm - m[0].tip_mm, m[1].feed_mm_min / 60.0))
        .filter(|(d, _)| d.norm() > 0.0)
        .map(|(d, speed)| (d.normalize(), d.norm(), speed))
        .collect();
    let junction = |n: usize| {
        let (before, after) = (&legs[n - 1], &legs[n]);
        let cosine = -before.0.dot(&after.0);
        let sine = (0.5 * (1.0 - cosine)).max(0.0).sqrt();
        let corner =
            if sine > 0.999_999 { f64::INFINITY } else { (a * JUNCTION_MM * sine / (1.0 - sine)).sqrt() };
        corner.min(before.2).min(after.2)
    };
    let count = legs.len();
    let mut speed: Vec<f64> =
        (0..=count).map(|n| if n == 0 || n == count { 0.0 } else { junction(n) }).collect();
    for n in 0..count {
        speed[n + 1] = speed[n + 1].min((speed[n] * speed[n] + 2.0 * a * legs[n].1).sqrt());
    }
    for n in (0..count).rev() {
        speed[n] = speed[n].min((speed[n + 1] * speed[n + 1] + 2.0 * a * legs[n].1).sqrt());
    }
    let leg_s = |n: usize| {
        let (_, length, most) = legs[n];
        let (v0, v1) = (speed[n], speed[n + 1]);
        let peak = most.min((a * length + 0.5 * (v0 * v0 + v1 * v1)).sqrt());
        let ramps = (2.0 * peak * peak - v0 * v0 - v1 * v1) / (2.0 * a);
        let changes = f64::from(u8::from(peak > v0 + 1e-9)) + f64::from(u8::from(peak > v1 + 1e-9));
        (2.0 * peak - v0 - v1) / a + (length - ramps).max(0.0) / peak.max(1e-9) + 0.5 * jerk_s * changes
    };
    turns + (0..count).map(leg_s).sum::<f64>()
}
