//! The exported rows of a motion: every n-th row of a sampled trajectory, or as few as keep the burr near it, and always its first and last.
//! Also computes how far the burr leaves its path because of the rows that are left out, or because an arm follows late.

use bonemill_geometry::{Base, Point};
use rayon::prelude::*;

use bonemill_arm::RobotError;
use bonemill_arm::arm::{Arm, Joint, JointKind};

use super::csv::decimals;

/// How a controller interpolates between rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    /// Every joint at a constant speed.
    Straight,
    /// A cubic with the positions and velocities of both rows.
    Cubic,
}

/// Some rows of a sampled trajectory, with the joints.
#[derive(Debug, Clone)]
pub struct ExportRows<'a> {
    joints: &'a [Joint],
    time_s: &'a [f64],
    q: &'a [f64],
    qd: &'a [f64],
    /// Places of the exported rows among the sampled ones, rising.
    kept: Vec<usize>,
}

impl<'a> ExportRows<'a> {
    /// Every `stride`-th row of a trajectory: times, s, shape (rows); positions and velocities, mm or rad, shape
    /// (rows × joints). 0 counts as 1.
    ///
    /// # Errors
    /// [`RobotError::EmptyPath`] without a row, [`RobotError::Length`] where lists do not match.
    pub fn new(
        joints: &'a [Joint],
        time_s: &'a [f64],
        q: &'a [f64],
        qd: &'a [f64],
        stride: usize,
    ) -> Result<Self, RobotError> {
        let expected = time_s.len() * joints.len();
        if time_s.is_empty() {
            return Err(RobotError::EmptyPath);
        }
        for (what, got) in [("joint position", q.len()), ("joint velocity", qd.len())] {
            if got != expected {
                return Err(RobotError::Length { what, got, expected });
            }
        }
        let last = time_s.len() - 1;
        let kept = (0..last).step_by(stride.max(1)).chain([last]).collect();
        Ok(Self { joints, time_s, q, qd, kept })
    }

    /// As few of the rows as leave the burr within `most_mm` of its sampled path, however a controller interpolates, none longer after the
    /// one before than `most_s`, which is above 0.
    ///
    /// # Errors
    /// [`RobotError::Length`] for an arm with another number of joints.
    pub fn thinned(
        mut self,
        arm: &Arm,
        between: &[Between],
        most_mm: f64,
        most_s: f64,
    ) -> Result<Self, RobotError> {
        let (places, last) = (self.places(arm)?, self.time_s.len() - 1);
        let mut kept = vec![0];
        let (mut from, mut span) = (0, 1);
        while from < last {
            // as far as twice the span before, then half of that until the burr stays near
            span = (2 * span).min(last - from);
            while span > 1 {
                let is_short = self.time_s[from + span] - self.time_s[from] <= most_s * (1.0 + 1e-9);
                let off = |between: &Between| self.span_mm(arm, &places, (from, from + span), *between);
                if is_short
                    && between
                        .iter()
                        .map(off)
                        .try_fold(true, |near, off| Ok::<_, RobotError>(near && off? <= most_mm))?
                {
                    break;
                }
                span = span.div_ceil(2);
            }
            from += span;
            kept.push(from);
        }
        self.kept = kept;
        Ok(self)
    }

    /// The joints.
    pub fn joints(&self) -> &'a [Joint] {
        self.joints
    }

    /// Number of rows that are exported.
    pub fn count(&self) -> usize {
        self.kept.len()
    }

    /// The last exported row that is no later than a sampled one.
    pub fn at_or_before(&self, sampled: usize) -> usize {
        self.kept.partition_point(|kept| *kept <= sampled).saturating_sub(1)
    }

    /// The last exported row before `n` from which the burr's way to it is at least so long, mm; the first where none is.
    ///
    /// # Errors
    /// [`RobotError::Length`] for an arm with another number of joints.
    pub fn back_from(&self, n: usize, way_mm: f64, arm: &Arm) -> Result<usize, RobotError> {
        let (mut at, mut gone_mm) = (n, 0.0);
        while at > 0 && gone_mm < way_mm {
            let (here, before) = (burr(arm, self.row(at).1)?, burr(arm, self.row(at - 1).1)?);
            gone_mm += (here - before).norm();
            at -= 1;
        }
        Ok(at)
    }

    /// Clock of every exported row, s.
    pub fn times_s(&self) -> impl Iterator<Item = f64> {
        (0..self.count()).map(|n| self.row(n).0)
    }

    /// Time, positions and velocities of an exported row.
    pub(super) fn row(&self, n: usize) -> (f64, &'a [f64], &'a [f64]) {
        let at = self.kept[n];
        let dof = self.joints.len();
        (self.time_s[at], &self.q[at * dof..(at + 1) * dof], &self.qd[at * dof..(at + 1) * dof])
    }

    /// Positions at an instant, by the cubic with the positions and velocities of the rows around it; before the first and
    /// after the last row, that row's positions.
    pub(super) fn at(&self, time_s: f64) -> Vec<f64> {
        let dof = self.joints.len();
        let after = self.time_s.partition_point(|t| *t <= time_s).clamp(1, self.time_s.len().max(2) - 1);
        let before = after - 1;
        let Some(to_s) = self.time_s.get(after) else { return self.q.to_vec() };
        let span_s = to_s - self.time_s[before];
        let u = ((time_s - self.time_s[before]) / span_s).clamp(0.0, 1.0);
        let of = |values: &[f64], j: usize| [before, after].map(|row| values[row * dof + j]);
        (0..dof).map(|j| cubic(of(self.q, j), of(self.qd, j).map(|qd| qd * span_s), u)).collect()
    }

    /// The largest distance of the burr's centre from its sampled path when the rows between are left out, mm, and the exported
    /// row before that place. Delay along the path does not count.
    ///
    /// # Errors
    /// [`RobotError::Length`] for an arm with another number of joints.
    pub fn deviation_mm(&self, arm: &Arm, between: Between) -> Result<(f64, usize), RobotError> {
        let places = self.places(arm)?;
        let step = |n: usize| -> Result<(f64, usize), RobotError> {
            Ok((self.span_mm(arm, &places, (self.kept[n], self.kept[n + 1]), between)?, n))
        };
        // of equal values the first, so that the result does not depend on threads
        let worse =
            |a: (f64, usize), b: (f64, usize)| if b.0 > a.0 || (b.0 == a.0 && b.1 < a.1) { b } else { a };
        (0..self.count() - 1).into_par_iter().map(step).try_reduce(|| (0.0, 0), |a, b| Ok(worse(a, b)))
    }

    /// Where the burr is at every sampled row.
    fn places(&self, arm: &Arm) -> Result<Vec<Point<Base>>, RobotError> {
        self.q.par_chunks_exact(self.joints.len()).map(|q| burr(arm, q)).collect()
    }

    /// How far the burr leaves its sampled places between two sampled rows when those between are left out, mm.
    fn span_mm(
        &self,
        arm: &Arm,
        places: &[Point<Base>],
        (first, last): (usize, usize),
        between: Between,
    ) -> Result<f64, RobotError> {
        let dof = self.joints.len();
        let of = |values: &'a [f64], row: usize| &values[row * dof..(row + 1) * dof];
        let (q0, q1, qd0, qd1) = (of(self.q, first), of(self.q, last), of(self.qd, first), of(self.qd, last));
        let (t0, span_s) = (self.time_s[first], self.time_s[last] - self.time_s[first]);
        let mut q = vec![0.0; dof];
        let mut worst_mm = 0f64;
        for (row, time_s) in self.time_s.iter().enumerate().take(last).skip(first + 1) {
            let u = (time_s - t0) / span_s;
            for (j, q) in q.iter_mut().enumerate() {
                *q = match between {
                    Between::Straight => q0[j] + u * (q1[j] - q0[j]),
                    Between::Cubic => cubic([q0[j], q1[j]], [qd0[j] * span_s, qd1[j] * span_s], u),
                };
            }
            worst_mm = worst_mm.max(off_path_mm(places, row, &burr(arm, &q)?));
        }
        Ok(worst_mm)
    }

    /// How far the burr leaves its path when an arm follows so late, mm, for each lag: by two equal first-order lags, each half of it.
    ///
    /// # Errors
    /// [`RobotError::Length`] for an arm with another number of joints.
    pub fn late_mm<const N: usize>(&self, arm: &Arm, lags_s: [f64; N]) -> Result<[f64; N], RobotError> {
        let places = self.places(arm)?;
        let mut found = [0.0; N];
        for (found, lag_s) in found.iter_mut().zip(lags_s) {
            *found = self.late_by_mm(arm, &places, lag_s)?;
        }
        Ok(found)
    }

    fn late_by_mm(&self, arm: &Arm, places: &[Point<Base>], lag_s: f64) -> Result<f64, RobotError> {
        let dof = self.joints.len();
        let mut followed = [self.q[..dof].to_vec(), self.q[..dof].to_vec()];
        let mut worst_mm = 0f64;
        let mut first = 0;
        for (n, q) in self.q.chunks_exact(dof).enumerate().skip(1) {
            let share = 1.0 - (-(self.time_s[n] - self.time_s[n - 1]) / (0.5 * lag_s)).exp();
            for (j, q) in q.iter().enumerate() {
                followed[0][j] += share * (q - followed[0][j]);
                followed[1][j] += share * (followed[0][j] - followed[1][j]);
            }
            while self.time_s[first] < self.time_s[n] - LATE_LAGS * lag_s {
                first += 1;
            }
            if n.is_multiple_of(LATE_EVERY) {
                let there = burr(arm, &followed[1])?;
                let off = places[first..=n].windows(2).map(|ends| from_segment_mm(ends, &there));
                worst_mm = worst_mm.max(off.fold(f64::INFINITY, f64::min));
            }
        }
        Ok(worst_mm)
    }

    /// That no step exceeds a joint's speed limit.
    ///
    /// # Errors
    /// [`RobotError::Value`] with the first that does.
    pub fn check_speeds(&self) -> Result<(), RobotError> {
        for n in 1..self.count() {
            let ((t0, from, _), (t1, to, _)) = (self.row(n - 1), self.row(n));
            for (joint, (a, b)) in self.joints.iter().zip(from.iter().zip(to)) {
                let speed = (b - a).abs() / (t1 - t0);
                // a file rounds either end
                let rounding = 10f64.powi(-(decimals(joint.kind) as i32)) / (t1 - t0);
                if !speed.is_finite() || speed > joint.velocity_limit * (1.0 + 1e-6) + rounding {
                    let unit = if joint.kind == JointKind::Prismatic { "mm/s" } else { "rad/s" };
                    let (what, expected) = ("joint speed in step", "at most the joint's limit");
                    return Err(RobotError::Value { what, index: n, value: speed, unit, expected });
                }
            }
        }
        Ok(())
    }

    /// Joint values in SI: m for prismatic joints, rad for revolute ones.
    pub(super) fn si(&self, values: &[f64]) -> Vec<f64> {
        let per = |joint: &Joint| if joint.kind == JointKind::Prismatic { 1e-3 } else { 1.0 };
        self.joints.iter().zip(values).map(|(joint, value)| value * per(joint)).collect()
    }
}

/// How many lags back an arm that follows late is looked for on its path, and at every how manieth row.
const LATE_LAGS: f64 = 6.0;
const LATE_EVERY: usize = 5;
/// Most rows by which a place may be early or late along the path; where the burr rests, all are alike.
const MOST_FOLLOWED: usize = 1000;

/// Distance of a point from the segment between two places, mm.
fn from_segment_mm(ends: &[Point<Base>], there: &Point<Base>) -> f64 {
    let (way, off) = (ends[1] - ends[0], *there - ends[0]);
    let share = if way.norm_squared() > 0.0 { off.dot(&way) / way.norm_squared() } else { 0.0 };
    (off - way * share.clamp(0.0, 1.0)).norm()
}

fn burr(arm: &Arm, q: &[f64]) -> Result<Point<Base>, RobotError> {
    Ok(Point::from_coords(arm.burr(q)?.translation_mm))
}

/// Distance of a point from the way through some places near one of them, mm: from there it is followed as long as it does not go farther away.
fn off_path_mm(places: &[Point<Base>], near: usize, there: &Point<Base>) -> f64 {
    let off_mm = |n: usize| places.get(n..n + 2).map(|ends| from_segment_mm(ends, there));
    let follow = |from: usize, next: fn(usize) -> Option<usize>| {
        let (mut at, mut least_mm) = (from, off_mm(from).unwrap_or(f64::INFINITY));
        for _ in 0..MOST_FOLLOWED {
            let nearer = next(at).and_then(|n| Some((n, off_mm(n)?))).filter(|of| of.1 <= least_mm);
            let Some(found) = nearer else { break };
            (at, least_mm) = found;
        }
        least_mm
    };
    follow(near, |n| n.checked_add(1)).min(follow(near.saturating_sub(1), |n| n.checked_sub(1)))
}

/// The cubic between two values with the given slopes per whole step.
fn cubic([from, to]: [f64; 2], [m0, m1]: [f64; 2], u: f64) -> f64 {
    let v = 1.0 - u;
    from * v * v * (1.0 + 2.0 * u) + to * u * u * (3.0 - 2.0 * u) + m0 * u * v * v - m1 * u * u * v
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A circle of 5 mm radius at 1 rad/s by the bone-attached arm's linear joints, 500 rows a second.
    fn circle() -> (Vec<f64>, Vec<f64>, Vec<f64>) {
        let time_s: Vec<f64> = (0..=2000).map(|k| f64::from(k) * 0.002).collect();
        let q = time_s.iter().flat_map(|t| [5.0 * t.cos(), 5.0 * t.sin(), 0.0, 0.0]).collect();
        let qd = time_s.iter().flat_map(|t| [-5.0 * t.sin(), 5.0 * t.cos(), 0.0, 0.0]).collect();
        (time_s, q, qd)
    }

    #[test]
    fn a_chord_is_as_far_from_its_arc_as_geometry_says() {
        let arm = Arm::bone_attached().unwrap();
        let (time_s, q, qd) = circle();
        let off = |stride, between| {
            let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, stride).unwrap();
            rows.deviation_mm(&arm, between).unwrap().0
        };
        for stride in [10, 50, 100, 200, 400] {
            let span = 0.002 * stride as f64;
            let sagitta = 5.0 * (1.0 - (0.5 * span).cos());
            let straight = off(stride, Between::Straight);
            assert!((straight / sagitta - 1.0).abs() < 1e-3, "{straight} for {sagitta}");
            // Hermite: q⁗ span⁴/384; the sampled way itself is 5 · 0.002²/8 off the circle
            let most = 5.0 * span.powi(4) / 384.0;
            let cubic = off(stride, Between::Cubic);
            assert!(cubic < 1.1 * most + 2.5e-6 && cubic > 0.5 * most, "{cubic} for {most}");
        }
        assert_eq!(off(1, Between::Straight), 0.0);
    }

    #[test]
    fn a_cubic_that_goes_past_the_end_of_a_way_leaves_it() {
        // along x to a stop within 0.02 s, then up; rows only before and behind the stop
        let arm = Arm::bone_attached().unwrap();
        let time_s: Vec<f64> = (0..=100).map(|k| f64::from(k) * 0.002).collect();
        let at = |t: f64| [5.0 * t.min(0.1), 0.0, 5.0 * (t - 0.12).max(0.0), 0.0];
        let speeds = |t: f64| [if t < 0.1 { 5.0 } else { 0.0 }, 0.0, if t > 0.12 { 5.0 } else { 0.0 }, 0.0];
        let q: Vec<f64> = time_s.iter().flat_map(|t| at(*t)).collect();
        let qd: Vec<f64> = time_s.iter().flat_map(|t| speeds(*t)).collect();
        let mut rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, 1).unwrap();
        rows.kept = vec![0, 49, 55, 100];
        let off_mm = rows.deviation_mm(&arm, Between::Cubic).unwrap().0;
        // past x = 0.5 mm by the greatest value of the cubic from 0.49 at 5 mm/s to 0.5 at rest within 0.012 s
        let past = |u: f64| cubic([0.49, 0.5], [0.06, 0.0], u) - 0.5;
        let most = (0..=1000).map(|n| past(f64::from(n) / 1000.0)).fold(0.0, f64::max);
        assert!(most > 2e-3 && (off_mm / most - 1.0).abs() < 0.2, "{off_mm} for {most}");
    }

    #[test]
    fn as_few_rows_are_kept_as_leave_the_burr_where_it_was() {
        let arm = Arm::bone_attached().unwrap();
        let (time_s, q, qd) = circle();
        let all = ExportRows::new(arm.joints(), &time_s, &q, &qd, 1).unwrap();
        let thinned = all.clone().thinned(&arm, &[Between::Straight], 0.005, 1.0).unwrap();
        let off_mm = thinned.deviation_mm(&arm, Between::Straight).unwrap().0;
        // a chord of 0.09 rad leaves the circle by 0.005 mm; spans are doubled and halved
        assert!(off_mm <= 0.005 && (45..=180).contains(&thinned.count()), "{off_mm} mm, {}", thinned.count());
        let short = all.clone().thinned(&arm, &[Between::Straight], 0.005, 0.02).unwrap();
        assert!(short.count() >= 200 && short.times_s().last() == all.times_s().last());
        assert_eq!((short.at_or_before(0), short.at_or_before(2000)), (0, short.count() - 1));
        // 2 mm back are 0.4 rad
        let back = short.back_from(short.count() - 1, 2.0, &arm).unwrap();
        let way_s = time_s[2000] - short.times_s().nth(back).unwrap();
        assert!((0.4..0.43).contains(&way_s), "{way_s}");
    }

    #[test]
    fn an_arm_that_is_late_cuts_the_corner_of_a_circle() {
        let arm = Arm::bone_attached().unwrap();
        let (time_s, q, qd) = circle();
        let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, 1).unwrap();
        // two lags of τ at ω: the radius is divided by 1 + ω²τ²
        let lags_s = [0.1, 0.2];
        for (lag_s, late_mm) in lags_s.into_iter().zip(rows.late_mm(&arm, lags_s).unwrap()) {
            let inside_mm = 5.0 * (1.0 - 1.0 / (1.0 + (0.5f64 * lag_s).powi(2)));
            assert!((late_mm / inside_mm - 1.0).abs() < 0.05, "{late_mm} for {inside_mm}");
        }
    }

    #[test]
    fn a_step_that_is_too_fast_for_a_joint_is_refused() {
        let arm = Arm::bone_attached().unwrap();
        let (time_s, mut q, qd) = circle();
        let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, 1).unwrap();
        assert!(rows.check_speeds().is_ok());
        q[4 * 1000 + 3] += 0.2;
        let rows = ExportRows::new(arm.joints(), &time_s, &q, &qd, 1).unwrap();
        let refused = rows.check_speeds().unwrap_err().to_string();
        assert!(refused.contains("joint speed in step") && refused.contains("1000"), "{refused}");
    }
}
