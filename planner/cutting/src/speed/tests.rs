//! Tests of `speed`.

use super::*;
use proptest::prelude::*;

fn model(smoothing: Smoothing) -> SpeedModel {
    SpeedModel::new(0.5, 4.0, 1e-6, smoothing).unwrap()
}

const BOTH: [Smoothing; 2] = [Smoothing::Average, Smoothing::MinimumThenAverage];

/// Masses with air between, costs and lengths.
fn paths() -> impl Strategy<Value = (Vec<f64>, Vec<f64>, Vec<f64>)> {
    let point = (prop_oneof![Just(0.0), 0.001f64..30.0], 0.0f64..0.99, 0.01f64..1.0);
    prop::collection::vec(point, 1..60).prop_map(|points| {
        let (m, (c, ds)) = points.into_iter().map(|(m, c, ds)| (m, (c, ds))).unzip();
        (m, c, ds)
    })
}

proptest! {
    #![proptest_config(bonemill_geometry::fixed!(256))]

    #[test]
    fn speeds_keep_their_range((m, c, _) in paths()) {
        for smoothing in BOTH {
            let profile = model(smoothing).centred(&m, &c).unwrap();
            prop_assert!(profile.speed_mm_s.iter().all(|v| (0.5..=4.0).contains(v)));
        }
    }

    #[test]
    fn the_safe_smoothing_never_raises_a_speed((m, c, _) in paths()) {
        let profile = model(Smoothing::MinimumThenAverage).centred(&m, &c).unwrap();
        for (smooth, clamped) in profile.speed_mm_s.iter().zip(&profile.clamped_mm_s) {
            prop_assert!(smooth <= clamped);
        }
    }

    #[test]
    fn any_time_between_the_extremes_is_met((m, c, ds) in paths(), at in 0.0f64..1.0) {
        for smoothing in BOTH {
            let model = model(smoothing);
            let out = model.in_time(&m, &c, &ds, 1e9).unwrap_err();
            let ModelError::TimeOutOfReach { shortest_s, longest_s, .. } = out else { panic!("{out}") };
            prop_assert!(shortest_s <= longest_s);
            let wanted = shortest_s + at * (longest_s - shortest_s);
            let profile = model.in_time(&m, &c, &ds, wanted).unwrap();
            prop_assert!((profile.time_s(&ds) - wanted).abs() < 1e-9 * wanted);
            prop_assert!(profile.speed_mm_s.iter().all(|v| (0.5..=4.0).contains(v)));
        }
    }

    #[test]
    fn more_mass_or_more_cost_is_never_faster(m in 0.01f64..20.0, c in 0.0f64..0.9, more in 1.0f64..3.0) {
        let masses = [m, m * more, m, 1.0];
        let costs = [c, c, c + (1.0 - c) * 0.5, 0.2];
        let v = model(Smoothing::Average).centred(&masses, &costs).unwrap().clamped_mm_s;
        prop_assert!(v[1] <= v[0] && v[2] <= v[0]);
    }

    #[test]
    fn a_constant_stays(v in 0.5f64..4.0, n in 0usize..12) {
        for smoothing in BOTH {
            prop_assert_eq!(smoothing.apply(&vec![v; n]), vec![v; n]);
        }
    }
}

#[test]
fn the_mean_before_clamping_is_the_middle_of_the_range() {
    let (m, c) = ([2.0, 3.0, 0.0, 5.0], [0.1, 0.2, 0.9, 0.3]);
    let k = model(Smoothing::Average).centred(&m, &c).unwrap().k_vel.unwrap();
    let mean = (k * 0.9 / 2.0 + k * 0.8 / 3.0 + k * 0.7 / 5.0) / 3.0;
    assert!((mean - 2.25).abs() < 1e-14);
}

#[test]
fn short_paths() {
    for smoothing in BOTH {
        let model = model(smoothing);
        assert!(model.centred(&[], &[]).unwrap().speed_mm_s.is_empty());
        assert_eq!(model.centred(&[3.0], &[0.2]).unwrap().speed_mm_s, [2.25]);
        assert_eq!(model.centred(&[0.0, 0.0], &[0.0, 0.0]).unwrap().speed_mm_s, [4.0, 4.0]);
        assert_eq!(model.centred(&[0.0], &[0.0]).unwrap().k_vel, None);
        // C = 1: nothing to be gained, so as slow as allowed
        assert_eq!(model.centred(&[1.0, 2.0], &[1.0, 1.0]).unwrap().speed_mm_s, [0.5, 0.5]);
        assert_eq!(model.in_time(&[0.0], &[0.0], &[8.0], 2.0).unwrap().speed_mm_s, [4.0]);
    }
    let two = Smoothing::Average.apply(&[1.0, 4.0]);
    assert!((two[0] - 11.0 / 5.0).abs() < 1e-15 && (two[1] - 14.0 / 5.0).abs() < 1e-15);
    assert_eq!(Smoothing::MinimumThenAverage.apply(&[1.0, 4.0]), [1.0, 1.0]);
}

#[test]
fn slowing_comes_before_the_bone() {
    let steps = [4.0, 4.0, 4.0, 4.0, 1.0, 1.0, 1.0, 1.0];
    assert!(Smoothing::Average.apply(&steps)[4] > 1.9);
    let safe = Smoothing::MinimumThenAverage.apply(&steps);
    assert_eq!(safe[4..], [1.0; 4]);
    assert!(safe[3] < 4.0 && safe[0] > 3.0);
}

#[test]
fn bad_input_is_refused() {
    assert!(SpeedModel::new(0.0, 4.0, 0.0, Smoothing::Average).is_err());
    assert!(SpeedModel::new(4.0, 0.5, 0.0, Smoothing::Average).is_err());
    assert!(SpeedModel::new(0.5, f64::INFINITY, 0.0, Smoothing::Average).is_err());
    let model = model(Smoothing::Average);
    assert!(matches!(model.centred(&[1.0], &[]), Err(ModelError::Length { expected: 1, found: 0, .. })));
    assert!(model.centred(&[f64::NAN], &[0.0]).is_err());
    assert!(model.centred(&[-1.0], &[0.0]).is_err());
    assert!(model.centred(&[1.0], &[1.5]).is_err());
    assert!(model.in_time(&[1.0], &[0.5], &[1.0], 0.0).is_err());
    assert!(model.in_time(&[1.0], &[0.5], &[-1.0], 1.0).is_err());
}
