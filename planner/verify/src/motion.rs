//! Checks the joints over time: times, ranges, velocity, acceleration and jerk, at every instant between the rows.
//!
//! Rows hold position and velocity once per period, and nothing about the motion between. So for each interval the least
//! values of any motion between its ends are computed: the least acceleration A = (2|Δ| + √(4Δ² + dt² dv²))/dt², with Δ the
//! distance beyond (v₀ + v₁) dt/2 and dv = v₁ − v₀ (two stretches with ±A cover Δ = (A² dt² − dv²)/(4A) more than the mean;
//! solved for A); and, within the acceleration limit, the least peak speed. If these exceed a limit, every possible motion of
//! the controller does. Sampling the motion, at 10 kHz or any other rate, would not find more.

use bonemill_arm::{Arm, JointKind};
use bonemill_planfile::Trajectory;

use super::check::{Check, Place};

/// Rounding of the file: half a unit of the last decimal, in mm and mm/s or in rad and rad/s.
pub fn rounding(kind: JointKind) -> f64 {
    match kind {
        JointKind::Prismatic => 0.5e-7,
        JointKind::Revolute => 0.5e-9,
    }
}

/// The limits with which a trajectory is compared.
#[derive(Debug, Clone, Copy)]
pub struct MotionLimits<'a> {
    /// Joint ranges, velocities, accelerations, jerks.
    pub arm: &'a Arm,
    /// Rows per second.
    pub rate_hz: f64,
    /// When the last waypoint is passed, s.
    pub end_s: f64,
}

/// The largest value, and its time.
#[derive(Debug, Clone, Copy)]
struct Worst {
    value: f64,
    time_s: f64,
}

impl Worst {
    const NONE: Self = Self { value: f64::NEG_INFINITY, time_s: 0.0 };

    fn take(&mut self, value: f64, time_s: f64) {
        // NaN is kept, so that the check fails
        if value > self.value || value.is_nan() {
            *self = Self { value, time_s };
        }
    }

    fn check(self, name: &'static str, joint: &str, limit: f64, unit: &'static str) -> Check {
        let place = Place::Named(format!("t = {:.4} s", self.time_s));
        Check::at_most(name, self.value, limit, unit).of(joint).at(place)
    }
}

/// Checks times, ranges and limits.
pub fn motion(rows: &Trajectory, limits: &MotionLimits) -> Vec<Check> {
    let mut checks = clock(rows, limits);
    for (joint, about) in limits.arm.joints().iter().enumerate() {
        let prismatic = about.kind == JointKind::Prismatic;
        let units = if prismatic {
            ["mm", "mm/s", "mm/s²", "mm/s³"]
        } else {
            ["rad", "rad/s", "rad/s²", "rad/s³"]
        };
        let grain = rounding(about.kind);
        let mut range = Worst::NONE;
        let (mut velocity, mut acceleration, mut jerk) = (Worst::NONE, Worst::NONE, Worst::NONE);
        let state = |row: usize| (rows.time_s[row], rows.q_at(row)[joint], rows.qd_at(row)[joint]);
        for row in 0..rows.len() {
            let (t, q, v) = state(row);
            range.take((about.lower - q).max(q - about.upper), t);
            velocity.take(v.abs(), t);
            if row > 0 {
                let (t0, q0, v0) = state(row - 1);
                let least = Least::between([q0, v0], [q, v], t - t0, grain, about.acceleration_limit);
                velocity.take(least.speed, t0);
                acceleration.take(least.acceleration, t0);
            }
            if row > 1 {
                let ((t0, _, v0), (t1, _, v1)) = (state(row - 2), state(row - 1));
                let bend = (v - v1) / (t - t1) - (v1 - v0) / (t1 - t0);
                let span = 0.5 * (t - t0);
                jerk.take((bend.abs() - 4.0 * grain / span).max(0.0) / span, t0);
            }
        }
        // 1e-9 of the limit is allowed for the rounding of sums
        let limit = |v: f64| v * (1.0 + 1e-9);
        checks.push(range.check("joint range", &about.name, grain, units[0]));
        checks.push(velocity.check(
            "joint velocity",
            &about.name,
            limit(about.velocity_limit) + grain,
            units[1],
        ));
        checks.push(acceleration.check(
            "joint acceleration",
            &about.name,
            limit(about.acceleration_limit),
            units[2],
        ));
        checks.push(jerk.check("joint jerk", &about.name, limit(about.jerk_limit), units[3]));
    }
    checks
}

/// Checks that rows are at k/rate from 0 to the last waypoint, at rest at both ends.
fn clock(rows: &Trajectory, limits: &MotionLimits) -> Vec<Check> {
    let mut off = Worst::NONE;
    for (row, time_s) in rows.time_s.iter().enumerate() {
        off.take((time_s - row as f64 / limits.rate_hz).abs(), *time_s);
    }
    let last = rows.time_s.last().copied().unwrap_or(0.0);
    let rest = |row: usize| rows.qd_at(row).iter().fold(0f64, |most, v| most.max(v.abs()));
    let ends = rest(0).max(rest(rows.len() - 1));
    let period_s = 1.0 / limits.rate_hz;
    vec![
        off.check("trajectory clock", "rows at k/rate", 1e-9, "s"),
        Check::at_most("trajectory clock", (last - limits.end_s).abs(), period_s + 1e-9, "s")
            .of("ends with the last waypoint")
            .at(Place::Named(format!("t = {last:.4} s"))),
        Check::at_most("rest at both ends", ends, 1e-9, "mm/s or rad/s"),
    ]
}

/// The least values of any motion between two rows.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Least {
    acceleration: f64,
    speed: f64,
}

impl Least {
    /// The least values between two rows. `grain`: rounding of each of the four numbers, which is subtracted; `most`: the joint's
    /// acceleration limit.
    fn between([q0, v0]: [f64; 2], [q1, v1]: [f64; 2], dt: f64, grain: f64, most: f64) -> Self {
        let beyond = q1 - q0 - 0.5 * (v0 + v1) * dt;
        let delta = (beyond.abs() - grain * (2.0 + dt)).max(0.0);
        let dv = ((v1 - v0).abs() - 2.0 * grain).max(0.0);
        let acceleration = (2.0 * delta + (4.0 * delta * delta + dt * dt * dv * dv).sqrt()) / (dt * dt);
        // the distance less its rounding, independent of the direction
        let way = (q1 - q0).abs() - 2.0 * grain;
        let side = (q1 - q0).signum();
        let speed = peak_speed(way.max(0.0), side * v0, side * v1, dt, most).max(v0.abs()).max(v1.abs());
        Self { acceleration, speed }
    }
}

/// The lowest peak speed of a motion over `way` ≥ 0 in `dt` from v₀ to v₁ within the acceleration a.
///
/// The motion accelerates with a to v, stays at v and decelerates with a: way = v dt − ((v − v₀)² + (v − v₁)²)/(2a), solved
/// for the smaller v. If no such v is above both ends, the ends are the fastest; if there is none at all, the check of the
/// acceleration fails.
fn peak_speed(way: f64, v0: f64, v1: f64, dt: f64, a: f64) -> f64 {
    let b = v0 + v1 + a * dt;
    let c = 0.5 * (v0 * v0 + v1 * v1) + a * way;
    let root = b * b - 4.0 * c;
    // a motion that is just feasible must not be refused because of rounding
    let peak = if root >= -1e-9 * b * b { 0.5 * (b - root.max(0.0).sqrt()) } else { way / dt };
    if peak >= v0.max(v1) { peak } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_gentlest_motion_of_a_two_stretch_move_is_that_move() {
        // acceleration +3 for 0.4 s, then -3 for 0.6 s, from 1 mm/s
        let (a, t1, t2, v0) = (3.0, 0.4, 0.6, 1.0);
        let peak = v0 + a * t1;
        let q1 = v0 * t1 + 0.5 * a * t1 * t1 + peak * t2 - 0.5 * a * t2 * t2;
        let found = Least::between([0.0, v0], [q1, peak - a * t2], t1 + t2, 0.0, a);
        assert!((found.acceleration - a).abs() < 1e-12 && (found.speed - peak).abs() < 1e-12, "{found:?}");
        // with more acceleration the same distance needs a lower peak speed, but never less than the mean
        let found = Least::between([0.0, v0], [q1, peak - a * t2], t1 + t2, 0.0, 1e6);
        assert!(found.speed < peak && found.speed >= q1 / (t1 + t2) - 1e-6, "{found:?}");
    }

    #[test]
    fn no_motion_through_the_rows_is_gentler() {
        // random stretches of constant acceleration within 2: the least acceleration is never more than that
        for seed in 0..500usize {
            let (mut q, mut v) = (0.0, 0.3);
            for n in 0..5usize {
                let a = ((seed * 31 + n * 17) % 41) as f64 / 10.0 - 2.0;
                q += v * 0.1 + 0.5 * a * 0.01;
                v += a * 0.1;
            }
            assert!(Least::between([0.0, 0.3], [q, v], 0.5, 0.0, 2.0).acceleration <= 2.0 + 1e-12);
        }
    }
}
