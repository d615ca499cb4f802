//! Checks that the joint trajectory is the waypoints' motion: position, axis, time and speed, by forward kinematics of every
//! row.
//!
//! A row agrees with the polyline if at one place of the polyline both the burr is within a distance and the shaft within an
//! angle. The place is searched on the moves near the one of that instant, so a trajectory that leaves out a move does not
//! agree.

use bonemill_geometry::{Base, Rigid, Work, cancel};
use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::VerifyError;
use super::check::{Check, Place};
use super::motion::rounding;
use super::moves::{Executed, MoveClass, Moves, angle_rad, between};

/// Largest distance of the burr from the polyline, mm.
const PLACE_MM: f64 = 0.05;
/// Largest angle between the shaft and the polyline's axis, rad.
const AXIS_RAD: f64 = 0.005;
/// Moves before and after the one of the instant are searched within this path length, mm, and one more to either side.
const PATH_WINDOW_MM: f64 = 0.2;
/// Largest number of moves searched to either side.
const MOST_NEAR: usize = 12;

/// Checks position, axis and times.
///
/// # Errors
/// [`VerifyError::Robot`] where interpolated joints are not a joint vector of the arm.
pub fn follow(plan: &StoredPlan, moves: &Moves, executed: &Executed) -> Result<Vec<Check>, VerifyError> {
    let off: Vec<Off> = (0..executed.len())
        .into_par_iter()
        .map(|row| {
            cancel::poll();
            nearest_on_polyline(moves, executed, row, plan.trajectory.time_s[row])
        })
        .collect();
    let instant = |row: usize| Place::Instant {
        time_s: plan.trajectory.time_s[row],
        waypoint: executed.next[row] as usize,
    };
    let worst = |name, limit: f64, unit, scale: f64, of: fn(&Off) -> f64| {
        let worst = (0..off.len()).max_by(|a, b| of(&off[*a]).total_cmp(&of(&off[*b])));
        let wrong = off.iter().filter(|o| of(o) > limit).count();
        let share = 100.0 * wrong as f64 / off.len().max(1) as f64;
        let value = worst.map_or(0.0, |row| of(&off[row]));
        let mut check = Check::at_most(name, value * scale, limit * scale, unit).at(worst.map(instant));
        if wrong > 0 {
            check = check.noting(format!("{share:.3} % of the time beyond"));
        }
        check
    };
    Ok(vec![
        worst("trajectory's place on the path", PLACE_MM, "mm", 1.0, |o| o.place_mm),
        worst("trajectory's axis on the path", AXIS_RAD, "mrad", 1e3, |o| o.axis_rad),
        clock(plan, moves)?,
    ])
}

/// Deviation of a row from the polyline.
#[derive(Debug, Clone, Copy)]
struct Off {
    place_mm: f64,
    axis_rad: f64,
}

impl Off {
    /// The larger of the two deviations relative to its limit; above 1, a limit is exceeded.
    fn combined(&self) -> f64 {
        (self.place_mm / PLACE_MM).max(self.axis_rad / AXIS_RAD)
    }
}

fn nearest_on_polyline(moves: &Moves, executed: &Executed, row: usize, time_s: f64) -> Off {
    let (p, axis) = (&executed.points[row], &executed.axes[row]);
    let here = executed.next[row] as usize;
    if moves.len() < 2 {
        let first = |v: &[Vector3<f64>]| v.first().copied().unwrap_or_else(Vector3::zeros);
        return Off {
            place_mm: (p - first(&moves.points)).norm(),
            axis_rad: angle_rad(&first(&moves.axes), axis),
        };
    }
    // the place on the path by the row's time
    let [a, b] = moves.ends(here);
    let span = moves.times_s[b] - moves.times_s[a];
    let share = if span > 0.0 { ((time_s - moves.times_s[a]) / span).clamp(0.0, 1.0) } else { 1.0 };
    let arc = moves.arc_mm[a] + share * (moves.arc_mm[b] - moves.arc_mm[a]);
    let is_near = |n: &usize| {
        let [a, b] = moves.ends(*n);
        moves.arc_mm[a] < arc + PATH_WINDOW_MM && moves.arc_mm[b] > arc - PATH_WINDOW_MM
    };
    let back = (1..here).rev().take(MOST_NEAR).take_while(is_near).count();
    let on = (here + 1..moves.len()).take(MOST_NEAR).take_while(is_near).count();
    let first = here.saturating_sub(back + 1).max(1);
    let last = (here + on + 1).min(moves.len() - 1);
    let least = |offs: &mut dyn Iterator<Item = Off>| {
        let least = offs.min_by(|a, b| a.combined().total_cmp(&b.combined()));
        least.unwrap_or(Off { place_mm: f64::INFINITY, axis_rad: f64::INFINITY })
    };
    let at_foot = least(&mut (first..=last).map(|n| OnMove::new(moves, n, p, axis).at_foot()));
    if at_foot.combined() <= 1.0 {
        return at_foot;
    }
    least(&mut (first..=last).map(|n| OnMove::new(moves, n, p, axis).least()))
}

/// Deviations of a pose from the poses of a move.
struct OnMove<'a> {
    ends: [&'a Vector3<f64>; 2],
    axes: [&'a Vector3<f64>; 2],
    p: &'a Vector3<f64>,
    axis: &'a Vector3<f64>,
}

impl<'a> OnMove<'a> {
    fn new(moves: &'a Moves, n: usize, p: &'a Vector3<f64>, axis: &'a Vector3<f64>) -> Self {
        let ends = moves.ends(n);
        Self { ends: ends.map(|n| &moves.points[n]), axes: ends.map(|n| &moves.axes[n]), p, axis }
    }

    /// The deviation at a share of the move.
    fn at(&self, share: f64) -> Off {
        Off {
            place_mm: (self.p - self.ends[0].lerp(self.ends[1], share)).norm(),
            axis_rad: angle_rad(&between(self.axes[0], self.axes[1], share), self.axis),
        }
    }

    /// The deviation at the nearest place.
    fn at_foot(&self) -> Off {
        let d = self.ends[1] - self.ends[0];
        let length2 = d.norm_squared();
        let share = if length2 > 0.0 { (self.p - self.ends[0]).dot(&d) / length2 } else { 0.5 };
        self.at(share.clamp(0.0, 1.0))
    }

    /// The deviation at the place where the larger of the two is least. Each falls, then rises along the move, and so does the
    /// larger of the two, so a ternary search finds it.
    fn least(&self) -> Off {
        let (mut lo, mut hi) = (0.0, 1.0);
        for _ in 0..40 {
            let (l, r) = (lo + (hi - lo) / 3.0, hi - (hi - lo) / 3.0);
            if self.at(l).combined() <= self.at(r).combined() { hi = r } else { lo = l }
        }
        let (best, at_foot) = (self.at(0.5 * (lo + hi)), self.at_foot());
        if best.combined() < at_foot.combined() { best } else { at_foot }
    }
}

/// Checks where the arm is at the times at which waypoints are passed.
///
/// Between two rows each joint follows the cubic with the rows' positions and velocities. A straight line would deviate by
/// \|q̈\| dt²/8, which is more than the limit where rows are some 0.1 s apart.
fn clock(plan: &StoredPlan, moves: &Moves) -> Result<Check, VerifyError> {
    let rows = &plan.trajectory;
    let grid_from_base: Rigid<Work, Base> =
        (plan.record.frames.base_from_ct * plan.record.frames.ct_from_grid()).inverse();
    let off = |(time_s, point): (&f64, &Vector3<f64>)| -> Result<f64, VerifyError> {
        let after = rows.time_s.partition_point(|t| t < time_s).min(rows.len() - 1);
        let before = after.saturating_sub(1);
        let span_s = rows.time_s[after] - rows.time_s[before];
        let share =
            if span_s > 0.0 { ((time_s - rows.time_s[before]) / span_s).clamp(0.0, 1.0) } else { 0.0 };
        let joint = |j: usize| {
            let place = |row: usize| rows.q_at(row)[j];
            let velocity = |row: usize| rows.qd_at(row)[j] * span_s;
            cubic([place(before), place(after)], [velocity(before), velocity(after)], share)
        };
        let q: Vec<f64> = (0..rows.q_at(before).len()).map(joint).collect();
        Ok(((grid_from_base * plan.arm.burr(&q)?).translation_mm - point).norm())
    };
    let off: Vec<f64> =
        moves.times_s.par_iter().zip(&moves.points).map(off).collect::<Result<_, VerifyError>>()?;
    let worst =
        off.iter().enumerate().fold((0.0, 0), |worst, (n, v)| if *v > worst.0 { (*v, n) } else { worst });
    Ok(Check::at_most("arm at each waypoint's time", worst.0, PLACE_MM, "mm").at(Place::Waypoint(worst.1)))
}

/// Hermite's cubic over a unit step, with the ends' values and slopes.
pub(crate) fn cubic([p0, p1]: [f64; 2], [v0, v1]: [f64; 2], s: f64) -> f64 {
    let d = p1 - p0;
    p0 + s * (v0 + s * ((3.0 * d - 2.0 * v0 - v1) + s * (v0 + v1 - 2.0 * d)))
}

/// By how much a speed from row to row may exceed the greatest speed that a plan states of the moves between, as a share and in mm/s: the
/// stated one is taken at several instants.
const DRIVEN_SHARE: f64 = 0.02;
const LEAST_DRIVEN_MM_S: f64 = 0.01;

/// Checks the burr's speed from row to row against the greatest speed stated and the caps of the moves between, and against the range for cuts.
///
/// The distance between rows is their chord; the rounding of the file is subtracted. In a period in which one move ends and
/// another begins, the larger cap holds.
pub fn speeds(plan: &StoredPlan, moves: &Moves, executed: &Executed) -> Vec<Check> {
    let rows = &plan.trajectory;
    let levers = plan.arm.lever_mm();
    let grain: f64 =
        plan.arm.joints().iter().zip(&levers).map(|(j, lever)| 2.0 * rounding(j.kind) * lever).sum();
    let ratio = |row: usize, most: &(dyn Fn(usize) -> f64 + Sync)| -> (f64, usize) {
        let (t0, t1) = (rows.time_s[row - 1], rows.time_s[row]);
        let way = (executed.points[row] - executed.points[row - 1]).norm();
        let speed = (way - grain).max(0.0) / (t1 - t0);
        let first = moves.times_s.partition_point(|t| *t <= t0).max(1);
        let last = moves.next_at(t1).max(first);
        let fastest = (first..=last).max_by(|a, b| most(*a).total_cmp(&most(*b))).unwrap_or(last);
        (speed / most(fastest), fastest)
    };
    let ratios_of = |most: &(dyn Fn(usize) -> f64 + Sync)| -> Vec<(f64, usize)> {
        (1..executed.len()).into_par_iter().map(|row| ratio(row, most)).collect()
    };
    let ratios = ratios_of(&|n| plan.waypoints.get(n).map_or(0.0, |w| w.speed_mm_s));
    let driven = ratios_of(&|n| plan.waypoints.get(n).map_or(0.0, |w| w.driven_mm_s + LEAST_DRIVEN_MM_S));
    let worst = (0..driven.len()).max_by(|a, b| driven[*a].0.total_cmp(&driven[*b].0));
    let mut checks = vec![
        Check::at_most(
            "driven_mm_s",
            worst.map_or(0.0, |row| driven[row].0),
            1.0 + DRIVEN_SHARE,
            "of what is stated",
        )
        .at(worst.map(|row| Place::Instant { time_s: rows.time_s[row + 1], waypoint: driven[row].1 })),
    ];
    let of_caps = [("speed of cuts", MoveClass::Cut), ("speed of links", MoveClass::Free)].into_iter().map(
        |(name, kind)| {
            let of_kind = |r: &(usize, &(f64, usize))| moves.kinds.get(r.1.1) == Some(&kind);
            let all = || ratios.iter().enumerate();
            let worst = all().filter(of_kind).max_by(|a, b| a.1.0.total_cmp(&b.1.0));
            let over = |most: f64| all().filter(|r| of_kind(r) && r.1.0 > most).count();
            let mut check = Check::at_most(name, worst.map_or(0.0, |w| w.1.0), 1.0, "of the cap")
                .at(worst.map(|w| Place::Instant { time_s: rows.time_s[w.0 + 1], waypoint: w.1.1 }));
            if over(1.0) > 0 {
                let share = |most: f64| 100.0 * over(most) as f64 / ratios.len().max(1) as f64;
                check = check.noting(format!(
                    "over for {:.2} % of the time, by more than 1 % for {:.2} %",
                    share(1.0),
                    share(1.01)
                ));
            }
            check
        },
    );
    checks.extend(of_caps);
    checks
}

#[cfg(test)]
mod tests {
    use super::cubic;

    #[test]
    fn a_cubic_comes_back_from_its_ends() {
        let at = |t: f64| 2.0 - 3.0 * t + 0.5 * t * t + 4.0 * t * t * t;
        let slope = |t: f64| -3.0 + t + 12.0 * t * t;
        for n in 0..=10 {
            let s = f64::from(n) / 10.0;
            assert!((cubic([at(0.0), at(1.0)], [slope(0.0), slope(1.0)], s) - at(s)).abs() < 1e-12);
        }
    }
}
