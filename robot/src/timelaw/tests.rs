//! Properties of the time law on ordinary, hostile and random paths.

use proptest::prelude::*;

use super::*;

const V: [f64; 4] = [15.0, 15.0, 15.0, 0.6];
const A: [f64; 4] = [150.0, 150.0, 150.0, 6.0];
const LEVER_MM: [f64; 4] = [1.0, 1.0, 1.0, 50.0];
const TOLERANCE_MM: f64 = 0.04;

fn limits() -> PathLimits {
    PathLimits::new(&V, &A, &LEVER_MM, TOLERANCE_MM).unwrap()
}

/// Waypoints of the bone-attached arm's joints with the move lengths of x, y, z.
#[derive(Debug, Clone)]
struct Case {
    q: Vec<[f64; 4]>,
    caps_mm_s: Vec<f64>,
    stops: Vec<usize>,
}

impl Case {
    fn new(q: Vec<[f64; 4]>, cap_mm_s: f64) -> Self {
        Self { caps_mm_s: vec![cap_mm_s; q.len()], q, stops: vec![] }
    }

    fn burr_mm(&self) -> Vec<f64> {
        let moves = self.q.windows(2).map(|ends| linear_mm(&sub(&ends[1], &ends[0])));
        std::iter::once(0.0).chain(moves).collect()
    }

    fn prepared(&self, limits: &PathLimits) -> PreparedPath {
        let (q, burr_mm) = (self.q.concat(), self.burr_mm());
        PreparedPath::new(&JointPath { q: &q, burr_mm: &burr_mm, stops: &self.stops }, limits).unwrap()
    }

    fn law(&self) -> TimeLaw {
        self.prepared(&limits()).law(&self.caps_mm_s).unwrap()
    }
}

fn sub(a: &[f64], b: &[f64]) -> [f64; 4] {
    std::array::from_fn(|j| a[j] - b[j])
}

/// |(x, y, z)|
fn linear_mm(q: &[f64]) -> f64 {
    (q[0] * q[0] + q[1] * q[1] + q[2] * q[2]).sqrt()
}

/// Σ lever |q|
fn weighted_mm(q: &[f64; 4]) -> f64 {
    q.iter().zip(LEVER_MM).map(|(q, lever)| q.abs() * lever).sum()
}

/// Least Σ lever |q − p| over p on the segment from a to b: convex and piecewise linear, so least at a kink or an end.
fn to_segment_mm(q: &[f64], a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let kinks = (0..4).map(|j| ((q[j] - a[j]) / (b[j] - a[j])).clamp(0.0, 1.0)).filter(|at| at.is_finite());
    let at = |share: f64| {
        let p: [f64; 4] = std::array::from_fn(|j| a[j] + share * (b[j] - a[j]));
        weighted_mm(&sub(q, &p))
    };
    kinks.chain([0.0, 1.0]).map(at).fold(f64::INFINITY, f64::min)
}

/// Samples at which everything is checked: 10 kHz, or as dense as 20 000 allow, and around every passing.
fn instants(law: &TimeLaw) -> Vec<f64> {
    let step_s = (law.duration_s() / 20_000.0).max(1e-4);
    let grid = (0..).map(|k| f64::from(k) * step_s).take_while(|t| *t <= law.duration_s());
    let near = law.waypoint_times_s().iter().flat_map(|t| [t - 1e-9, *t, t + 1e-9]);
    let mut all: Vec<f64> = grid.chain(near).chain([law.duration_s()]).collect();
    all.sort_by(f64::total_cmp);
    all
}

/// Everything that a law promises, at every instant of [`instants`].
fn check(case: &Case) {
    let law = case.law();
    assert!(law.duration_s().is_finite() && law.duration_s() >= 0.0);
    check_passings(case, &law);
    check_limits(&law);
    check_caps(case, &law);
    check_deviation(case, &law);
}

fn check_passings(case: &Case, law: &TimeLaw) {
    let times = law.waypoint_times_s();
    assert_eq!(times.len(), case.q.len());
    assert!(times.windows(2).all(|pair| pair[0] <= pair[1]), "passings go back in time");
    for (q, &time_s) in case.q.iter().zip(times) {
        let off = weighted_mm(&sub(&law.sample(time_s).q, q));
        assert!(off <= TOLERANCE_MM * (1.0 + 1e-9), "passes {off} mm off a waypoint");
    }
    for (end, q) in [(0.0, &case.q[0]), (law.duration_s(), &case.q[case.q.len() - 1])] {
        let state = law.sample(end);
        assert!(weighted_mm(&sub(&state.q, q)) <= 1e-9 && state.qd.iter().all(|qd| *qd == 0.0));
    }
    for &stop in &case.stops {
        let state = law.sample(times[stop]);
        assert!(weighted_mm(&sub(&state.q, &case.q[stop])) <= 1e-9, "misses stop {stop}");
        assert!(state.qd.iter().all(|qd| qd.abs() < 1e-5), "does not stop at {stop}: {:?}", state.qd);
    }
}

fn check_limits(law: &TimeLaw) {
    let mut before: Option<(f64, JointState)> = None;
    for time_s in instants(law) {
        let state = law.sample(time_s);
        for j in 0..4 {
            assert!(state.qd[j].abs() <= V[j] * (1.0 + 1e-9), "joint {j} at {time_s}: {}", state.qd[j]);
            assert!(state.qdd[j].abs() <= A[j] * (1.0 + 1e-9), "joint {j} at {time_s}: {}", state.qdd[j]);
        }
        if let Some((earlier_s, earlier)) = &before {
            let step_s = time_s - earlier_s;
            for j in 0..4 {
                // a jump of q or q̇ would not scale with the step
                let moved = state.q[j] - earlier.q[j] - 0.5 * step_s * (state.qd[j] + earlier.qd[j]);
                assert!(moved.abs() <= 0.5 * A[j] * step_s * step_s + 1e-9, "q_{j} jumps at {time_s}");
                let faster = (state.qd[j] - earlier.qd[j]).abs();
                assert!(faster <= A[j] * step_s * (1.0 + 1e-9) + 1e-8, "q̇_{j} jumps by {faster} at {time_s}");
            }
        }
        before = Some((time_s, state));
    }
}

/// The burr (x, y, z of this arm) is never faster than the cap of the move that it is on.
fn check_caps(case: &Case, law: &TimeLaw) {
    let times = law.waypoint_times_s();
    for time_s in instants(law) {
        let speed = linear_mm(&law.sample(time_s).qd);
        let on = times.partition_point(|t| *t <= time_s).min(times.len() - 1);
        // at a passing, and where waypoints were merged, a sample belongs to either of its neighbours
        let near = (0..times.len())
            .filter(|&k| k > 0 && (k == on || (times[k - 1] - 1e-8..=times[k] + 1e-8).contains(&time_s)));
        let cap = near.map(|k| case.caps_mm_s[k]).fold(0.0, f64::max);
        assert!(speed <= cap * (1.0 + 1e-9) || times.len() == 1, "{speed} mm/s at {time_s} s, cap {cap}");
    }
}

fn check_deviation(case: &Case, law: &TimeLaw) {
    if case.q.len() < 2 {
        return;
    }
    let times = law.waypoint_times_s();
    for time_s in instants(law) {
        let q = law.sample(time_s).q;
        let on = times.partition_point(|t| *t <= time_s);
        let near = on.saturating_sub(4).max(1)..(on + 4).min(case.q.len());
        let off = near.map(|k| to_segment_mm(&q, &case.q[k - 1], &case.q[k])).fold(f64::INFINITY, f64::min);
        assert!(off <= TOLERANCE_MM * (1.0 + 1e-9), "{off} mm off the polyline at {time_s} s");
    }
}

/// A path with cuts, links, rotations in place, exact and near duplicates and reversals.
fn any_case() -> impl Strategy<Value = Case> {
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

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn any_path_keeps_every_promise(case in any_case()) {
        check(&case);
    }

    #[test]
    fn a_higher_cap_never_takes_longer(case in any_case(), factors in prop::collection::vec(1.0f64..3.0, 20)) {
        let prepared = case.prepared(&limits());
        let faster: Vec<f64> = case.caps_mm_s.iter().zip(&factors).map(|(cap, f)| cap * f).collect();
        let (slow, fast) = (prepared.duration_s(&case.caps_mm_s).unwrap(), prepared.duration_s(&faster).unwrap());
        prop_assert!(fast <= slow * (1.0 + 1e-12), "{fast} > {slow}");
    }

    #[test]
    fn half_the_caps_take_at_most_twice_as_long(case in any_case()) {
        // half of any allowed motion is an allowed motion under half the caps
        let prepared = case.prepared(&limits());
        let half: Vec<f64> = case.caps_mm_s.iter().map(|cap| 0.5 * cap).collect();
        let (whole, half) = (prepared.duration_s(&case.caps_mm_s).unwrap(), prepared.duration_s(&half).unwrap());
        prop_assert!(half <= 2.0 * whole * (1.0 + 1e-12) && half >= whole * (1.0 - 1e-12), "{whole} s, half caps {half} s");
    }

    #[test]
    fn duration_and_law_agree_and_repeat(case in any_case()) {
        let prepared = case.prepared(&limits());
        let law = prepared.law(&case.caps_mm_s).unwrap();
        prop_assert_eq!(law.duration_s(), prepared.duration_s(&case.caps_mm_s).unwrap());
        let again = case.law();
        prop_assert_eq!(law.waypoint_times_s(), again.waypoint_times_s());
        let at = 0.37 * law.duration_s();
        prop_assert_eq!(law.sample(at), again.sample(at));
    }

    #[test]
    fn splitting_a_straight_move_changes_nothing(
        before in prop::collection::vec(prop::array::uniform4(-0.3f64..0.3), 0..5),
        // long, since a corner takes at most half of a move: a short one is not the same in two parts
        long in (12.0f64..30.0, -20.0f64..20.0, -0.3f64..0.3),
        after in prop::collection::vec(prop::array::uniform4(-0.3f64..0.3), 0..5),
        cap in 0.5f64..12.0,
        share in 0.2f64..0.8,
    ) {
        let mut q = vec![[1.0, -2.0, 3.0, 0.1]];
        let long = [long.0, long.1, 0.0, long.2];
        let steps = before.iter().chain([&long]).chain(&after);
        for step in steps {
            let from = q[q.len() - 1];
            q.push(std::array::from_fn(|j| from[j] + step[j]));
        }
        let (from, to) = (q[before.len()], q[before.len() + 1]);
        let mut halves = q.clone();
        halves.insert(before.len() + 1, std::array::from_fn(|j| from[j] + share * (to[j] - from[j])));
        let (whole, halves) = (Case::new(q, cap).law(), Case::new(halves, cap).law());
        prop_assert!((whole.duration_s() - halves.duration_s()).abs() <= 1e-12 * whole.duration_s());
    }
}

#[test]
fn a_straight_move_is_the_trapezoid() {
    // v = 4 mm/s after v/a, cruise, and back: T = d/v + v/a
    let law = Case::new(vec![[0.0; 4], [10.0, 0.0, 0.0, 0.0]], 4.0).law();
    assert!((law.duration_s() - (10.0 / 4.0 + 4.0 / 150.0)).abs() < 1e-12);
    // too short for its cap: T = 2 √(d/a)
    let law = Case::new(vec![[0.0; 4], [0.01, 0.0, 0.0, 0.0]], 14.0).law();
    assert!((law.duration_s() - 2.0 * (0.01f64 / 150.0).sqrt()).abs() < 1e-12);
}

#[test]
fn a_rotation_in_place_is_bound_by_its_joint_alone() {
    let law = Case::new(vec![[1.0, 2.0, 3.0, -0.5], [1.0, 2.0, 3.0, 0.7]], 1e-3).law();
    assert!((law.duration_s() - (1.2 / 0.6 + 0.6 / 6.0)).abs() < 1e-12);
}

#[test]
fn hostile_paths_have_a_law() {
    let x = |x: f64| [x, 0.0, 0.0, 0.0];
    let paths = [
        vec![x(0.0)],
        vec![x(0.0), x(0.0)],
        vec![x(1.0), x(1.0 + 1e-15)],
        vec![x(0.0), x(1e-9)],
        vec![x(0.0), x(5e-324)],
        vec![x(0.0), x(1e-9), x(2.0), x(2.0 + 1e-9), x(2.0 - 1e-9), x(2.0), x(4.0)],
        vec![x(0.0), x(2.0), x(0.0), x(2.0), x(0.0)],
        vec![x(0.0), x(0.1), x(0.0), x(0.1), x(0.0)],
        vec![x(0.0), [0.0, 0.0, 0.0, 0.5], x(0.0), [0.0, 0.0, 0.0, 0.5]],
        vec![[-80.0, -39.0, 70.0, -1.2], [80.0, 39.0, -70.0, 1.2], [-80.0, 39.0, -70.0, 1.2]],
        (0..200)
            .map(|k| [0.3 * (f64::from(k) * 0.1).cos(), 0.3 * (f64::from(k) * 0.1).sin(), 0.0, 0.0])
            .collect(),
        // tilt that alternates at every step, as a raw optimum does
        (0..60).map(|k| [0.25 * f64::from(k), 0.0, 0.0, if k % 2 == 0 { 0.02 } else { -0.02 }]).collect(),
    ];
    for q in paths {
        check(&Case::new(q, 4.0));
    }
}

#[test]
fn near_duplicates_cost_nothing() {
    let line: Vec<[f64; 4]> = (0..=40).map(|k| [0.25 * f64::from(k), 0.0, 0.0, 0.0]).collect();
    let noisy = line.iter().flat_map(|q| [*q, [q[0] - 1e-9, 1e-9, -1e-9, 1e-11], [q[0], 0.0, 2e-9, 0.0]]);
    let (clean, noisy) = (Case::new(line.clone(), 2.0).law(), Case::new(noisy.collect(), 2.0).law());
    assert!((clean.duration_s() - noisy.duration_s()).abs() < 1e-6, "{}", noisy.duration_s());
}

#[test]
fn the_cap_of_a_merged_move_binds_nothing() {
    let mut case = Case::new(vec![[0.0; 4], [1e-9, 0.0, 0.0, 0.0], [10.0, 0.0, 0.0, 0.0]], 10.0);
    case.caps_mm_s[1] = 0.1;
    assert!(case.law().duration_s() < 1.1);
}

#[test]
fn a_right_angle_is_cut_by_the_tolerance() {
    let case = Case::new(vec![[0.0; 4], [5.0, 0.0, 0.0, 0.0], [5.0, 5.0, 0.0, 0.0]], 14.0);
    let law = case.law();
    let at_corner = law.sample(law.waypoint_times_s()[1]).q;
    // l = 4 tol / (1 + 1), the vertex is l/4 (d₂ − d₁) away
    assert!((at_corner[0] - (5.0 - 0.5 * TOLERANCE_MM)).abs() < 1e-12);
    assert!((at_corner[1] - 0.5 * TOLERANCE_MM).abs() < 1e-12);
    // σ = a/|c| = 2 l a: 4.9 mm/s through the corner
    let through = linear_mm(&law.sample(law.waypoint_times_s()[1]).qd);
    assert!((through - (2.0 * 0.08 * 150.0f64).sqrt() / 2f64.sqrt()).abs() < 1e-9, "{through}");
}

#[test]
fn without_tolerance_the_arm_stops_at_corners_only() {
    let limits = PathLimits::new(&V, &A, &LEVER_MM, 0.0).unwrap();
    let case =
        Case::new(vec![[0.0; 4], [2.0, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0, 0.0], [5.0, 5.0, 0.0, 0.0]], 2.0);
    let law = case.prepared(&limits).law(&case.caps_mm_s).unwrap();
    let speeds = law.waypoint_times_s().iter().map(|t| linear_mm(&law.sample(*t).qd)).collect::<Vec<_>>();
    assert_eq!(speeds, [0.0, 2.0, 0.0, 0.0]);
    assert_eq!(law.sample(law.waypoint_times_s()[2]).q, case.q[2]);
}

#[test]
fn a_cap_binds_its_own_move_only() {
    let mut case = Case::new((0..=4).map(|k| [3.0 * f64::from(k), 0.0, 0.0, 0.0]).collect(), 6.0);
    case.caps_mm_s[2] = 1.0;
    check(&case);
    let law = case.law();
    let middle = |k: usize| 0.5 * (law.waypoint_times_s()[k - 1] + law.waypoint_times_s()[k]);
    let speed = |k: usize| law.sample(middle(k)).qd[0];
    assert!((speed(1) - 6.0).abs() < 1e-9 && (speed(2) - 1.0).abs() < 1e-9 && (speed(3) - 6.0).abs() < 1e-9);
}

#[test]
fn rows_start_and_end_at_rest_on_the_grid() {
    let case = Case::new(vec![[0.0; 4], [1.0, 0.0, 0.0, 0.1], [1.0, 1.0, 0.0, 0.0]], 2.0);
    let law = case.law();
    for rate_hz in [500.0, 125.0, 300.0, 62.5] {
        let rows = law.rows(rate_hz).unwrap().collect();
        let last = rows.len() - 1;
        assert_eq!(rows.time_s[0], 0.0);
        assert!(rows.time_s[last] >= law.duration_s() && rows.time_s[last - 1] < law.duration_s());
        assert_eq!(rows.q[4 * last..], case.q[2]);
        assert!(rows.qd[4 * last..].iter().chain(&rows.qd[..4]).all(|qd| *qd == 0.0));
        for (time_s, q, qd) in rows.rows().take(last) {
            let state = law.sample(time_s);
            assert_eq!((q, qd), (&state.q[..], &state.qd[..]));
        }
    }
    assert!(law.rows(0.0).is_err() && law.rows(f64::NAN).is_err() && law.rows(f64::INFINITY).is_err());
    let rest = Case::new(vec![[1.0; 4]], 2.0).law().rows(500.0).unwrap().collect();
    assert_eq!((rest.len(), &rest.q[..]), (1, &[1.0; 4][..]));
}

#[test]
fn bad_input_is_named() {
    let ok = JointPath { q: &[0.0; 8], burr_mm: &[0.0, 1.0], stops: &[] };
    let prepared =
        |path: JointPath<'_>| PreparedPath::new(&path, &limits()).map(|_| ()).unwrap_err().to_string();
    assert!(prepared(JointPath { q: &[], burr_mm: &[], ..ok }).contains("no waypoint"));
    assert!(prepared(JointPath { q: &[0.0; 7], ..ok }).contains("7 values, expected 8"));
    let nan = [0.0, 0.0, 0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0];
    assert!(prepared(JointPath { q: &nan, ..ok }).contains("waypoint[1] = NaN"));
    assert!(prepared(JointPath { burr_mm: &[0.0, -1.0], ..ok }).contains("waypoint[1] = -1 mm"));
    assert!(prepared(JointPath { stops: &[2], ..ok }).contains("stop[0] = 2"));
    let path = PreparedPath::new(&ok, &limits()).unwrap();
    for caps in [&[1.0][..], &[1.0, 0.0], &[1.0, -1.0], &[1.0, f64::NAN], &[1.0, f64::INFINITY]] {
        assert!(path.law(caps).is_err() && path.duration_s(caps).is_err(), "{caps:?}");
    }
    assert!(PathLimits::new(&[], &[], &[], 0.04).is_err());
    assert!(PathLimits::new(&[1.0], &[0.0], &[1.0], 0.04).is_err());
    assert!(PathLimits::new(&[1.0], &[1.0], &[-1.0], 0.04).is_err());
    assert!(PathLimits::new(&[1.0], &[1.0], &[1.0], f64::NAN).is_err());
}
