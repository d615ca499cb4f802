//! Checks the guarantees of a law at dense samples, and makes the paths on which they are checked.

use proptest::prelude::*;

use crate::timelaw::*;

pub const V: [f64; 4] = [15.0, 15.0, 15.0, 0.6];
pub const A: [f64; 4] = [150.0, 150.0, 150.0, 6.0];
pub const J: [f64; 4] = [3000.0, 3000.0, 3000.0, 120.0];
pub const TOLERANCE: CornerTolerance = CornerTolerance { burr_mm: 0.04, axis_rad: 1e-3 };

pub fn limits() -> PathLimits {
    PathLimits::new(&V, &A, &J, TOLERANCE).unwrap()
}

/// Waypoints of three linear joints, which carry the burr, and a tilt, which turns the axis about the burr; the axis is
/// taken to first order, (−t, 0, 1), so that tolerances are the same numbers for tilt and axis.
#[derive(Debug, Clone)]
pub struct Case {
    pub q: Vec<[f64; 4]>,
    pub caps_mm_s: Vec<f64>,
    pub stops: Vec<usize>,
}

impl Case {
    pub fn new(q: Vec<[f64; 4]>, cap_mm_s: f64) -> Self {
        Self { caps_mm_s: vec![cap_mm_s; q.len()], q, stops: vec![] }
    }

    pub fn burr_mm(&self) -> Vec<f64> {
        let moves = self.q.windows(2).map(|ends| linear_mm(&sub(&ends[1], &ends[0])));
        std::iter::once(0.0).chain(moves).collect()
    }

    pub fn prepared(&self, limits: &PathLimits) -> PreparedPath {
        let (q, burr_mm) = (self.q.concat(), self.burr_mm());
        let pose: Vec<[f64; 6]> = self.q.iter().map(|[x, y, z, t]| [*x, *y, *z, -t, 0.0, 1.0]).collect();
        let path = JointPath { q: &q, burr_mm: &burr_mm, pose: &pose, stops: &self.stops };
        PreparedPath::new(&path, limits).unwrap()
    }

    pub fn law(&self) -> TimeLaw {
        self.prepared(&limits()).law(&self.caps_mm_s).unwrap()
    }
}

pub fn sub(a: &[f64], b: &[f64]) -> [f64; 4] {
    std::array::from_fn(|j| a[j] - b[j])
}

/// |(x, y, z)|
pub fn linear_mm(q: &[f64]) -> f64 {
    (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt()
}

/// A deviation as a share of its tolerances, of burr and axis: 1 is the whole tolerance.
pub fn share_of_tolerance(q: &[f64; 4]) -> f64 {
    (linear_mm(q) / TOLERANCE.burr_mm).max(q[3].abs() / TOLERANCE.axis_rad)
}

/// Least [`share_of_tolerance`] of q − p over p on the segment from a to b: convex, so ternary search finds it.
pub fn to_segment(q: &[f64], a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let at = |share: f64| {
        let p: [f64; 4] = std::array::from_fn(|j| a[j] + share * (b[j] - a[j]));
        share_of_tolerance(&sub(q, &p))
    };
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..60 {
        let [m1, m2] = [low + (high - low) / 3.0, high - (high - low) / 3.0];
        if at(m1) < at(m2) { high = m2 } else { low = m1 }
    }
    at(low).min(at(0.0)).min(at(1.0))
}

/// Samples at which everything is checked: 10 kHz, or as dense as 20 000 allow, and around every passing.
pub fn instants(law: &TimeLaw) -> Vec<f64> {
    let step_s = (law.duration_s() / 20_000.0).max(1e-4);
    let grid = (0..).map(|k| f64::from(k) * step_s).take_while(|t| *t <= law.duration_s());
    let near = law.waypoint_times_s().iter().flat_map(|t| [t - 1e-9, *t, t + 1e-9]);
    let mut all: Vec<f64> = grid.chain(near).chain([law.duration_s()]).collect();
    all.sort_by(f64::total_cmp);
    all
}

/// Checks every guarantee of a law at every instant of [`instants`].
pub fn check(case: &Case) {
    let law = case.law();
    assert!(law.duration_s().is_finite() && law.duration_s() >= 0.0);
    check_passings(case, &law);
    check_limits(&law);
    check_caps(case, &law);
    check_deviation(case, &law);
}

pub fn check_passings(case: &Case, law: &TimeLaw) {
    let times = law.waypoint_times_s();
    assert_eq!(times.len(), case.q.len());
    assert!(times.windows(2).all(|pair| pair[0] <= pair[1]), "passings go back in time");
    for (q, &time_s) in case.q.iter().zip(times) {
        let off = share_of_tolerance(&sub(&law.sample(time_s).q, q));
        assert!(off <= 1.0 + 1e-6, "passes a waypoint at {off} of the tolerance");
    }
    for (end, q) in [(0.0, &case.q[0]), (law.duration_s(), &case.q[case.q.len() - 1])] {
        let state = law.sample(end);
        assert!(share_of_tolerance(&sub(&state.q, q)) <= 1e-7 && state.qd.iter().all(|qd| *qd == 0.0));
    }
    for &stop in &case.stops {
        let state = law.sample(times[stop]);
        assert!(share_of_tolerance(&sub(&state.q, &case.q[stop])) <= 1e-6, "misses stop {stop}");
        assert!(state.qd.iter().all(|qd| qd.abs() < 1e-5), "does not stop at {stop}: {:?}", state.qd);
    }
}

pub fn check_limits(law: &TimeLaw) {
    let ratios = law.limit_ratios(&limits());
    assert!(ratios.velocity.max(ratios.acceleration).max(ratios.jerk) <= 1.0 + 1e-6, "{ratios:?}");
    let mut before: Option<(f64, JointState)> = None;
    for time_s in instants(law) {
        let state = law.sample(time_s);
        for j in 0..4 {
            for (value, limit) in [(state.qd[j], V[j]), (state.qdd[j], A[j]), (state.qddd[j], J[j])] {
                assert!(value.abs() <= limit * (1.0 + 1e-6), "joint {j} at {time_s}: {value} over {limit}");
            }
        }
        if let Some((earlier_s, earlier)) = &before {
            let step_s = time_s - earlier_s;
            for j in 0..4 {
                // a jump of q, q̇ or q̈ would not scale with the step
                let moved = state.q[j] - earlier.q[j] - 0.5 * step_s * (state.qd[j] + earlier.qd[j]);
                assert!(moved.abs() <= 0.5 * A[j] * step_s * step_s + 1e-8, "q_{j} jumps at {time_s}");
                let faster = (state.qd[j] - earlier.qd[j]).abs();
                assert!(faster <= A[j] * step_s * (1.0 + 1e-6) + 1e-8, "q̇_{j} jumps by {faster} at {time_s}");
                let harder = (state.qdd[j] - earlier.qdd[j]).abs();
                assert!(harder <= J[j] * step_s * (1.0 + 1e-6) + 1e-5, "q̈_{j} jumps by {harder} at {time_s}");
            }
        }
        before = Some((time_s, state));
    }
}

/// Checks that the burr (x, y, z of this arm) is never faster than the cap of its move; in rotations in place, never faster
/// than the caps of the moves before and after them.
pub fn check_caps(case: &Case, law: &TimeLaw) {
    let times = law.waypoint_times_s();
    let burr_mm = case.burr_mm();
    let turns = |k: usize| burr_mm[k] == 0.0;
    for time_s in instants(law) {
        let speed = linear_mm(&law.sample(time_s).qd);
        let on = times.partition_point(|t| *t <= time_s).min(times.len() - 1);
        // when a waypoint is passed, and where waypoints were merged, a sample may belong to either neighbouring move
        let mut near: Vec<usize> = (1..times.len())
            .filter(|&k| k == on || (times[k - 1] - 1e-8..=times[k] + 1e-8).contains(&time_s))
            .collect();
        for k in near.clone() {
            if turns(k) {
                near.extend((1..k).rev().find(|&k| !turns(k)));
                near.extend((k..times.len()).find(|&k| !turns(k)));
            }
        }
        let caps = near.iter().filter(|k| !turns(**k)).map(|&k| case.caps_mm_s[k]);
        let cap = caps.fold(0.0, f64::max);
        assert!(speed <= cap * (1.0 + 1e-8) || times.len() == 1, "{speed} mm/s at {time_s} s, cap {cap}");
    }
}

pub fn check_deviation(case: &Case, law: &TimeLaw) {
    if case.q.len() < 2 {
        return;
    }
    let times = law.waypoint_times_s();
    for time_s in instants(law) {
        let q = law.sample(time_s).q;
        let on = times.partition_point(|t| *t <= time_s);
        let near = on.saturating_sub(4).max(1)..(on + 4).min(case.q.len());
        let off = near.map(|k| to_segment(&q, &case.q[k - 1], &case.q[k])).fold(f64::INFINITY, f64::min);
        assert!(off <= 1.0 + 1e-6, "{off} of the tolerance off the polyline at {time_s} s");
    }
}

/// A path with cuts, links, rotations in place, exact and near duplicates and reversals.
pub fn any_case() -> impl Strategy<Value = Case> {
    let step = prop_oneof![
        4 => (prop::array::uniform3(-0.3f64..0.3), -0.02f64..0.02).prop_map(|(p, t)| [p[0], p[1], p[2], t]),
        2 => (prop::array::uniform3(-20.0f64..20.0), -0.3f64..0.3).prop_map(|(p, t)| [p[0], p[1], p[2], t]),
        1 => (-0.3f64..0.3).prop_map(|t| [0.0, 0.0, 0.0, t]),
        1 => Just([0.0; 4]),
        1 => prop::array::uniform4(-1e-9f64..1e-9),
        1 => prop::array::uniform4(-1e-4f64..1e-4),
        1 => Just([2.0, 0.0, 0.0, 0.0]),
        1 => Just([-2.0, 0.0, 0.0, 0.0]),
    ];
    (
        prop::collection::vec((step, 0.3f64..12.0), 0..14),
        prop::array::uniform4(-1.0f64..1.0),
        prop::option::of(0..20usize),
    )
        .prop_map(|(steps, start, stop)| {
            let mut q = vec![start];
            let mut caps_mm_s = vec![1.0];
            for (step, cap) in steps {
                let from = q[q.len() - 1];
                q.push(std::array::from_fn(|j| from[j] + step[j]));
                caps_mm_s.push(cap);
            }
            let stops = stop.filter(|stop| *stop < q.len()).into_iter().collect();
            Case { q, caps_mm_s, stops }
        })
}
