//! A case file as people write and mistype it.

use std::path::Path;

use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;

/// The least that is a case.
const LEAST: &str =
    "structure = []\n[images]\nct = \"ct.nii.gz\"\nlabels = \"labels.nii.gz\"\n[target]\nlabel = 20\n";

fn parse(text: &str) -> Result<Case, CaseError> {
    Case::parse(text, Path::new("case.toml"))
}

/// The message for the least case with `more` after it.
fn refusal(more: &str) -> String {
    let text = format!("{LEAST}{more}");
    parse(&text).map(|c| c.to_toml()).expect_err("should be refused").to_string()
}

#[test]
fn the_least_case_has_every_documented_default() {
    let case = parse(LEAST).unwrap();
    assert!(!case.paper && case.structures.is_empty() && case.approach.is_none());
    assert_eq!(case.density.air_hu, -700.0);
    assert_eq!(case.density.bone_hu, 200.0);
    assert_eq!(case.density.table.hu(), [-1000.0, -400.0, -150.0, 100.0, 300.0, 2000.0, 4927.0]);
    assert_eq!(case.density.table.g_cm3(), [0.01, 0.602, 0.924, 1.075, 1.145, 1.856, 3.379]);
    let Burr { radius_mm, flutes, spindle_rpm, spin, turns_both_ways, neck_radius_mm } = case.burr;
    assert!(!turns_both_ways);
    assert_eq!((radius_mm, flutes, spindle_rpm, spin, neck_radius_mm), (2.5, 8, 60_000.0, -1, 1.1));
    let shank: Vec<_> = case.shank.iter().map(|s| (s.length_mm, s.radius_mm)).collect();
    assert_eq!(shank, [(25.0, 1.1), (60.0, 6.0)]);
    assert_eq!(case.material.k_n_mm2, [1400.0, 840.0, 140.0]);
    assert_eq!(case.material.k_edge_n_mm, [0.0; 3]);
    assert_eq!((case.material.rho_ref_g_cm3, case.material.exponent, case.material.t0_mm), (0.8, 1.0, 0.0));
    assert_eq!(case.material.measure, Measure::Db);
    let PathSpec { layer_mm, stepover_mm, step_mm, raster_rad, sense } = case.path;
    assert_eq!((layer_mm, stepover_mm, step_mm, raster_rad), (1.5, 2.0 / 3.0 * 2.5, 0.25, None));
    assert_eq!(sense, Sense::Auto);
    assert_eq!(
        (case.cost.kappa_per_mm, case.cost.alpha_max, case.cost.force),
        (0.7, 0.8, ForceTerm::Cutting)
    );
    assert_eq!(case.orientation.mode, OrientationMode::Optimal);
    assert_eq!(case.orientation.tilt_limit_rad, 60f64.to_radians());
    assert_eq!(case.speed.mode, SpeedMode::LeastForce);
    let s = &case.speed;
    assert_eq!(
        (s.min_mm_s, s.max_mm_s, s.nominal_mm_s, s.link_mm_s, s.total_time_s),
        (0.5, 4.0, 1.5, 10.0, None)
    );
    assert_eq!((case.robot.model.as_str(), case.robot.rate_hz), ("bone-attached", 500.0));
    assert_eq!(case.robot.base_from_ct, Registration::Assumed);
    assert_eq!((case.grid.spacing_mm, case.grid.margin_mm), (0.25, 3.0));
}

#[test]
fn the_paper_preset_changes_defaults_and_nothing_that_stands_in_the_file() {
    let text = format!("preset = \"paper\"\n{LEAST}");
    let case = parse(&text).unwrap();
    assert!(case.paper);
    assert_eq!((case.material.measure, case.cost.alpha_max), (Measure::Dz, 0.5));
    assert_eq!(case.orientation.mode, OrientationMode::Greedy);
    // one measure's coefficients must not be used with the other
    assert_eq!(case.material.k_n_mm2, [2100.0, 1260.0, 210.0]);
    let own =
        "[material]\nmeasure = \"db\"\nk_t = 500\n[cost]\nalpha_max = 0.9\n[orientation]\nmode = \"fixed\"\n";
    let case = parse(&format!("{text}{own}")).unwrap();
    assert_eq!((case.material.measure, case.cost.alpha_max), (Measure::Db, 0.9));
    assert_eq!(case.orientation.mode, OrientationMode::Fixed);
    assert_eq!(case.material.k_n_mm2, [500.0, 840.0, 140.0]);
}

#[test]
fn stepover_follows_the_radius() {
    let case = parse(&format!("{LEAST}[burr]\nradius_mm = 3\n")).unwrap();
    assert_eq!(case.path.stepover_mm, 2.0);
}

#[test]
fn every_alternative_of_target_and_registration_is_read() {
    let head = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n";
    let target = |t: &str| parse(&format!("{head}[target]\n{t}\n")).unwrap().target;
    assert_eq!(target("label = \"mastoid\""), Target::Label(LabelRef::Name("mastoid".into())));
    let (min_mm, max_mm) = (Vector3::new(0.0, 1.0, 2.0), Vector3::new(3.0, 4.0, 5.5));
    assert_eq!(target("box = { min_mm = [0, 1, 2], max_mm = [3, 4, 5.5] }"), Target::Box { min_mm, max_mm });
    assert_eq!(
        target("ball = { center_mm = [3, 4, 5.5], radius_mm = 6 }"),
        Target::Ball { center_mm: max_mm, radius_mm: 6.0 }
    );
    assert_eq!(
        target(
            "frustum = { from_mm = [0, 1, 2], to_mm = [3, 4, 5.5], from_radius_mm = 6, to_radius_mm = 0 }"
        ),
        Target::Frustum { from_mm: min_mm, to_mm: max_mm, from_radius_mm: 6.0, to_radius_mm: 0.0 }
    );
    let turn = |r: &str| {
        let case = parse(&format!("{LEAST}[robot]\nbase_from_ct = {{ {r}, translation_mm = [1, 2, 3] }}\n"))
            .unwrap();
        let Registration::Given { rotation, translation_mm } = case.robot.base_from_ct else { panic!() };
        assert_eq!(translation_mm, Vector3::new(1.0, 2.0, 3.0));
        rotation
    };
    // a quarter turn about z, three ways; p_base = R p_ct takes x to y
    for r in [
        "rotation = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]",
        "quaternion_wxyz = [0.7071067811865476, 0, 0, 0.7071067811865476]",
        "rpy_rad = [0, 0, 1.5707963267948966]",
    ] {
        assert!((turn(r) * Vector3::x() - Vector3::y()).norm() < 1e-15, "{r}");
    }
    // roll, then pitch, then yaw, about fixed axes: x rolls to itself, pitches to -z, and yaw leaves -z
    let half = std::f64::consts::FRAC_PI_2;
    let rpy = turn(&format!("rpy_rad = [{half}, {half}, {half}]"));
    assert!((rpy * Vector3::x() + Vector3::z()).norm() < 1e-15);
}

/// (what is appended to the least case, what the message must contain)
const REFUSALS: &[(&str, &[&str])] = &[
    // unknown and mistyped keys, wrong units
    (
        "[burr]\nraduis_mm = 2\n",
        &["case.toml:8: ", "unknown key `burr.raduis_mm`", "did you mean `burr.radius_mm`?"],
    ),
    ("[burr]\ncolour = 2\n", &["case.toml:8: unknown key `burr.colour`"]),
    ("[bur]\nradius_mm = 2\n", &["case.toml:7: unknown key `bur`", "`burr`"]),
    ("[burr]\nradius_m = 0.0025\n", &["`burr.radius_m`", "expected `burr.radius_mm`, in mm"]),
    ("[burr]\nradius_um = 2500\n", &["expected `burr.radius_mm`, in mm"]),
    ("[burr]\nradius = 2.5\n", &["expected `burr.radius_mm`, in mm"]),
    ("[path]\nraster_rad = 1\n", &["expected `path.raster_deg`, in degrees"]),
    ("[speed]\nmax_m_s = 1\n", &["expected `speed.max_mm_s`, in mm/s"]),
    // types
    ("[burr]\nradius_mm = \"2.5\"\n", &["`burr.radius_mm` is the text \"2.5\"", "expected a number in mm"]),
    ("[burr]\nflutes = 2.5\n", &["`burr.flutes` is the number 2.5", "whole number"]),
    ("[burr]\nspin = 0\n", &["`burr.spin`", "expected -1 or 1"]),
    ("burr = 3\n", &["unknown key `target.burr`"]),
    ("[approach]\ndirection = [1, 2]\n", &["`approach.direction` has 2 entries; expected 3"]),
    ("[approach]\ndirection = 3\n", &["`approach.direction` is the number 3", "a list of numbers"]),
    ("[shank]\nsegments = [25, 1.1]\n", &["`shank.segments[0]` is the number 25"]),
    ("[shank]\nsegments = [[25, 1.1, 3]]\n", &["`shank.segments[0]` has 3 entries; expected 2"]),
    ("[shank]\nsegments = []\n", &["`shank.segments` has 0 entries"]),
    // not finite
    ("[burr]\nradius_mm = nan\n", &["`burr.radius_mm` = NaN is not a finite number"]),
    ("[approach]\ndirection = [1, inf, 0]\n", &["`approach.direction[1]` = inf is not a finite number"]),
    ("[density]\nhu = [-1000, nan]\ng_cm3 = [0, 1]\n", &["`density.hu[1]`", "not a finite number"]),
    // out of range, and what it looks like
    (
        "[burr]\nradius_mm = 0.0025\n",
        &["= 0.0025: expected 0.2 to 10 mm", "looks like metres, which would be 2.5 here"],
    ),
    ("[burr]\nradius_mm = 2500\n", &["looks like µm, which would be 2.5 here"]),
    (
        "[shank]\nsegments = [[25.0, 1.1], [60.0, 600.0]]\n",
        &["`shank.segments[1][1]` = 600", "looks like µm"],
    ),
    (
        "[shank]\nsegments = [[25.0, 1.1], [60.0, 45.0]]\n",
        &["`shank.segments` = 45 mm: expected at most 30 mm, the thickest handpiece"],
    ),
    ("[speed]\nmin_mm_s = 0.0005\n", &["`speed.min_mm_s` = 0.0005", "looks like m/s"]),
    ("[burr]\nradius_mm = 0\n", &["`burr.radius_mm` = 0: expected 0.2 to 10 mm"]),
    ("[burr]\nradius_mm = -2.5\n", &["`burr.radius_mm` = -2.5: expected"]),
    ("[burr]\nspindle_rpm = 0\n", &["`burr.spindle_rpm` = 0"]),
    ("[burr]\nspindle_rpm = 60\n", &["looks like thousands of rpm, which would be 60000"]),
    ("[burr]\nflutes = 0\n", &["`burr.flutes` = 0"]),
    ("[burr]\nflutes = 99999999999999999999999\n", &["`burr.flutes` = 100000000000000000000000"]),
    ("[path]\nlayer_mm = 0\n", &["`path.layer_mm` = 0"]),
    ("[path]\nstep_mm = -1\n", &["`path.step_mm` = -1"]),
    ("[speed]\nmin_mm_s = 0\n", &["`speed.min_mm_s` = 0"]),
    ("[speed]\nmax_mm_s = 1e9\n", &["`speed.max_mm_s` = 1000000000"]),
    ("[orientation]\ntilt_limit_deg = 91\n", &["expected 0 to 90 degrees"]),
    ("[cost]\nalpha_max = 1.5\n", &["expected 0 to 1"]),
    ("[cost]\nalpha_max = 80\n", &["looks like per cent, which would be 0.8"]),
    ("[cost]\nkappa_per_mm = -0.7\n", &["`cost.kappa_per_mm` = -0.7"]),
    ("[material]\nrho_ref_g_cm3 = 800\n", &["looks like kg/m³, which would be 0.8"]),
    ("[material]\nk_t = 0\n", &["`material.k_t` = 0"]),
    ("[grid]\nspacing_mm = 0\n", &["`grid.spacing_mm` = 0"]),
    ("[robot]\nrate_hz = 0\n", &["`robot.rate_hz` = 0"]),
    ("[robot]\nvelocity_limits = [1, 1, -1, 1]\n", &["`robot.velocity_limits[2]` = -1"]),
    ("[robot]\nvelocity_limits = []\n", &["`robot.velocity_limits` has 0 entries"]),
    ("[robot]\nvelocity_limits = [1, 1]\n", &["has 2 entries; expected 4, one per joint of bone-attached"]),
    // words
    (
        "[material]\nmeasure = \"dB\"\n",
        &["`material.measure` = \"dB\"", "`db` or `dz`", "did you mean `db`?"],
    ),
    ("[path]\npattern = \"spiral\"\n", &["`path.pattern` = \"spiral\"", "`lawnmower`"]),
    // contradictions
    ("[path]\nlayer_mm = 6\n", &["`path.layer_mm` = 6 mm: expected at most 5 mm, twice burr.radius_mm"]),
    ("[path]\nstepover_mm = 6\n", &["`path.stepover_mm` = 6 mm: expected at most 5 mm"]),
    ("[path]\nstep_mm = 3\n", &["`path.step_mm` = 3 mm: expected at most 2.5 mm"]),
    ("[grid]\nspacing_mm = 2\n", &["`grid.spacing_mm` = 2 mm: expected at most 1.25 mm"]),
    ("[burr]\nneck_radius_mm = 2.5\n", &["`burr.neck_radius_mm` = 2.5 mm: expected below 2.5 mm"]),
    (
        "[burr]\nradius_mm = 1.1\n[shank]\nsegments = [[25.0, 0.8]]\n",
        &["`burr.neck_radius_mm` = 1.1 mm (the default): expected below 1.1 mm"],
    ),
    (
        "[shank]\nsegments = [[25.0, 2.4]]\n",
        &["`shank.segments` = 2.4 mm: expected at most 2.375 mm", "less half of grid.spacing_mm"],
    ),
    (
        "[shank]\nsegments = [[25, 2.6]]\n",
        &["`shank.segments` = 2.6 mm: expected at most 2.5 mm", "thicker than the burr"],
    ),
    ("[speed]\nmin_mm_s = 5\n", &["`speed.min_mm_s` = 5 mm/s: expected at most 4 mm/s, speed.max_mm_s"]),
    ("[speed]\nmode = \"constant\"\nnominal_mm_s = 0.2\n", &["expected at least 0.5 mm/s"]),
    ("[density]\nbone_hu = -800\n", &["`density.bone_hu` = -800 HU: expected above -700 HU, density.air_hu"]),
    // tables and geometry
    ("[density]\nhu = [0, 0]\ng_cm3 = [0, 1]\n", &["case.toml:8: `density.hu` and `density.g_cm3`"]),
    ("[density]\nhu = [0, 1]\n", &["`density.g_cm3` is missing"]),
    ("[approach]\ndirection = [0, 0, 0]\n", &["zero vector"]),
    (
        "[robot.base_from_ct]\nrotation = [[1,0,0],[0,1,0],[0,0,-1]]\ntranslation_mm = [0,0,0]\n",
        &["not a rotation"],
    ),
    (
        "[robot.base_from_ct]\nrotation = [[1,0,0],[0,1,0]]\ntranslation_mm = [0,0,0]\n",
        &["has 2 entries; expected 3 rows"],
    ),
    (
        "[robot.base_from_ct]\nquaternion_wxyz = [1,1,0,0]\ntranslation_mm = [0,0,0]\n",
        &["expected a unit quaternion"],
    ),
    (
        "[robot.base_from_ct]\ntranslation_mm = [0,0,0]\n",
        &["`robot.base_from_ct` has none; expected exactly one of"],
    ),
    (
        "[robot.base_from_ct]\nrpy_rad = [0,0,0]\nquaternion_wxyz = [1,0,0,0]\ntranslation_mm = [0,0,0]\n",
        &["has `quaternion_wxyz` and `rpy_rad`"],
    ),
    ("[robot.base_from_ct]\nrpy_rad = [0,0,0]\n", &["`robot.base_from_ct.translation_mm` is missing"]),
    (
        "[robot.base_from_ct]\nfiducials = { ct_mm = [], base_mm = [] }\n",
        &["case.toml:8: ", "`robot.base_from_ct.fiducials.base_mm` has 0 entries", "at least three"],
    ),
    (
        "[robot.flange_from_burr]\nrpy_rad = [0,0,0]\n",
        &["`robot.flange_from_burr.translation_mm` is missing"],
    ),
    // not TOML
    ("[burr\n", &["case.toml:7: not valid TOML"]),
    ("[burr]\nspin = 1\nspin = 1\n", &["case.toml:9: not valid TOML: duplicate key"]),
];

#[test]
fn every_refusal_names_key_line_found_and_expected() {
    for (more, parts) in REFUSALS {
        let message = refusal(more);
        for part in *parts {
            assert!(message.contains(part), "{more:?}\n  gives {message:?}\n  without {part:?}");
        }
        assert!(message.starts_with("case.toml:"), "{message}");
        assert_eq!(message.lines().count(), 1, "one fault, one line: {message}");
    }
}

#[test]
fn all_faults_are_reported_at_once() {
    let message = refusal("[burr]\nradius_mm = 0\nflutes = 0\n[grid]\nspacing = 1\n");
    assert_eq!(message.lines().count(), 3, "{message}");
}

#[test]
fn what_has_no_default_must_be_there() {
    let message = parse("").unwrap_err().to_string();
    for part in
        ["`images.ct` is missing", "`images.labels` is missing", "exactly one of `label`", "structure = []"]
    {
        assert!(message.contains(part), "{message}");
    }
    let two = LEAST.replace("label = 20", "label = 20\nball = { center_mm = [0, 0, 0], radius_mm = 3 }");
    assert!(
        parse(&two)
            .unwrap_err()
            .to_string()
            .contains("`target` has `label` and `ball`; expected exactly one")
    );
    for label in ["0", "-1", "70000", "1.5", "\"\"", "true"] {
        let text = LEAST.replace("20", label);
        assert!(parse(&text).unwrap_err().to_string().contains("case.toml:6: `target.label` is "), "{label}");
    }
    let empty = LEAST.replace("ct.nii.gz", "");
    assert!(parse(&empty).unwrap_err().to_string().contains("case.toml:3: `images.ct` is the text \"\""));
}

#[test]
fn target_shapes_must_have_a_volume() {
    let refuse = |t: &str| parse(&LEAST.replace("label = 20", t)).unwrap_err().to_string();
    let message = refuse("box = { min_mm = [0, 0, 0], max_mm = [1, -1, 1] }");
    assert!(message.contains("case.toml:6: `target.box.max_mm` = -1 mm: expected above 0 mm"), "{message}");
    assert!(refuse("ball = { center_mm = [0, 0, 0], radius_mm = 0.006 }").contains("looks like metres"));
    assert!(refuse("ball = { radius_mm = 6 }").contains("`target.ball.center_mm` is missing"));
    assert!(
        refuse("box = { min_mm = [0, 0, 0], maxmm = [1, 1, 1] }")
            .contains("did you mean `target.box.max_mm`?")
    );
    let frustum = |to, r| {
        refuse(&format!(
            "frustum = {{ from_mm = [0, 0, 0], to_mm = {to}, from_radius_mm = {r}, to_radius_mm = 0 }}"
        ))
    };
    assert!(frustum("[0, 0, 0]", 3).contains("the frustum's length"));
    assert!(frustum("[0, 0, 9]", 0).contains("the wider of the frustum's two radii"));
}

#[test]
fn structures_are_told_apart() {
    let s = |name: &str, label: u32, more: &str| {
        format!("[[structure]]\nname = \"{name}\"\nlabel = {label}\n{more}")
    };
    let text = |s: &[String]| LEAST.replace("structure = []\n", "") + &s.concat();
    let case = parse(&text(&[s("a", 1, ""), s("b", 2, "clearance_mm = 0\npriority = 7\n")])).unwrap();
    assert_eq!((case.structures[0].clearance_mm, case.structures[0].priority), (1.0, 1));
    assert_eq!((case.structures[1].clearance_mm, case.structures[1].priority), (0.0, 7));
    let refuse = |s: &[String]| parse(&text(s)).unwrap_err().to_string();
    let message = refuse(&[s("a", 1, ""), s("a", 2, "")]);
    assert!(
        message.contains("case.toml:10: `structure[1].name` = \"a\" stands already in `structure[0].name`"),
        "{message}"
    );
    assert!(refuse(&[s("a", 20, "")]).contains("`structure[0].label` = 20 stands already in `target.label`"));
    assert!(refuse(&[s("a", 1, "clearance_mm = -1\n")]).contains("`structure[0].clearance_mm` = -1"));
    assert!(refuse(&[s("a", 1, "priority = 0\n")]).contains("`structure[0].priority` = 0"));
    assert!(refuse(&[s("a,b", 1, "")]).contains("without commas"));
    assert!(refuse(&["[[structure]]\nname = \"a\"\n".into()]).contains("`structure[0].label` is missing"));
}

#[test]
fn the_line_of_a_key_is_found() {
    let text = "structure = [\n  { name = \"a\",\n label = 3 } ]\n[burr]\nradius_mm = 2\n";
    for (key, line) in [("burr.radius_mm", 5), ("structure[0].name", 2), ("burr", 4)] {
        assert_eq!(Case::line_of(text, key), Some(line), "{key}");
    }
    assert_eq!(Case::line_of(text, "burr.spin"), None);
    assert_eq!(Case::line_of(text, "burr.radius_mm.more"), None);
}

/// Numbers as a file may hold them: short decimals and full doubles.
fn number(min: f64, max: f64) -> impl Strategy<Value = f64> {
    prop_oneof![min..=max, (min..=max).prop_map(move |v| ((v * 100.0).round() / 100.0).clamp(min, max))]
}

fn vector() -> impl Strategy<Value = String> {
    prop::array::uniform3(number(-200.0, 200.0)).prop_map(|v| format!("{v:?}"))
}

fn target_text() -> impl Strategy<Value = String> {
    prop_oneof![
        (1u16..).prop_map(|n| format!("label = {n}")),
        Just("label = \"mastoid \\\"left\\\" \\\\ µ\"".to_owned()),
        (vector(), number(0.5, 200.0))
            .prop_map(|(c, r)| format!("ball = {{ center_mm = {c}, radius_mm = {r:?} }}")),
        (vector(), number(0.5, 9.0)).prop_map(|(c, r)| format!(
            "frustum = {{ from_mm = {c}, to_mm = [999.0, 0, 0], from_radius_mm = {r:?}, to_radius_mm = 0 }}"
        )),
        vector().prop_map(|c| format!("box = {{ min_mm = {c}, max_mm = [999.0, 999, 999] }}")),
    ]
}

fn registration_text() -> impl Strategy<Value = String> {
    let rotation = prop_oneof![
        prop::array::uniform3(-3.0..3.0).prop_map(|r: [f64; 3]| format!("rpy_rad = {r:?}")),
        prop::array::uniform4(-1.0..1.0).prop_filter_map("zero", |q: [f64; 4]| {
            let n = q.iter().map(|v| v * v).sum::<f64>().sqrt();
            (n > 0.1).then(|| format!("quaternion_wxyz = {:?}", q.map(|v| v / n)))
        }),
        prop::array::uniform3(-3.0..3.0).prop_map(|r: [f64; 3]| {
            // rounded, so that the nearest rotation has to be taken
            let m =
                nalgebra::Rotation3::new(Vector3::from(r)).into_inner().map(|v| f64::round(v * 1e5) / 1e5);
            let row = |n: usize| [m[(n, 0)], m[(n, 1)], m[(n, 2)]];
            format!("rotation = {:?}", [row(0), row(1), row(2)])
        }),
    ];
    (rotation, vector()).prop_map(|(r, t)| format!("base_from_ct = {{ {r}, translation_mm = {t} }}"))
}

prop_compose! {
    fn case_text()(
        paper in any::<bool>(), target in target_text(), registration in prop::option::of(registration_text()),
        direction in prop::option::of(vector()), radius in number(2.3, 9.0), raster in prop::option::of(number(-360.0, 360.0)),
        tilt in number(0.0, 90.0), clearances in prop::collection::vec(number(0.0, 50.0), 0..4),
        k in number(0.1, 5000.0), total in prop::option::of(number(0.1, 9e5)), mount in prop::option::of((vector(), -3.0..3.0f64)),
        limits in prop::option::of(prop::array::uniform4(number(0.1, 100.0))), affine in prop::sample::select(vec!["auto", "sform", "qform"]),
    ) -> String {
        let mut text = if paper { "preset = \"paper\"\n".to_owned() } else { String::new() };
        if clearances.is_empty() {
            text += "structure = []\n";
        }
        text += &format!("[images]\nct = \"a b/ct.nii\"\nlabels = \"l\\\\é.nii\"\nct_affine = \"{affine}\"\n[target]\n{target}\n");
        for (n, c) in clearances.iter().enumerate() {
            text += &format!("[[structure]]\nname = \"s{n}\"\nlabel = \"l{n}\"\nclearance_mm = {c:?}\n");
        }
        if let Some(d) = direction { text += &format!("[approach]\ndirection = {d}\n"); }
        text += &format!("[burr]\nradius_mm = {radius:?}\n[material]\nk_t = {k:?}\n[orientation]\ntilt_limit_deg = {tilt:?}\n");
        if let Some(r) = raster { text += &format!("[path]\nraster_deg = {r:?}\n"); }
        if let Some(t) = total { text += &format!("[speed]\ntotal_time_s = {t:?}\n"); }
        text += "[robot]\n";
        if let Some(r) = registration { text += &(r + "\n"); }
        if let Some((t, a)) = mount { text += &format!("flange_from_burr = {{ translation_mm = {t}, rpy_rad = [{a:?}, 0, 1] }}\n"); }
        if let Some(l) = limits { text += &format!("jerk_limits = {l:?}\n"); }
        text
    }
}

proptest! {
    #[test]
    fn a_written_case_reads_back_equal(text in case_text()) {
        let case = parse(&text).map_err(|e| TestCaseError::fail(format!("{e}\n{text}")))?;
        let written = case.to_toml();
        let again = parse(&written).map_err(|e| TestCaseError::fail(format!("{e}\n{written}")))?;
        prop_assert_eq!(&again, &case);
        prop_assert_eq!(again.to_toml(), written);
    }

    #[test]
    fn no_text_makes_it_panic(text in "[\\[\\]{}=\"a-z_.0-9 \n,-]{0,200}", more in case_text(), cut in 0usize..600) {
        let _ = parse(&text).map_err(|e| e.to_string());
        let cut: String = more.chars().take(cut).chain(text.chars()).collect();
        let _ = parse(&cut).map_err(|e| e.to_string());
    }
}

#[test]
fn the_shared_mastoidectomy_case_parses() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let data = std::env::var_os("BONEMILL_DATA").map_or_else(|| root.join("../shared/data"), Into::into);
    let file = data.join("tbone_RT143/case.toml");
    let Ok(text) = std::fs::read_to_string(&file) else {
        bonemill_geometry::testkit::skipped(format!("{} is not there", file.display()));
        return;
    };
    let case = Case::parse(&text, &file).unwrap();
    assert_eq!((case.structures.len(), case.burr.radius_mm), (8, 2.0));
}

#[test]
fn a_choice_that_lacks_what_it_needs_is_refused_at_its_line() {
    let deflection = "[cost]\nforce = \"deflection\"\n";
    let message = refusal(deflection);
    assert!(message.starts_with("case.toml:8: `robot.joint_stiffness` is missing"), "{message}");
    let stiff = format!("{LEAST}{deflection}[robot]\njoint_stiffness = [1e3, 1e3, 1e3, 1e6]\n");
    assert!(parse(&stiff).is_ok());
    let message = refusal("[speed]\ndeflection_um = 20\nmode = \"force_limited\"\n");
    assert!(message.contains(":8: `robot.joint_stiffness` is missing"), "{message}");
    let message = refusal("[speed]\nforce_n = 1.5\nmode = \"mass\"\n");
    assert!(
        message.contains(":8: `speed.force_n` cannot hold") && message.contains("force_limited"),
        "{message}"
    );
    let message = refusal("[orientation]\nangles = 2\n");
    assert!(message.contains(":8: ") && message.contains("one tilt"), "{message}");
    let message = refusal("[speed]\nmode = \"force_limited\"\nforce_toward_n = [[2, 0.5], [1, 0.4]]\n");
    assert!(message.contains(":9: ") && message.contains("rising distances"), "{message}");
}

#[test]
fn force_caps_default_to_the_papers_peaks_and_bind_only_where_asked() {
    let case = parse(&format!("{LEAST}[speed]\nmode = \"force_limited\"\nforce_n = 2.5\n")).unwrap();
    let caps = &case.speed.caps;
    assert_eq!((caps.force_n, caps.power_w, caps.deflection_um), (Some(2.5), None, None));
    let toward = caps.force_toward_n.as_ref().unwrap();
    assert_eq!([1.0, 4.0, 9.0].map(|mm| (toward.at(mm) * 1e3).round()), [800.0, 1250.0, 1700.0]);
    assert_eq!(Case::parse(&case.to_toml(), Path::new("again.toml")).unwrap(), case);
    let plain = parse(LEAST).unwrap();
    assert!(plain.speed.caps.force_n.is_none() && plain.speed.caps.force_toward_n.is_none());
    assert_eq!((plain.orientation.angles, plain.cost.structures), (1, SeveralStructures::Nearest));
}

#[test]
fn fiducials_are_read_and_written_and_stand_alone() {
    let points = "[[0, 0, 0], [40, 0, 5.25], [0, 50, -3]]";
    let text = format!(
        "{LEAST}[robot]\nbase_from_ct = {{ fiducials = {{ ct_mm = {points}, base_mm = {points} }} }}\n"
    );
    let case = parse(&text).unwrap();
    let Registration::Fiducials { ct_mm, base_mm } = &case.robot.base_from_ct else { panic!() };
    assert_eq!((ct_mm[1], base_mm.len()), ([40.0, 0.0, 5.25], 3));
    assert_eq!(parse(&case.to_toml()).unwrap(), case);
    let both = text.replace("fiducials =", "translation_mm = [0, 0, 0], fiducials =");
    let error = parse(&both).unwrap_err().to_string();
    assert!(error.contains("fiducials") && error.contains("exactly one"), "{error}");
}

#[test]
fn a_series_is_written_by_its_name_whatever_the_case_gives() {
    let of = |series: &str| LEAST.replace("[images]", &format!("[images]\nct_series = \"{series}\""));
    for given in ["1.2.3.9", "902425018327"] {
        let text = parse(&of(given)).unwrap().to_toml();
        assert!(text.contains("ct_series = \"902425018327\"") && !text.contains("1.2.3"), "{text}");
    }
}
