//! `plan.toml` is written and read back, and its inputs are changed.

use super::*;

const CASE: &str = "structure = []\n[images]\nct = \"images/ct.nii.gz\"\nlabels = \"labels.nii.gz\"\n[target]\nlabel = 20\n[path]\nraster_deg = 33\n";

/// A case in `root/data`. Its images are arbitrary bytes, because these tests do not read them.
fn case_dir(root: &Path) -> PathBuf {
    let dir = root.join("data");
    std::fs::create_dir_all(dir.join("images")).unwrap();
    std::fs::write(dir.join("case.toml"), CASE).unwrap();
    std::fs::write(dir.join("images/ct.nii.gz"), "ct").unwrap();
    std::fs::write(dir.join("labels.nii.gz"), "labels").unwrap();
    dir
}

pub(crate) fn record(root: &Path) -> PlanRecord {
    let data = case_dir(root);
    let input = |path: &str| Input::now(&data, Path::new(path)).unwrap();
    let turn = Rotation3::new(Vector3::new(0.3, -0.2, 0.9));
    PlanRecord {
        version: "0.1.0".into(),
        case: Case::parse(CASE, Path::new("case.toml")).unwrap(),
        case_file: PathBuf::from("../data/case.toml"),
        inputs: vec![input("case.toml"), input("images/ct.nii.gz"), input("labels.nii.gz")],
        frames: PlanFrames {
            approach_direction: Vector3::new(0.6, 0.0, 0.8),
            ct_from_approach: Rigid::new(turn, Vector3::new(1.0, 2.0, 1.0 / 3.0)),
            grid: PlanningGrid { dims: [40, 30, 20], turn_rad: -0.1 },
            base_from_ct: Rigid::new(turn.inverse(), Vector3::new(-0.5, 1e-9, 7.0)),
            registration_assumed: true,
            flange_from_burr: ([0.0, 0.0, 120.0], [0.0, 0.1, 0.2]),
        },
        metrics: Metrics {
            removed_mm3: 100.5,
            reachable_mm3: 101.0,
            target_mm3: 200.0 / 3.0,
            removed_material_mm3: 90.0,
            removed_bone_mm3: 80.0,
            total_time_s: 321.0,
            more: vec![
                ("waypoints".into(), Value::Integer(1234)),
                (
                    "seconds_by_kind".into(),
                    Value::Table(vec![("retract".into(), 1.5.into()), ("cut".into(), 300.0.into())]),
                ),
            ],
        },
        modelled: vec![
            ("compliance".into(), Value::Flag(false)),
            ("why not \"so\"".into(), Value::List(vec!["no stiffness".into(), 1.0.into()])),
            ("nothing".into(), Value::Table(vec![])),
        ],
        warnings: vec!["registration assumed".into(), "two\nlines, a \"quote\" and \\".into()],
        shortfalls: vec![],
    }
}

pub(crate) fn written() -> (tempfile::TempDir, PathBuf, PlanRecord) {
    let root = tempfile::tempdir().unwrap();
    let plan = root.path().join("plan");
    std::fs::create_dir(&plan).unwrap();
    let record = record(root.path());
    record.write(&plan).unwrap();
    (root, plan, record)
}

#[test]
fn what_is_written_reads_back_equal_and_rewrites_to_the_same_bytes() {
    let (_root, plan, record) = written();
    let again = PlanRecord::read(&plan).unwrap();
    assert_eq!(again, record);
    let given = |record: &PlanRecord| record.case.given.keys().map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(given(&again), given(&record));
    assert!(record.case.given.holds("images.ct") && !again.case.given.holds("burr.flutes"));
    assert_eq!(again.to_toml().unwrap(), record.to_toml().unwrap());
}

#[test]
fn the_tables_of_the_design_are_there() {
    let (_root, plan, _) = written();
    let text = std::fs::read_to_string(plan.join("plan.toml")).unwrap();
    for part in [
        "\n[case]\n",
        "\n[case.burr]\nradius_mm = 2.5\n",
        "\n[inputs]\n\"case.toml\" = \"",
        "\n\"images/ct.nii.gz\" = \"",
        "\n[input_bytes]\n\"case.toml\" = ",
        "\n\"images/ct.nii.gz\" = 2\n",
        "\n[metrics]\nremoved_mm3 = 100.5\n",
        "\ntotal_time_s = 321.0\nwaypoints = 1234\nseconds_by_kind = { retract = 1.5, cut = 300.0 }\n",
        "\n[modelled]\ncompliance = false\n",
    ] {
        assert!(text.contains(part), "{part:?} is not in\n{text}");
    }
}

#[test]
fn a_plan_that_does_not_list_its_inputs_is_refused() {
    let (_root, plan, mut record) = written();
    record.inputs.remove(1);
    record.write(&plan).unwrap();
    let e = PlanRecord::read(&plan).unwrap_err();
    assert!(e.to_string().contains("does not list `images/ct.nii.gz`"), "{e}");
}

#[test]
fn a_damaged_record_names_the_key() {
    let (_root, plan, record) = written();
    let good = record.to_toml().unwrap();
    let damage = |from: &str, to: &str, part: &str| {
        assert!(good.contains(from), "{from}");
        std::fs::write(plan.join("plan.toml"), good.replacen(from, to, 1)).unwrap();
        let e = PlanRecord::read(&plan).unwrap_err();
        let cause = std::error::Error::source(&e).map(ToString::to_string).unwrap_or_default();
        let message = format!("{e}: {cause}");
        assert!(message.contains("plan.toml") && message.contains(part), "{from} -> {to}: {message}");
    };
    damage("version = \"0.1.0\"", "", "`version`: expected a text");
    damage("removed_mm3 = 100.5", "removed_mm3 = nan", "`metrics`");
    damage("removed_mm3 = 100.5", "", "`metrics.removed_mm3`");
    damage("removed_mm3 = 100.5", "removed_mm3 = \"much\"", "`metrics.removed_mm3`");
    damage("registration = \"assumed\"", "registration = \"guessed\"", "`frames.registration`");
    damage("approach_direction = [0.6, ", "approach_direction = [", "`frames.approach_direction`");
    damage("dims = [40, 30, 20]", "dims = [40, 30, 0]", "`frames.grid.dims`");
    damage("dims = [40, 30, 20]", "dims = [40, 30.5, 20]", "`frames.grid.dims`");
    damage("turn_rad = -0.1", "turn_rad = inf", "`frames.grid.turn_rad`");
    damage("radius_mm = 2.5", "radius_mm = 0.0", "`case.burr.radius_mm` = 0");
    damage("[modelled]", "[modeled]", "`modelled`: expected a table");
    damage("[frames]", "[frames", "not valid TOML");
    let digest = record.inputs[0].sha256.to_string();
    damage(&digest, &digest[1..], "`inputs`");
}

#[test]
fn a_figure_that_is_not_finite_is_not_written() {
    let (_root, plan, mut record) = written();
    record.metrics.more.push(("x".into(), Value::Table(vec![("y_n".into(), f64::NAN.into())])));
    let e = record.write(&plan).unwrap_err();
    assert!(e.to_string().contains("`x.y_n` is NaN"), "{e}");
    // the old one is still there
    assert!(PlanRecord::read(&plan).is_ok());
}
