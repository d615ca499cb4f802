//! The reference cases: kinds a (analytic fields), v (voxel fields), m (volumes, cost and speed, removal rate).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stderr)] // a test's helpers are tests

mod support;

use bonemill_arm::arm::compliance_mm_per_n;
use bonemill_geometry::{Grid, Point, Volume, Work};
use bonemill_planner::ball::ball_box_volume;
use bonemill_planner::burr::{
    AtPoints, BurrForce, Discretisation, ElementGrid, Feed, ForceKernel, Material, Tool, burr_force,
};
use bonemill_planner::cost::{CostModel, Proximity, Ranked, SeveralStructures};
use bonemill_planner::cutter::Ball;
use bonemill_planner::engagement::{Increments, mass_increments};
use bonemill_planner::metrics::engagement_metrics;
use bonemill_planner::path::{MoveKind, PathPoint};
use bonemill_planner::simulate::{Engagement, ForceModel, Lumped, LumpedForm};
use bonemill_planner::speed::{Smoothing, SpeedModel, SpeedProfile};
use nalgebra::{Matrix3, Matrix3xX, Unit, Vector3};
use serde_json::Value;
use support::{Case, cases, number, numbers, three, vector};

fn force_of(case: &Case, disc: &Discretisation) -> BurrForce {
    let field = case.field();
    burr_force(|p| field.density(p), &case.tool(), &case.material(), disc, &case.motion())
}

fn force_cases() -> impl Iterator<Item = Case> {
    cases("a").into_iter().chain(cases("v"))
}

/// Asserts |found − expected| ≤ tolerance·scale for every component.
#[expect(clippy::too_many_arguments, reason = "what is compared, and what a failure says")]
fn close(case: &str, what: &str, found: &[f64], expected: &Value, tolerance: f64, scale: f64) {
    let expected = if expected.is_array() { numbers(expected) } else { vec![number(expected)] };
    assert_eq!(found.len(), expected.len(), "{case} {what}");
    for (f, e) in found.iter().zip(&expected) {
        assert!(
            (f - e).abs() <= tolerance * scale,
            "{case} {what}: {f} not {e}, off by {:e} of {scale:e}",
            f - e
        );
    }
}

#[test]
fn discrete_sums_agree_to_1e_10() {
    for case in force_cases() {
        let f = force_of(&case, &case.disc());
        let e = &case.json["expected"]["discrete"];
        let tol = 1e-10;
        let check =
            |what: &str, found: &[f64], scale: f64| close(&case.name, what, found, &e[what], tol, scale);
        let (force, moment) = (vector(&e["F"]).norm(), vector(&e["M"]).norm());
        check("F", f.force_n.as_slice(), force);
        check("F_tool", f.force_tool_n.as_slice(), force);
        check("M", f.moment_nmm.as_slice(), moment);
        check("M_tool", f.moment_tool_nmm.as_slice(), moment);
        check("F_peak", &[f.peak_force_n], force);
        let scalars = [
            ("torque", f.torque_nmm),
            ("power_spindle", f.spindle_power_mw),
            ("power_feed", f.feed_power_mw),
            ("mrr", f.mrr_mm3_s),
            ("mrr_w", f.weighted_mrr_mm3_s),
            ("contact_area", f.contact_area_mm2),
            ("t_max", f.t_max_mm),
        ];
        for (what, found) in scalars {
            check(what, &[found], number(&e[what]).abs());
        }
        for (what, found) in [("basis_cut", f.basis_cut_mm2), ("basis_edge", f.basis_edge_mm)] {
            // a component that vanishes by symmetry is known only to the rounding of the others
            let scale = (0..3).map(|m| vector(&e[what][m]).norm()).fold(0.0, f64::max);
            for (m, row) in found.iter().enumerate() {
                close(&case.name, what, row.as_slice(), &e[what][m], tol, scale);
            }
        }
    }
}

/// The factored kernel and the plain sum use the same nodes.
#[test]
fn the_kernel_agrees_with_the_sum_to_1e_12() {
    for case in force_cases() {
        let (field, motion, disc) = (case.field(), case.motion(), case.disc());
        let literal = force_of(&case, &disc);
        let speed = motion.velocity_mm_s().norm();
        if speed == 0.0 {
            assert_eq!(literal.force_n, Vector3::zeros());
            continue;
        }
        let kernel = ForceKernel::new(&case.tool(), &case.material(), &disc);
        let feed = Unit::new_normalize(motion.velocity_mm_s());
        let material = case.material();
        let at = |n: &Vector3<f64>| field.density(motion.center() + n * kernel.sample_radius_mm());
        let fast = kernel.engaged_force(
            &motion.axis(),
            &Feed::new(&feed, speed, motion.spindle_rpm()),
            &mut AtPoints(|n: &Vector3<f64>| material.weight(at(n))),
        );
        let scale = literal.force_n.norm();
        assert!((fast.force_n(speed) - literal.force_n).norm() <= 1e-12 * scale, "{}", case.name);
        assert!((fast.torque_nmm(speed) - literal.torque_nmm).abs() <= 1e-12 * literal.torque_nmm);
        assert!((fast.mrr_mm2 * speed - literal.mrr_mm3_s).abs() <= 1e-12 * literal.mrr_mm3_s);
        let weighted = literal.weighted_mrr_mm3_s;
        assert!((fast.weighted_mrr_mm2 * speed - weighted).abs() <= 1e-12 * weighted);
    }
}

fn kappa_grid(case: &Case, n_gamma: usize, n_kappa: usize) -> Discretisation {
    Discretisation::new(n_gamma, n_kappa, ElementGrid::Kappa, case.measure()).unwrap()
}

/// At 512 × 1024 nodes every case lies within its stated error + 1e-4 |F| of the continuum (an edge of sharp bone within
/// 1.5e-3 |F|); at 64 × 128 every voxel case without an edge term within 2e-3 |F|, at 96 × 192 within 1e-3 |F|. Sharp slots
/// are tested against closed forms instead.
#[test]
fn converged_values_agree_within_their_error() {
    for case in force_cases() {
        let e = &case.json["expected"]["converged"];
        let (expected, error) = (vector(&e["F"]), number(&e["F_abs_err"]));
        let tool = case.tool();
        let (motion, field, material) = (case.motion(), case.field(), case.material());
        let speed = motion.velocity_mm_s().norm();
        if case.name.starts_with("a08") || speed == 0.0 {
            continue;
        }
        let feed = Unit::new_normalize(motion.velocity_mm_s());
        let at = |n_gamma, n_kappa| {
            let kernel = ForceKernel::new(&tool, &material, &kappa_grid(&case, n_gamma, n_kappa));
            let weight =
                |n: &Vector3<f64>| material.weight(field.density(motion.center() + n * tool.radius_mm()));
            kernel
                .engaged_force(
                    &motion.axis(),
                    &Feed::new(&feed, speed, motion.spindle_rpm()),
                    &mut AtPoints(weight),
                )
                .force_n(speed)
        };
        let azimuths = |n: usize| n.div_ceil(tool.blades() as usize);
        let within = |n_psi: usize, n_kappa: usize, part: f64| {
            let off = (at(azimuths(n_psi), n_kappa) - expected).norm();
            let allowed = error + part * expected.norm();
            assert!(off <= allowed, "{} at {n_kappa} × {n_psi}: {off:e} of {:e}", case.name, expected.norm());
        };
        within(1024, 512, if material.has_edge() { 1.5e-3 } else { 1e-4 });
        if case.name.starts_with('v') && !material.has_edge() {
            within(128, 64, 2e-3);
            within(192, 96, 1e-3);
        }
    }
}

/// Uniform bone against the closed forms; slots as uniform bone under a burr that ends at the slot's edge.
#[test]
fn closed_forms_agree() {
    for case in cases("a") {
        let Some(e) = case.json["expected"].get("closed_form") else { continue };
        let (mut tool, mut field) = (case.tool(), case.field());
        if case.name.starts_with("a08") {
            let depth = 1.25;
            tool = tool.clone().with_kappa(0.0, (1.0 - depth / tool.radius_mm()).acos()).unwrap();
            field = support::Field::Uniform(0.8);
        }
        let disc = kappa_grid(&case, 64, 256);
        let f = burr_force(|p| field.density(p), &tool, &case.material(), &disc, &case.motion());
        let expected = vector(&e["F"]);
        assert!((f.force_n - expected).norm() < 1e-4 * expected.norm(), "{}: {}", case.name, f.force_n);
        assert!((f.torque_nmm / number(&e["torque"]) - 1.0).abs() < 1e-4, "{}", case.name);
        if let Some(mrr) = e.get("mrr") {
            assert!((f.mrr_mm3_s / number(mrr) - 1.0).abs() < 1e-4);
        }
    }
}

#[test]
fn metrics_agree_to_1e_11() {
    for case in cases("v") {
        let e = &case.json["expected"]["metrics"];
        let (field, motion) = (case.field(), case.motion());
        let m = engagement_metrics(field.voxels(), motion.center(), &motion.axis(), case.tool().radius_mm());
        assert_eq!(m.voxels, voxels_in_reach(&case), "{}", case.name);
        let values = [
            ("V", m.volume_mm3),
            ("m", m.mass_mg),
            ("I", m.inertia_mg_mm2),
            ("In", m.inertia_normalised),
            ("I_true", m.true_inertia_mg_mm2),
            ("In_true", m.true_inertia_normalised),
            ("z2_mean", m.z2_mean_mm2),
        ];
        for (what, found) in values {
            close(&case.name, what, &[found], &e[what], 1e-11, number(&e[what]).abs());
        }
    }
}

/// Number of voxels whose box comes nearer to the centre than the radius. In some cases `n_vox` also counts boxes beyond it,
/// whose volume is only a rounding error.
fn voxels_in_reach(case: &Case) -> usize {
    let (field, center, r) = (case.field(), case.motion().center(), case.tool().radius_mm());
    let grid = field.voxels().grid();
    let near = |n: usize| {
        let p = (grid.center(grid.voxel(n)) - center).abs() - 0.5 * grid.spacing_mm();
        p.sup(&Vector3::zeros()).norm() < r
    };
    (0..grid.len()).filter(|&n| near(n)).count()
}

#[test]
fn volumes_agree_to_4e_15() {
    for case in cases("m01") {
        let boxes = case.json["boxes"].as_array().unwrap();
        let expected = numbers(&case.json["expected"]["V"]);
        assert_eq!(boxes.len(), expected.len());
        let radius = number(&case.json["radius"]);
        for (b, e) in boxes.iter().zip(expected) {
            let [x0, y0, z0, x1, y1, z1] = numbers(b).try_into().unwrap();
            let found = ball_box_volume(radius, [x0, y0, z0], [x1, y1, z1]);
            assert!((found - e).abs() < 4e-15, "{b}: {found} not {e}");
        }
    }
}

#[test]
fn costs_agree_to_1e_11() {
    for case in cases("m02") {
        let p = &case.json["inputs"]["params"];
        let model = CostModel::new(number(&p["kappa_alpha"]), number(&p["a_max"])).unwrap();
        let inputs = case.json["inputs"]["cost"].as_array().unwrap();
        for (n, (input, e)) in
            inputs.iter().zip(case.json["expected"]["cost"].as_array().unwrap()).enumerate()
        {
            let mut push = vector(&input["F"]);
            if let Some(rows) = input.get("J") {
                let columns = rows[0].as_array().unwrap().len();
                let entry = |r: usize, c: usize| number(&rows[r][c]);
                push = compliance_mm_per_n(&Matrix3xX::from_fn(columns, entry), &numbers(&input["k"])) * push;
            }
            let to_nearest = vector(&input["u"]) * number(&input["rv"]);
            let proximity = Proximity::new(to_nearest, number(&p["rv_min"])).unwrap();
            let terms = model.terms(&[Ranked { proximity, priority: 1 }], SeveralStructures::Nearest);
            let found = terms.cost(&push, number(&input["In"]), number(&input["m"]));
            let values = [
                ("C", found.cost),
                ("Fv", found.toward),
                ("frac", found.fraction),
                ("alpha1", found.alpha_1),
            ];
            for (what, value) in values {
                close(&format!("cost {n}"), what, &[value], &e[what], 1e-13, 1.0);
            }
        }
    }
}

#[test]
fn speeds_agree_to_1e_11() {
    for case in cases("m02") {
        let inputs = case.json["inputs"]["velocity"].as_array().unwrap();
        for (input, e) in inputs.iter().zip(case.json["expected"]["velocity"].as_array().unwrap()) {
            let p = &input["params"];
            assert_eq!(numbers(&p["window"]), [1.0, 2.0, 3.0, 2.0, 1.0]);
            let model = SpeedModel::new(
                number(&p["v_min"]),
                number(&p["v_max"]),
                number(&p["m_min"]),
                Smoothing::Average,
            )
            .unwrap();
            let (m, c, ds) = (numbers(&input["m"]), numbers(&input["C"]), numbers(&input["ds"]));
            let profile: SpeedProfile = match p["mode"].as_str().unwrap() {
                "centre" => model.centred(&m, &c).unwrap(),
                "time" => model.in_time(&m, &c, &ds, number(&p["T"])).unwrap(),
                other => panic!("mode {other}"),
            };
            close("speed", "k_vel", &[profile.k_vel.unwrap()], &e["k_vel"], 1e-11, 6.0);
            close("speed", "v_clamped", &profile.clamped_mm_s, &e["v_clamped"], 1e-11, 1.0);
            close("speed", "v", &profile.speed_mm_s, &e["v"], 1e-11, 1.0);
            close("speed", "time", &[profile.time_s(&ds)], &e["time"], 1e-11, 13.0);
        }
    }
}

/// F_t = K_t MRR/f and F_r = K_r F_t, by the model that simulates; the swept volume by the masses that a plan counts.
#[test]
fn removal_rates_agree() {
    for case in cases("m03") {
        let (inputs, expected) = (&case.json["inputs"], &case.json["expected"]);
        let (i, e) = (&inputs["force"], &expected["force"]);
        let (rate, feed_mm_s) = (number(&i["VR"]) / number(&i["T"]), number(&i["f"]));
        let met = Engagement {
            tool_axes: Matrix3::identity(),
            feed: Vector3::x_axis(),
            speed_mm_s: feed_mm_s,
            spindle_rpm: 60_000.0,
            cut: Vec::new(),
            edge: Vec::new(),
            toward_bone_mm2: Vector3::x(),
            mrr_mm2: rate / feed_mm_s,
            weighted_mrr_mm2: rate / feed_mm_s,
            contact_area_mm2: 1.0,
            by_kind_per_mm: Default::default(),
        };
        let form = LumpedForm::AsPrinted { k_t_n_mm2: number(&i["Kt"]), k_r: number(&i["Kr"]) };
        let force_n = Lumped::new(Tool::new(1.0, 2, -1).unwrap(), form).unwrap().force(&met).force_n;
        close("mrr", "Ft", &[force_n.yz().norm()], &e["Ft"], 1e-13, 1.0);
        close("mrr", "Fr", &[-force_n.x], &e["Fr"], 1e-13, 1.0);

        let i = &inputs["swept"];
        let f = &i["field"];
        let dims = three(&f["shape"]).map(|d| d as usize);
        let grid =
            Grid::<Work>::new(dims, vector(&f["spacing"]), Matrix3::identity(), Vector3::zeros()).unwrap();
        let solid = Volume::new(grid.clone(), vec![1f32; grid.len()]).unwrap();
        // a plan's grid begins at zero
        let [from, to] = ["c0", "c1"].map(|key| vector(&i[key]) - vector(&f["origin"]));
        let steps = ((to - from).norm() / number(&i["max_step"])).ceil() as usize;
        let place = |n: usize| PathPoint {
            position: Point::from_coords(from + (to - from) * (n as f64 / steps as f64)),
            kind: MoveKind::Cut,
            layer: 0,
            leads_to: (0, 0),
        };
        let points: Vec<PathPoint> = (0..=steps).map(place).collect();
        let moments = mass_increments(&solid, &points, Ball { radius_mm: number(&i["r"]) }).at_end;
        // of density 1 mg/mm³; the first ball was there before
        let swept_mm3: f64 = moments[1..].iter().map(|m| m.mass_mg()).sum();
        close("mrr", "swept_VR", &[swept_mm3], &expected["swept_VR"], 1e-9, 1.0);
    }
}

/// A long move over a ridge removes it on its way; the same way in steps removes it at their ends, but for the cusps between two.
#[test]
fn what_a_long_move_removes_before_its_end_is_told() {
    let grid =
        Grid::<Work>::new([40, 12, 10], Vector3::from_element(0.2), Matrix3::identity(), Vector3::zeros())
            .unwrap();
    let ridge = (0..grid.len()).map(|n| if (18..=22).contains(&(n % 40)) { 1f32 } else { 0.0 }).collect();
    let ridge = Volume::new(grid, ridge).unwrap();
    let (from, to) = (Point::new(1.0, 1.1, 1.4), Point::new(7.0, 1.1, 1.4));
    let removed = |steps: usize| {
        let place = |n: usize| PathPoint {
            position: from + (to - from) * (n as f64 / steps as f64),
            kind: MoveKind::Link,
            layer: 0,
            leads_to: (0, 0),
        };
        let points: Vec<PathPoint> = (0..=steps).map(place).collect();
        let Increments { at_end, on_the_way_mg } = mass_increments(&ridge, &points, Ball { radius_mm: 1.0 });
        (at_end.iter().map(|m| m.mass_mg()).sum::<f64>(), on_the_way_mg)
    };
    let (at_end_mg, on_the_way_mg) = removed(1);
    // a ridge 1 mm wide, and of the disc of radius 1 mm about z = 1.4 what lies within z < 1.9
    let disc_mm2 = std::f64::consts::PI - (0.5f64.acos() - 0.5 * 0.75f64.sqrt());
    assert!(at_end_mg == 0.0 && on_the_way_mg[0] == 0.0);
    assert!((on_the_way_mg[1] / disc_mm2 - 1.0).abs() < 0.02, "{} mg of {disc_mm2}", on_the_way_mg[1]);
    let (at_end_mg, on_the_way_mg) = removed(40);
    assert!((at_end_mg / disc_mm2 - 1.0).abs() < 0.02, "{at_end_mg} mg of {disc_mm2}");
    assert!(on_the_way_mg.iter().sum::<f64>() < 0.01 * disc_mm2);
}

/// The material of the paper's preset scales with density as the weights of the sum do.
#[test]
fn weight_follows_the_density_law() {
    let m = Material::new([1.0; 3], 0.8).unwrap().with_density_law(2.0, 0.1).unwrap();
    assert_eq!((m.weight(0.1), m.weight(-3.0)), (0.0, 0.0));
    assert!((m.weight(1.6) - 4.0).abs() < 1e-15);
}
