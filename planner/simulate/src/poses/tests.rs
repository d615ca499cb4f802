//! Sampling of trajectories: circles, sharp tips and rounded corners.

use super::*;

/// A circle of 10 mm radius at constant speed, 100 rows.
fn circle() -> Trajectory {
    let (mut q, mut qd, mut time_s) = (vec![], vec![], vec![]);
    for n in 0..100 {
        let t = n as f64 * 0.02;
        time_s.push(t);
        q.extend([10.0 * t.cos(), 10.0 * t.sin(), 0.0, 0.1 * t]);
        qd.extend([-10.0 * t.sin(), 10.0 * t.cos(), 0.0, 0.1]);
    }
    Trajectory { dof: 4, time_s, q, qd }
}

#[test]
fn steps_are_no_longer_than_asked_and_the_ends_are_kept() {
    let arm = Arm::bone_attached().unwrap();
    let frame = Rigid::<Work, Base>::identity();
    for step_mm in [0.05, 0.15, 0.5, 3.0] {
        let samples = sample(&circle(), &arm, &frame, Sampling::Step { step_mm }).unwrap();
        for pair in samples.windows(2) {
            assert!(pair[0].pose.center.distance_mm(&pair[1].pose.center) <= step_mm * 1.000_001);
            assert!(pair[1].time_s > pair[0].time_s);
        }
        assert_eq!((samples[0].time_s, samples[samples.len() - 1].time_s), (0.0, 99.0 * 0.02));
    }
}

#[test]
fn between_rows_joints_follow_the_cubic() {
    let arm = Arm::bone_attached().unwrap();
    let rate = Sampling::Rate { rate_hz: 777.0 };
    let samples = sample(&circle(), &arm, &Rigid::identity(), rate).unwrap();
    assert!(samples.len() > 1500);
    for s in &samples {
        let radius = s.q[0].hypot(s.q[1]);
        assert!((radius - 10.0).abs() < 1e-6, "{radius}");
    }
}

/// Rows at every 2 ms through points that a burr passes at 1 mm/s: straight from corner to corner, each rounded from this many mm
/// before it to as many behind it.
fn rounded(corners: &[[f64; 3]]) -> Trajectory {
    let at = |n: usize| Vector3::new(corners[n][0], corners[n][1], 0.0);
    let round_mm = |n: usize| corners[n][2];
    let mut places = vec![at(0)];
    let go = |places: &mut Vec<Vector3<f64>>, to: Vector3<f64>| {
        let from = places[places.len() - 1];
        let count = ((to - from).norm() / 0.002).ceil() as usize;
        places.extend((1..=count).map(|n| from.lerp(&to, n as f64 / count as f64)));
    };
    for n in 1..corners.len() - 1 {
        let (corner, round_mm) = (at(n), round_mm(n));
        let [before, behind] = [n - 1, n + 1].map(|m| corner + (at(m) - corner).normalize() * round_mm);
        go(&mut places, before);
        let count = (2.0 * round_mm / 0.002).ceil();
        let arc = (1..=count as usize).map(|n| n as f64 / count);
        places.extend(arc.map(|u| before.lerp(&corner, u).lerp(&corner.lerp(&behind, u), u)));
    }
    go(&mut places, at(corners.len() - 1));
    let last = places.len() - 1;
    let velocity = |n: usize| (places[(n + 1).min(last)] - places[n.max(1) - 1]) / 0.004;
    let rows = 0..places.len();
    Trajectory {
        dof: 4,
        time_s: rows.clone().map(|n| n as f64 * 0.002).collect(),
        q: rows.clone().flat_map(|n| [places[n].x, places[n].y, 0.0, 0.0]).collect(),
        qd: rows.flat_map(|n| [velocity(n).x, velocity(n).y, 0.0, 0.0]).collect(),
    }
}

/// A sharp corner, passed twice on the same lines: the second time it is rounded less, so that the burr goes farther.
fn corner_passed_twice() -> Trajectory {
    rounded(&[[-0.6, 0.0, 0.0], [0.0, 0.0, 0.15], [-0.4, 0.15, 0.02], [0.0, 0.0, 0.05], [-0.6, 0.0, 0.0]])
}

/// No row of the tip opposes the one before it, so that only its distance from the step tells that it must be kept.
#[test]
fn the_tip_of_a_rounded_corner_is_kept() {
    let arm = Arm::bone_attached().unwrap();
    let path = rounded(&[[-1.0, 0.0, 0.0], [0.0, 0.0, 0.03], [-1.0, 0.1, 0.0]]);
    let farthest = |x: &mut dyn Iterator<Item = f64>| x.fold(f64::MIN, f64::max);
    let tip_mm = farthest(&mut (0..path.len()).map(|n| path.q_at(n)[0]));
    for step_mm in [0.02, 0.1, 0.13, 0.5] {
        let samples = sample(&path, &arm, &Rigid::identity(), Sampling::Step { step_mm }).unwrap();
        let kept_mm = farthest(&mut samples.iter().map(|s| s.q[0]));
        assert!(tip_mm - kept_mm <= 1e-3, "{step_mm}: {kept_mm} of {tip_mm}");
    }
}

#[test]
fn the_steps_pass_every_row_at_its_time() {
    let arm = Arm::bone_attached().unwrap();
    for path in [corner_passed_twice(), circle()] {
        for step_mm in [0.05, 0.1, 0.5] {
            let samples = sample(&path, &arm, &Rigid::identity(), Sampling::Step { step_mm }).unwrap();
            for row in 0..path.len() {
                let p = arm.burr(path.q_at(row)).unwrap().translation_mm;
                let next =
                    samples.partition_point(|s| s.time_s <= path.time_s[row]).clamp(1, samples.len() - 1);
                let (from, to) = (&samples[next - 1], &samples[next]);
                let [a, b] = [from, to].map(|s| s.pose.center.coords);
                let even = a.lerp(&b, (path.time_s[row] - from.time_s) / (to.time_s - from.time_s));
                assert!(segment_distance_squared(&p, &a, &b).sqrt() <= ASIDE_MM + 1e-9);
                assert!((p - even).norm() <= UNEVEN_MM + 1e-9);
            }
        }
    }
}

/// At the second visit the burr cuts a skin that the first left; its force rises and falls within 0.1 mm, so that long steps meet a
/// part of it. Without the tip, a step of 0.13 mm met a sixth.
#[test]
fn the_peak_force_at_a_corner_converges_with_the_step() {
    let (arm, path) = (Arm::bone_attached().unwrap(), corner_passed_twice());
    let corner = arm.burr(&[0.0; 4]).unwrap().translation_mm;
    let frame = Rigid::new(nalgebra::Rotation3::identity(), -corner);
    let bone = crate::tests::uniform(4.0, 0.25);
    let peak_n = |step_mm: f64| {
        let samples = sample(&path, &arm, &frame, Sampling::Step { step_mm }).unwrap();
        let mut engine = crate::tests::engine(&bone, samples[0].pose);
        let steps: Vec<_> = moves(&samples).chunks(16).flat_map(|m| engine.steps(m).unwrap()).collect();
        let second = steps.iter().zip(&samples[1..]).filter(|(_, s)| s.time_s > 1.1);
        second.map(|(step, _)| step.force.force_n.norm()).fold(0.0, f64::max)
    };
    let finest_n = peak_n(0.005);
    for (step_mm, least) in [(0.02, 0.98), (0.05, 0.9), (0.1, 0.65), (0.13, 0.65), (0.2, 0.65)] {
        let share = peak_n(step_mm) / finest_n;
        assert!((least..1.02).contains(&share), "{step_mm} mm: {share} of {finest_n} N");
    }
}

#[test]
fn the_velocity_is_that_of_the_joints() {
    let arm = Arm::bone_attached().unwrap();
    let rate = Sampling::Rate { rate_hz: 777.0 };
    let samples = sample(&circle(), &arm, &Rigid::identity(), rate).unwrap();
    for three in samples.windows(3) {
        let way = three[2].pose.center - three[0].pose.center;
        let mean = way / (three[2].time_s - three[0].time_s);
        assert!((three[1].velocity_mm_s - mean).norm() < 1e-4 * mean.norm() || three[2].time_s >= 1.98);
    }
}

/// One row is far away between two that are near each other.
#[test]
fn the_tip_of_a_sharp_turn_is_kept() {
    let arm = Arm::bone_attached().unwrap();
    let mut path = circle();
    path.q[4 * 50] += 40.0;
    let samples = sample(&path, &arm, &Rigid::identity(), Sampling::Step { step_mm: 0.3 }).unwrap();
    let is_tip = |s: &TrajectorySample| s.q[0] == path.q[4 * 50];
    assert!(samples.iter().any(is_tip));
}

#[test]
fn what_cannot_be_sampled_is_refused() {
    let arm = Arm::bone_attached().unwrap();
    for sampling in [
        Sampling::Step { step_mm: 0.0 },
        Sampling::Step { step_mm: f64::NAN },
        Sampling::Step { step_mm: 1e-9 },
        Sampling::Rate { rate_hz: -1.0 },
        Sampling::Rate { rate_hz: 1e12 },
        Sampling::Rate { rate_hz: 1e-300 },
        Sampling::Rate { rate_hz: 0.5 },
        Sampling::Step { step_mm: 1000.0 },
    ] {
        assert!(sample(&circle(), &arm, &Rigid::identity(), sampling).is_err(), "{sampling:?}");
    }
}
