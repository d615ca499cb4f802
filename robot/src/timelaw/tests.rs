//! Properties of the time law on ordinary, hostile and random paths.

use proptest::prelude::*;

use super::*;

mod harness;
use harness::{A, Case, J, V, any_case, check, limits, linear_mm};

proptest! {
    // each is looked at in thousands of instants
    #![proptest_config(ProptestConfig::with_cases(60))]

    #[test]
    fn any_path_keeps_every_promise(case in any_case()) {
        check(&case);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn half_the_caps_take_at_most_twice_as_long(case in any_case()) {
        // half of any allowed motion is an allowed motion under half the caps
        let prepared = case.prepared(&limits());
        let half: Vec<f64> = case.caps_mm_s.iter().map(|cap| 0.5 * cap).collect();
        let (whole, half) = (prepared.duration_s(&case.caps_mm_s).unwrap(), prepared.duration_s(&half).unwrap());
        prop_assert!(half <= 2.0 * whole * (1.0 + 1e-12), "{whole} s, half caps {half} s");
        let bound = prepared.lower_bound_s(&case.caps_mm_s).unwrap();
        // a corner shortens the path by less than its own size
        prop_assert!(whole >= 0.9 * bound, "{whole} s, at least {bound} s");
    }

    #[test]
    fn duration_and_law_agree_and_repeat(case in any_case()) {
        let prepared = case.prepared(&limits());
        let law = prepared.law(&case.caps_mm_s).unwrap();
        prop_assert!((law.duration_s() - prepared.duration_s(&case.caps_mm_s).unwrap()).abs() <= 1e-11 * law.duration_s());
        let again = case.law();
        prop_assert_eq!(law.waypoint_times_s(), again.waypoint_times_s());
        let at = 0.37 * law.duration_s();
        prop_assert_eq!(law.sample(at), again.sample(at));
    }

    /// Windows are tried from the longest on until one takes longer.
    #[test]
    fn no_window_that_is_left_out_is_better(case in any_case()) {
        let prepared = case.prepared(&limits());
        let caps = prepared.segment_caps(&case.caps_mm_s).unwrap();
        let found_s = prepared.duration_s(&case.caps_mm_s).unwrap();
        for share in prepared::WINDOW_SHARES {
            let (_, duration_s, _) = prepared.through_window(&caps, share);
            prop_assert!(found_s <= duration_s * (1.0 + 1e-9), "{share}: {duration_s} s before {found_s} s");
        }
    }

    #[test]
    fn splitting_a_straight_move_changes_nothing(
        before in prop::collection::vec(prop::array::uniform4(-0.3f64..0.3), 0..5),
        // long, because a corner takes at most half of a move, so a short move changes when it is divided
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
        prop_assert!((whole.duration_s() - halves.duration_s()).abs() <= 1e-9 * whole.duration_s());
    }
}

#[test]
fn the_greatest_speed_of_a_short_move_between_two_corners_is_not_missed() {
    // corners that meet: only for an instant does the burr move along the polyline
    let q = [[0.0, 0.0], [0.25, 0.0], [0.25, 0.12], [0.12, 0.0], [0.12, 0.17], [0.4, 0.2], [0.4, 0.0]];
    for scale in [0.6, 0.8, 1.0, 1.3, 1.7] {
        let case = Case::new(q.map(|[x, y]| [scale * x, scale * y, 0.0, 0.0]).to_vec(), 12.0);
        let law = case.law();
        let (stated, times) = (law.burr_speeds_mm_s(), law.waypoint_times_s());
        for k in 1..q.len() {
            let at = |n: u32| times[k - 1] + (times[k] - times[k - 1]) * f64::from(n) / 1000.0;
            let speed = |n: u32| linear_mm(&law.sample(at(n)).qd);
            let found = (0..=1000).map(speed).fold(0.0, f64::max);
            assert!((stated[k] / found - 1.0).abs() < 2e-3, "move {k} × {scale}: {} for {found}", stated[k]);
        }
    }
}

/// The shortest of the windows' laws for a straight move of the first joint.
fn by_hand(length_mm: f64, cap_mm_s: f64) -> f64 {
    let of = |share: f64| {
        let window_s = 0.1 * share;
        let a = 150f64.min(0.5 * 3000.0 * window_s);
        let top = cap_mm_s.min((a * length_mm).sqrt());
        length_mm / top + top / a + window_s
    };
    [1.0, 0.5, 0.25, 0.125, 0.0625].map(of).into_iter().fold(f64::INFINITY, f64::min)
}

#[test]
fn a_straight_move_is_the_smoothed_trapezoid() {
    for (length_mm, cap_mm_s) in [(10.0, 4.0), (0.1, 4.0), (10.0, 0.5), (60.0, 14.0)] {
        let law = Case::new(vec![[0.0; 4], [length_mm, 0.0, 0.0, 0.0]], cap_mm_s).law();
        let expected = by_hand(length_mm, cap_mm_s);
        assert!((law.duration_s() - expected).abs() < 1e-9, "{} against {expected}", law.duration_s());
        // the fastest jerk-limited move: v/a + a/j to full speed where v is above a²/j, else 2 √(v/j)
        let (a, j) = (150.0, 3000.0);
        let top = cap_mm_s;
        let ramp = if top > a * a / j { top / a + a / j } else { 2.0 * (top / j).sqrt() };
        if length_mm > top * ramp {
            let best = length_mm / top + ramp;
            assert!(law.duration_s() < best + 0.06, "{} against the optimum {best}", law.duration_s());
        }
    }
}

#[test]
fn the_time_at_a_limit_is_told_by_joint_and_limit() {
    // 10 mm of the first joint at 15 mm/s, then 6 rad of the last at 0.6 rad/s
    let law = Case::new(vec![[0.0; 4], [10.0, 0.0, 0.0, 0.0], [10.0, 0.0, 0.0, 6.0]], 100.0).law();
    let found = law.seconds_at_limits(&limits(), 0.95);
    assert!((found[3][0] - 10.0).abs() < 0.3, "{found:?}");
    assert!(found[0][0] > 0.3 && found[0][0] < 10.0 / 15.0, "{found:?}");
    assert!(found[1..3].iter().flatten().all(|s| *s == 0.0), "{found:?}");
    // slow enough for every joint
    let slow = Case::new(vec![[0.0; 4], [10.0, 0.0, 0.0, 0.0]], 1.0).law();
    assert!(slow.seconds_at_limits(&limits(), 0.95).concat()[0] == 0.0);
}

#[test]
fn a_rotation_in_place_is_bound_by_its_joint() {
    let law = Case::new(vec![[0.0; 4], [0.0, 0.0, 0.0, 0.6]], 1.0).law();
    // 0.6 rad at 0.6 rad/s, to full speed in 0.1 s
    assert!((1.1..1.25).contains(&law.duration_s()), "{}", law.duration_s());
}

/// A helix of 5 mm radius in equal turns, sinking by 0.2 mm per rad, the tilt swinging by ±17° a turn.
fn helix(count: i32, step_rad: f64) -> Vec<[f64; 4]> {
    let at = |k: i32| {
        let angle = step_rad * f64::from(k);
        [5.0 * angle.cos(), 5.0 * angle.sin(), -0.2 * angle, 0.3 * angle.sin()]
    };
    (0..count).map(at).collect()
}

#[test]
fn a_smooth_cut_takes_little_longer_than_its_caps_demand() {
    let case = Case::new(helix(800, 0.05), 1.5);
    let bound_s = case.prepared(&limits()).lower_bound_s(&case.caps_mm_s).unwrap();
    let ratio = case.law().duration_s() / bound_s;
    assert!((0.999..1.01).contains(&ratio), "{ratio}");
}

#[test]
fn jerk_limits_that_bind_nothing_cost_no_other_limit() {
    let case = Case::new(helix(200, 0.3), 1.5);
    for (acceleration, jerk) in
        [(150.0, 1e6), (150.0, 1e9), (150.0, 1e12), (0.01, 3000.0), (1e9, 1e12), (1e9, 3000.0)]
    {
        let limits = PathLimits::new(&V, &[acceleration; 4], &[jerk; 4], harness::TOLERANCE).unwrap();
        let law = case.prepared(&limits).law(&case.caps_mm_s).unwrap();
        let LimitRatios { velocity, acceleration: a, jerk: j } = law.limit_ratios(&limits);
        assert!(velocity.max(a).max(j) <= 1.0 + 1e-9, "{acceleration} {jerk}: {velocity} {a} {j}");
        // it arrives where it should
        let end = law.sample(law.duration_s() - 1e-9);
        assert!(
            end.q.iter().zip(&case.q[199]).all(|(q, to)| (q - to).abs() < 1e-6),
            "{acceleration} {jerk}: {:?}",
            end.q
        );
    }
}

#[test]
fn a_motion_of_too_many_rows_is_refused() {
    let case = Case::new(vec![[0.0; 4], [10.0, 0.0, 0.0, 0.0]], 1e-4);
    let law = case.law();
    assert!(law.rows(50.0).is_ok());
    let error = law.rows(500.0).unwrap_err();
    assert!(
        matches!(error, bonemill_arm::RobotError::TooLong { .. }) && error.to_string().contains("500 Hz"),
        "{error}"
    );
    assert!(matches!(law.rows(f64::NAN), Err(bonemill_arm::RobotError::Value { .. })));
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
        // a corner of 1e-9 rad at full speed: ṡ² must not change over a length of the size of rounding
        vec![[0.0, 0.0, 0.0, -0.68], [2.0, 0.0, 0.0, -0.68], [4.0, 0.0, 0.0, -0.68 + 1e-9]],
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
    assert!((clean.duration_s() - noisy.duration_s()).abs() < 1e-3, "{}", noisy.duration_s());
}

#[test]
fn the_cap_of_a_merged_move_binds_nothing() {
    let mut case = Case::new(vec![[0.0; 4], [1e-9, 0.0, 0.0, 0.0], [10.0, 0.0, 0.0, 0.0]], 10.0);
    case.caps_mm_s[1] = 0.1;
    assert!(case.law().duration_s() < 1.25);
}

#[test]
fn a_rotation_after_a_move_does_not_free_the_burr() {
    let q = vec![[0.0; 4], [0.0, -0.06, 0.0, 0.001], [0.0, -0.06, 0.0, 0.5], [0.06, -0.06, 0.0, 0.5]];
    let case = Case::new(q, 0.5);
    let law = case.law();
    let fastest =
        harness::instants(&law).into_iter().map(|t| linear_mm(&law.sample(t).qd)).fold(0.0, f64::max);
    assert!(fastest <= 0.5 * (1.0 + 1e-12), "{fastest} mm/s");
}

#[test]
fn a_right_angle_is_cut_by_the_tolerance() {
    let case = Case::new(vec![[0.0; 4], [5.0, 0.0, 0.0, 0.0], [5.0, 5.0, 0.0, 0.0]], 14.0);
    let law = case.law();
    let at_corner = law.sample(law.waypoint_times_s()[1]);
    // the middle deviates by 3l/16 (d₂ − d₁), which is the whole tolerance
    let off = [at_corner.q[0] - 5.0, at_corner.q[1]];
    assert!((off[0].hypot(off[1]) - 0.04).abs() < 1e-9, "{off:?}");
    // l = 16/3 · 0.04/√2; the limit that binds is ṡ³ |q'''| ≤ 0.6 j with |q'''| = 6/(2l)²
    let l = 16.0 / 3.0 * 0.04 / 2f64.sqrt();
    let through = (0.6 * 3000.0 * (2.0 * l).powi(2) / 6.0).cbrt();
    // at the middle q' is the mean of d₁ and d₂: |q'| = 1/√2
    let speed = linear_mm(&at_corner.qd) * 2f64.sqrt();
    assert!((0.9 * through..=through * (1.0 + 1e-9)).contains(&speed), "{speed} mm/s, {through}");
}

#[test]
fn a_share_of_the_way_is_gone_when_the_burr_is_there() {
    let law = Case::new([0.0, 2.0, 2.5, 6.0].map(|x| [x, 0.0, 0.0, 0.0]).into(), 3.0).law();
    for (share, x) in [(0.0, 2.0), (0.1, 2.4), (0.5, 4.0), (1.0, 6.0)] {
        assert!((law.sample(law.on_the_way_s([1, 3], share)).q[0] - x).abs() < 1e-9, "{share}");
    }
}

#[test]
fn a_corner_holds_every_waypoint_in_its_place() {
    let corner = |off: f64| [5.0, off, 0.0, 0.0];
    let case = Case::new(vec![[0.0; 4], corner(0.0), corner(1e-9), corner(5.0)], 14.0);
    let found = case.prepared(&limits()).burr_corners(2e-3, 2);
    let [(waypoints, places)] = &found[..] else { panic!("{found:?}") };
    let [before, quarter, middle, _, behind] = &places[..] else { panic!("{places:?}") };
    assert_eq!(*waypoints, 1..3);
    assert!((before[0]..middle[0]).contains(&quarter[0]) && (before[1]..middle[1]).contains(&quarter[1]));
    assert!(before[0] < 5.0 && before[1] == 0.0 && behind[1] > 0.0 && (behind[0] - 5.0).abs() < 1e-8);
    assert!((middle[0] - 5.0).hypot(middle[1]) > 0.03);
}

#[test]
fn without_tolerance_the_arm_stops_at_corners_only() {
    let limits = PathLimits::new(&V, &A, &J, CornerTolerance { burr_mm: 0.0, axis_rad: 0.0 }).unwrap();
    let case =
        Case::new(vec![[0.0; 4], [2.0, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0, 0.0], [5.0, 5.0, 0.0, 0.0]], 2.0);
    let law = case.prepared(&limits).law(&case.caps_mm_s).unwrap();
    let speeds = law.waypoint_times_s().iter().map(|t| linear_mm(&law.sample(*t).qd)).collect::<Vec<_>>();
    assert!(
        speeds[0] == 0.0 && (speeds[1] - 2.0).abs() < 1e-9 && speeds[2] < 1e-5 && speeds[3] == 0.0,
        "{speeds:?}"
    );
    let corner = law.sample(law.waypoint_times_s()[2]).q;
    assert!(linear_mm(&harness::sub(&corner, &case.q[2])) < 1e-9);
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
            let apart = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
            assert!(apart(q, &state.q) && apart(qd, &state.qd));
        }
    }
    assert!(law.rows(0.0).is_err() && law.rows(f64::NAN).is_err() && law.rows(f64::INFINITY).is_err());
    let rest = Case::new(vec![[1.0; 4]], 2.0).law().rows(500.0).unwrap().collect();
    assert_eq!((rest.len(), &rest.q[..]), (1, &[1.0; 4][..]));
}

#[test]
fn bad_input_is_named() {
    let pose = [[0.0; 6]; 2];
    let ok = JointPath { q: &[0.0; 8], burr_mm: &[0.0, 1.0], pose: &pose, stops: &[] };
    let prepared =
        |path: JointPath<'_>| PreparedPath::new(&path, &limits()).map(|_| ()).unwrap_err().to_string();
    assert!(prepared(JointPath { q: &[], burr_mm: &[], pose: &[], ..ok }).contains("no waypoint"));
    assert!(prepared(JointPath { q: &[0.0; 7], ..ok }).contains("7 values, expected 8"));
    let nan = [0.0, 0.0, 0.0, 0.0, 0.0, f64::NAN, 0.0, 0.0];
    assert!(prepared(JointPath { q: &nan, ..ok }).contains("waypoint[1] = NaN"));
    assert!(prepared(JointPath { burr_mm: &[0.0, -1.0], ..ok }).contains("waypoint[1] = -1 mm"));
    assert!(prepared(JointPath { stops: &[2], ..ok }).contains("stop[0] = 2"));
    let path = PreparedPath::new(&ok, &limits()).unwrap();
    for caps in [&[1.0][..], &[1.0, 0.0], &[1.0, -1.0], &[1.0, f64::NAN], &[1.0, f64::INFINITY]] {
        assert!(path.law(caps).is_err() && path.duration_s(caps).is_err(), "{caps:?}");
    }
    assert!(prepared(JointPath { pose: &pose[..1], ..ok }).contains("burr's place has 1 values, expected 2"));
    let lost = [[0.0; 6], [f64::NAN; 6]];
    assert!(prepared(JointPath { pose: &lost, ..ok }).contains("waypoint[1] = NaN"));
    let corner = CornerTolerance::default();
    assert!(PathLimits::new(&[], &[], &[], corner).is_err());
    assert!(PathLimits::new(&[1.0], &[0.0], &[1.0], corner).is_err());
    assert!(PathLimits::new(&[1.0], &[1.0], &[-1.0], corner).is_err());
    assert!(
        PathLimits::new(&[1.0], &[1.0], &[1.0], CornerTolerance { burr_mm: f64::NAN, ..corner }).is_err()
    );
    assert!(PathLimits::new(&[1.0], &[1.0], &[1.0], CornerTolerance { axis_rad: -1.0, ..corner }).is_err());
}

#[test]
fn a_hundred_thousand_waypoints_are_one_motion() {
    let at = |k: i32| {
        let angle = 0.05 * f64::from(k);
        [5.0 * angle.cos(), 5.0 * angle.sin(), -1e-4 * f64::from(k), 0.3 * (0.1 * angle).sin()]
    };
    let case = Case::new((0..100_000).map(at).collect(), 1.5);
    let law = case.law();
    let bound_s = case.prepared(&limits()).lower_bound_s(&case.caps_mm_s).unwrap();
    assert!((0.999..1.01).contains(&(law.duration_s() / bound_s)), "{} of {bound_s}", law.duration_s());
    let ratios = law.limit_ratios(&limits());
    assert!(ratios.velocity.max(ratios.acceleration).max(ratios.jerk) <= 1.0 + 1e-6, "{ratios:?}");
    assert_eq!(law.sample(law.duration_s()).q, case.q[99_999]);
}

#[test]
fn two_waypoints_a_nanometre_apart_and_a_half_turn_are_ordinary() {
    let x = |x: f64, t: f64| [x, 0.0, 0.0, t];
    check(&Case::new(vec![x(0.0, 0.0), x(1.0, 0.0), x(1.0 + 1e-6, 0.0), x(2.0, 0.0)], 2.0));
    check(&Case::new(vec![x(0.0, 0.0), x(3.0, 0.0), x(0.0, 0.0)], 2.0));
    check(&Case::new(vec![x(0.0, -1.5), x(0.0, 1.5), x(0.0, -1.5)], 2.0));
}

#[test]
fn a_stop_between_a_move_and_a_turn_is_one_for_both() {
    // rounding may put s on either side of the rest
    let x = |x: f64, z: f64, t: f64| [x, 0.0, z, t];
    let far = 11.307616843912339;
    let turn = vec![
        x(0.0, 0.0, 0.0),
        x(far, 0.0, 0.0),
        x(far, 0.0, 0.0162331473082486),
        x(far, -5e-10, 0.0162331473082486),
    ];
    check(&Case { stops: vec![1], ..Case::new(turn, 0.3) });
    // a stop with a near duplicate behind it, then a short move
    let (z, t) = (-0.31649993321551234, 0.7446567286080935);
    let short = vec![
        x(0.0, -0.28157021887839023, 0.7346047008074594),
        x(0.0, z, t),
        x(0.0, z, t + 5.1e-10),
        x(0.07805535574037184, z, t + 5.1e-10),
        x(0.07805535574037184, z, t),
        x(2.078055355740372, z, t),
    ];
    let caps_mm_s = vec![1.0, 5.218583764605534, 0.3, 10.933559679825775, 0.3, 0.5581625046268726];
    check(&Case { q: short, caps_mm_s, stops: vec![1] });
}
