//! Forces against the reference cases and closed limits.

use crate::cutter::{Cutter, GlenoidReamer, GlenoidReamerSpec, TwistDrill, TwistDrillSpec};
use proptest::prelude::*;
use serde_json::Value;

use super::*;

const D01: &str = include_str!("../../../tests/data/d01_drill_500.json");
const D02: &str = include_str!("../../../tests/data/d02_drill_f01_chisel.json");
const D04: &str = include_str!("../../../tests/data/d04_reamer.json");

fn close(found: f64, expected: &Value, what: &str) {
    let expected = expected.as_f64().unwrap();
    assert!((found - expected).abs() <= 1e-10 * expected.abs().max(1e-3), "{what}: {found} {expected}");
}

fn number(case: &Value, key: &str) -> f64 {
    case["inputs"][key].as_f64().unwrap()
}

fn drill(case: &Value) -> TwistDrill {
    TwistDrill::new(TwistDrillSpec {
        radius_mm: number(case, "R"),
        point_deg: number(case, "eps_deg"),
        helix_deg: number(case, "theta_deg"),
        chisel_deg: number(case, "psi_deg"),
        web_mm: number(case, "w"),
        lips: number(case, "Nc") as u32,
        flute_mm: 30.0,
    })
    .unwrap()
}

fn model(case: &Value) -> CoefficientModel {
    CoefficientModel::constant(number(case, "kc"), number(case, "kf")).unwrap()
}

#[test]
fn the_drill_cases_agree_to_1e_10() {
    use crate::cutter::EdgeKind::{Chisel, Lip};
    for text in [D01, D02] {
        let case: Value = serde_json::from_str(text).unwrap();
        let (drill, f) = (drill(&case), number(&case, "f"));
        let edges = drill.edges(f, number(&case, "n_elements") as usize).unwrap();
        let loads = EdgeLoads::new(&edges, f, 500.0, &model(&case));
        let expected = &case["expected"]["discrete"];
        close(drill.inner_radius_mm(), &expected["Rc"], "Rc");
        let parts = [("lips", Lip), ("chisel", Chisel)];
        let mut compared = 0;
        for (key, kind) in parts.into_iter().filter(|(key, _)| expected.get(key).is_some()) {
            let [fz, mz, fx] = loads.axial(|_, load| f64::from(u8::from(load.kind == kind)));
            close(fz, &expected[key]["Fz"], "Fz");
            close(mz, &expected[key]["Mz"], "Mz");
            close(fx, &expected[key]["Fx_per_lip"], "Fx");
            compared += 1;
        }
        assert_eq!(compared, 1 + usize::from(expected.get("chisel").is_some()));
        if let Some(total) = expected.get("total") {
            let all = loads.all_engaged();
            close(all.thrust_n(), &total["Fz"], "thrust");
            close(all.torque_nmm(), &total["torque"], "torque");
            assert!(all.lateral_n() < 1e-12);
        }
    }
}

#[test]
fn the_angles_along_a_lip_are_those_of_the_cases() {
    for text in [D01, D02] {
        let case: Value = serde_json::from_str(text).unwrap();
        for row in case["expected"]["angles_at"].as_array().unwrap() {
            // an element about that radius: the middle one of a lip that reaches as far beyond
            let (r, f, drill) = (row[0].as_f64().unwrap(), number(&case, "f"), drill(&case));
            let width = drill.spec().radius_mm - drill.inner_radius_mm();
            let count = 20_000;
            let n = ((r - drill.inner_radius_mm()) / width * f64::from(count)) as usize;
            let edges = drill.edges(f, count as usize).unwrap();
            let (a, b) = (&edges.elements[n - 1], &edges.elements[n + 1]);
            let share = (r - a.radius_mm) / (b.radius_mm - a.radius_mm);
            let angles = |e: &crate::cutter::EdgeElement| [e.mu_rad, e.lambda_rad, e.tau_rad, e.gamma_n_rad];
            for (m, (a, b)) in angles(a).into_iter().zip(angles(b)).enumerate() {
                let expected = row[m + 1].as_f64().unwrap();
                assert!((a + share * (b - a) - expected).abs() < 1e-8, "{r} {m}");
            }
        }
    }
}

#[test]
fn the_reamer_case_agrees_to_1e_10() {
    let case: Value = serde_json::from_str(D04).unwrap();
    let reamer = GlenoidReamer::new(GlenoidReamerSpec {
        arc_radius_mm: number(&case, "R"),
        offset_mm: number(&case, "w"),
        rim_radius_mm: number(&case, "R_outer"),
        edge_deg: number(&case, "alpha_deg"),
        edges: number(&case, "Nc") as u32,
        nipple_radius_mm: 3.0,
        nipple_length_mm: 5.0,
    })
    .unwrap();
    let f = number(&case, "f");
    let edges = reamer.edges(f, number(&case, "n_elements") as usize).unwrap();
    let [fz, mz, fx] = EdgeLoads::new(&edges, f, 60.0, &model(&case)).axial(|_, _| 1.0);
    let expected = &case["expected"]["discrete"];
    close(fz, &expected["Fz"], "Fz");
    close(mz, &expected["Mz"], "Mz");
    close(fx, &expected["Fx_per_lip"], "Fx");
}

/// w = 0, θ = 0, f → 0: torque = k_c f R²/2, thrust = k_f k_c f R sin ε (docs/force-model.md 9).
#[test]
fn the_closed_limits_hold() {
    for point_deg in [30.0, 59.0, 90.0f64] {
        let spec = TwistDrillSpec {
            radius_mm: 1.25,
            point_deg,
            helix_deg: 0.0,
            chisel_deg: 116.0,
            web_mm: 0.0,
            lips: 2,
            flute_mm: 10.0,
        };
        let f = 1e-9;
        let edges = TwistDrill::new(spec).unwrap().edges(f, 400).unwrap();
        assert_eq!(edges.elements.len(), 400, "no chisel edge without a web");
        let loads = EdgeLoads::new(&edges, f, 500.0, &CoefficientModel::constant(150.0, 0.4).unwrap());
        let all = loads.all_engaged();
        let (torque, thrust) =
            (150.0 * f * 1.25f64.powi(2) / 2.0, 0.4 * 150.0 * f * 1.25 * point_deg.to_radians().sin());
        assert!((all.torque_nmm() / torque - 1.0).abs() < 1e-6, "{point_deg}");
        assert!((all.thrust_n() / thrust - 1.0).abs() < 1e-6, "{point_deg}");
        let still = EdgeLoads::new(&edges, 0.0, 500.0, &CoefficientModel::constant(150.0, 0.4).unwrap());
        assert_eq!(still.all_engaged(), CutterForce::default());
    }
}

/// One lip in bone pushes sideways; so does a half-space beside the axis, but not in the mean of opposite halves.
#[test]
fn partial_engagement_gives_lateral_force() {
    let case: Value = serde_json::from_str(D01).unwrap();
    let edges = drill(&case).edges(0.02, 64).unwrap();
    let loads = EdgeLoads::new(&edges, 0.02, 500.0, &model(&case));
    let half = |sign: f64| loads.sum(32, |_, at| if at.x() * sign > 0.0 { 1.0 } else { 0.0 });
    let (left, right, all) = (half(-1.0), half(1.0), loads.all_engaged());
    assert!(right.lateral_n() > 0.1 * all.thrust_n());
    assert!((right.force_n + left.force_n - all.force_n).norm() < 1e-12);
    assert!((right.thrust_n() / all.thrust_n() - 0.5).abs() < 1e-9);
    assert!(
        (right.force_n.x + left.force_n.x).abs() < 1e-12
            && right.force_n.y.signum() != left.force_n.y.signum()
    );
}

#[test]
fn regressions_give_what_they_say() {
    let cut = Cut { area_mm2: 1e-4, speed_mm_s: 50.0, one_less_sin_rake: 0.8 };
    assert_eq!(CoefficientModel::Rake([[10.0, 100.0], [1.0, -5.0]]).at(&cut), [90.0, -3.0]);
    assert_eq!(CoefficientModel::Reciprocal([[10.0, 100.0], [1.0, -100.0]]).at(&cut), [12.0, -1.0]);
    let [k, _] = CoefficientModel::PowerLaw([[2.0, -0.2, 0.1, 0.5], [0.0; 4]]).at(&cut);
    assert!((k - 2f64.exp() * 1e-4f64.powf(-0.2) * 50f64.powf(0.1) * 0.8f64.sqrt()).abs() < 1e-12 * k);
    let [k, _] = CoefficientModel::Chip([[2.0, -0.2, 0.1], [0.0; 3]]).at(&cut);
    assert!((k - 2f64.exp() * 1e-4f64.powf(-0.2) * 50f64.powf(0.1)).abs() < 1e-12 * k);
    let none = Cut { area_mm2: 0.0, ..cut };
    assert_eq!(CoefficientModel::Chip([[2.0, -0.2, 0.1], [0.0; 3]]).at(&none), [0.0; 2]);
    assert!(CoefficientModel::constant(f64::NAN, 0.4).is_err());
}

/// Rows of an entry at the four feeds and speeds of Faieghi et al. III-A, with what the model gives, times 1 + `noise` · u.
fn entries(fitting: &PlungeFitting<'_>, truth: &CoefficientModel, noise: f64) -> Vec<PlungeInstant> {
    let mut rows = Vec::new();
    for (feed_mm_rev, spindle_rpm) in [(0.01, 500.0), (0.02, 500.0), (0.01, 3000.0), (0.02, 3000.0)] {
        for n in 0..40 {
            let depth_mm = 0.02 * f64::from(n + 1);
            let row = PlungeInstant { feed_mm_rev, spindle_rpm, depth_mm, thrust_n: 0.0, torque_nmm: 0.0 };
            let [thrust_n, torque_nmm] = fitting.predict(truth, &row).unwrap();
            let u = |k: f64| noise * (k * 12.9898 + 78.233 * rows.len() as f64).sin();
            rows.push(PlungeInstant {
                thrust_n: thrust_n * (1.0 + u(1.0)),
                torque_nmm: torque_nmm * (1.0 + u(2.0)),
                ..row
            });
        }
    }
    rows
}

#[test]
fn a_clean_log_gives_the_coefficients_back() {
    let case: Value = serde_json::from_str(D01).unwrap();
    let drill = drill(&case);
    for (regression, truth) in [
        (Regression::Constant, CoefficientModel::Constant([150.0, 60.0])),
        (Regression::Rake, CoefficientModel::Rake([[40.0, 110.0], [20.0, 35.0]])),
        (Regression::Reciprocal, CoefficientModel::Reciprocal([[120.0, 900.0], [50.0, 200.0]])),
        (
            Regression::PowerLaw,
            CoefficientModel::PowerLaw([[4.0, -0.1, -0.05, 0.6], [3.0, -0.1, -0.02, 0.4]]),
        ),
    ] {
        let fitting = PlungeFitting { cutter: &drill, regression, with_feed_angle: true, with_chisel: false };
        let fit = fitting.fit(&entries(&fitting, &truth, 0.0)).unwrap();
        let numbers = |model: &CoefficientModel| match model {
            CoefficientModel::Constant(k) => k.to_vec(),
            CoefficientModel::Rake(k) | CoefficientModel::Reciprocal(k) => k.concat(),
            CoefficientModel::Chip(k) => k.concat(),
            CoefficientModel::PowerLaw(k) => k.concat(),
        };
        for (found, expected) in numbers(&fit.model).iter().zip(numbers(&truth)) {
            assert!(
                (found - expected).abs() < 1e-5 * expected.abs().max(1.0),
                "{regression:?}: {:?}",
                fit.model
            );
        }
        // with noise the intervals hold the truth
        let noisy = fitting.fit(&entries(&fitting, &truth, 0.02)).unwrap();
        let held =
            noisy.estimates.iter().zip(numbers(&truth)).filter(|([v, h], t)| (v - t).abs() < 1.5 * h).count();
        assert_eq!(held, noisy.estimates.len(), "{regression:?}: {:?}", noisy.estimates);
    }
}

#[test]
fn logs_that_cannot_tell_are_refused() {
    let case: Value = serde_json::from_str(D01).unwrap();
    let drill = drill(&case);
    let fitting =
        |regression| PlungeFitting { cutter: &drill, regression, with_feed_angle: true, with_chisel: false };
    let truth = CoefficientModel::Constant([150.0, 60.0]);
    let all = entries(&fitting(Regression::Constant), &truth, 0.01);
    // the full lips at one feed and speed: many rows, one number
    let row = PlungeInstant { depth_mm: 2.0, ..all[39] };
    let found = fitting(Regression::Rake).fit(&[row; 50]);
    assert!(matches!(found, Err(PlungeFitError::Alike { .. })), "{found:?}");
    let air = PlungeInstant { depth_mm: -1.0, ..row };
    assert_eq!(
        fitting(Regression::Rake).fit(&[air; 50]),
        Err(PlungeFitError::TooFew { found: 0, needed: 3 })
    );
    let mut broken = all.clone();
    broken[7].thrust_n = f64::NAN;
    assert_eq!(fitting(Regression::Rake).fit(&broken), Err(PlungeFitError::Row { row: 7 }));
    broken[7] = PlungeInstant { feed_mm_rev: 9.0, ..all[7] };
    assert!(matches!(fitting(Regression::Rake).fit(&broken), Err(PlungeFitError::Cutter(_))));
}

proptest! {
    /// The force normal to the rake face and the friction along it are perpendicular, for any drill.
    #[test]
    fn force_directions_are_orthonormal(
        point_deg in 30.0f64..89.0, helix_deg in 0.0f64..40.0, web_mm in 0.0f64..0.5, f in 0.0f64..0.2,
    ) {
        let spec = TwistDrillSpec {
            radius_mm: 1.25, point_deg, helix_deg, chisel_deg: 116.0, web_mm, lips: 2, flute_mm: 10.0,
        };
        let Ok(drill) = TwistDrill::new(spec) else { return Ok(()) };
        let Ok(edges) = drill.edges(f, 8) else { return Ok(()) };
        for element in &edges.elements {
            let [n, t] = force_directions(element);
            prop_assert!(n.dot(&t).abs() < 1e-14 && (n.norm() - 1.0).abs() < 1e-14 && (t.norm() - 1.0).abs() < 1e-14);
            // both resist the turn of a lip
            prop_assert!(element.kind == crate::cutter::EdgeKind::Chisel || n.y < 0.0);
        }
    }
}
