//! The command's exit codes, the contents of its output streams, and that bad input writes nothing.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use bonemill_geometry::Stage;

struct Place(tempfile::TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Names in the folder, including hidden ones.
    fn names(&self) -> Vec<String> {
        names(self.0.path())
    }

    fn run(&self, args: &[&str]) -> Ran {
        let mut command = Command::new(env!("CARGO_BIN_EXE_bonemill"));
        let Output { status, stdout, stderr } =
            command.args(args).current_dir(self.0.path()).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        Ran { code: status.code().unwrap(), out: text(stdout), err: text(stderr) }
    }
}

struct Ran {
    code: i32,
    out: String,
    err: String,
}

impl Ran {
    /// Checks for exit code 2 and one error that contains `parts`.
    #[track_caller]
    fn refused(&self, parts: &[&str]) {
        assert_eq!(self.code, 2, "{}{}", self.out, self.err);
        assert_eq!(self.err.matches("error:").count(), 1, "told once: {}", self.err);
        for part in parts {
            assert!(self.err.contains(part), "{part:?} is not in {}", self.err);
        }
        for trace in ["panicked", "RUST_BACKTRACE", "Stack backtrace", "Some(", "{ "] {
            assert!(!self.err.contains(trace), "{trace:?} in {}", self.err);
        }
    }
}

fn names(dir: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(dir).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const CASE: &str =
    "structure = []\n[images]\nct = \"ct.nii.gz\"\nlabels = \"labels.nii.gz\"\n[target]\nlabel = 20\n";

#[test]
fn a_phantom_is_a_case_with_its_images() {
    let place = Place::new();
    let ran = place.run(&["phantom", "--kind", "block", "--seed", "3", "--out", "block"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(ran.out.starts_with("wrote ") && ran.out.contains("block phantom, seed 3"), "{}", ran.out);
    assert_eq!(names(&place.path("block")), ["case.toml", "ct.nii.gz", "labels.json", "labels.nii.gz"]);
    assert_eq!(place.names(), ["block"]);
    let case = fs::read_to_string(place.path("block/case.toml")).unwrap();
    let case = bonemill_planner::case::Case::parse(&case, Path::new("case.toml")).unwrap();
    assert_eq!(case.structures[0].name, "facial_nerve");
    bonemill_imaging::read_ct(place.path("block/ct.nii.gz"), case.images.ct_affine).unwrap();
    bonemill_imaging::read_labels(place.path("block/labels.nii.gz"), case.images.labels_affine).unwrap();
    let names = bonemill_imaging::read_label_names(place.path("block/labels.json")).unwrap().unwrap();
    assert_eq!(names.number("target"), Some(20));
}

#[test]
fn the_temporal_phantoms_case_parses() {
    let phantom = bonemill_imaging::phantom::phantom(bonemill_imaging::phantom::PhantomKind::Temporal, 1);
    let case = bonemill_planner::case::Case::parse(&phantom.case_toml, Path::new("case.toml")).unwrap();
    assert_eq!(case.structures.len(), 5);
}

#[test]
fn the_same_seed_gives_the_same_bytes_on_any_number_of_threads() {
    let place = Place::new();
    for (threads, out) in [("1", "a"), ("2", "b")] {
        let ran =
            place.run(&["phantom", "--kind", "block", "--seed", "7", "--out", out, "--threads", threads]);
        assert_eq!(ran.code, 0, "{}", ran.err);
    }
    for file in names(&place.path("a")) {
        let bytes = |dir: &str| fs::read(place.path(dir).join(&file)).unwrap();
        assert!(bytes("a") == bytes("b"), "{file}");
    }
}

#[test]
fn json_is_one_object_and_quiet_is_silence() {
    let place = Place::new();
    let ran = place.run(&["phantom", "--kind", "block", "--out", "a", "--json"]);
    assert_eq!((ran.code, ran.err.as_str()), (0, ""));
    let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!(object["outcome"], "done");
    assert!(object["stage_seconds"]["write phantom"].as_f64().unwrap() >= 0.0);
    assert_eq!(ran.out.lines().count(), 1);
    let ran = place.run(&["phantom", "--kind", "block", "--out", "b", "--quiet"]);
    assert_eq!((ran.code, ran.out.as_str(), ran.err.as_str()), (0, "", ""));
    // without a terminal progress is printed as plain lines on stderr
    let ran = place.run(&["phantom", "--kind", "block", "--out", "c"]);
    assert_eq!(ran.err, "make phantom\nwrite phantom\n");
    // an error is also a JSON object, and is printed on stderr too
    let ran = place.run(&["plan", "nowhere.toml", "--out", "p", "--json"]);
    ran.refused(&["nowhere.toml"]);
    let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!(object["outcome"], "error");
}

#[test]
fn a_phantom_replaces_nothing() {
    let place = Place::new();
    fs::create_dir(place.path("mine")).unwrap();
    fs::write(place.path("mine/thesis.tex"), "text").unwrap();
    place.run(&["phantom", "--kind", "block", "--out", "mine"]).refused(&["mine", "is not empty"]);
    assert_eq!(names(&place.path("mine")), ["thesis.tex"]);
    assert_eq!(place.names(), ["mine"]);
}

#[test]
fn a_case_that_cannot_be_read_is_refused_with_its_cause() {
    let place = Place::new();
    let ran = place.run(&["plan", "nowhere.toml", "--out", "plan"]);
    ran.refused(&["error: cannot read the case nowhere.toml\n", "because: No such file"]);
    fs::write(place.path("case.toml"), [0xff, 0xfe, 0x00]).unwrap();
    place.run(&["plan", "case.toml", "--out", "plan"]).refused(&["cannot read the case case.toml"]);
    assert_eq!(place.names(), ["case.toml"]);
}

#[test]
fn a_bad_case_is_refused_by_file_line_and_key_and_nothing_is_written() {
    let place = Place::new();
    for (more, parts) in [
        (
            "[burr]\nraduis_mm = 2\n",
            ["case.toml:8: unknown key `burr.raduis_mm`", "did you mean `burr.radius_mm`?"],
        ),
        ("[burr]\nradius_mm = 0.0025\n", ["case.toml:8: `burr.radius_mm` = 0.0025", "looks like metres"]),
        ("[burr]\nradius_mm = 2500\n", ["case.toml:8: `burr.radius_mm` = 2500", "looks like µm"]),
        ("[path]\nlayer_mm = -1\n", ["case.toml:8: `path.layer_mm` = -1", "expected 0.05 to 20 mm"]),
        ("[speed]\nmin_mm_s = 0\n", ["case.toml:8: `speed.min_mm_s` = 0", "expected 0.01 to 1000 mm/s"]),
        (
            "[shank]\nsegments = [[25, 3]]\n",
            ["case.toml:8: `shank.segments` = 3 mm", "thicker than the burr"],
        ),
        ("[speed]\nmode = \"fast\"\n", ["case.toml:8: `speed.mode` = \"fast\"", "`mass` or `constant`"]),
    ] {
        fs::write(place.path("case.toml"), format!("{CASE}{more}")).unwrap();
        place.run(&["plan", "case.toml", "--out", "plan"]).refused(&parts);
        assert_eq!(place.names(), ["case.toml"]);
    }
}

#[test]
fn missing_images_are_named_with_their_key() {
    let place = Place::new();
    fs::write(place.path("case.toml"), CASE).unwrap();
    place.run(&["plan", "case.toml", "--out", "plan"]).refused(&[
        "case.toml:3: `images.ct`",
        "ct.nii.gz",
        "No such file",
    ]);
    assert_eq!(place.names(), ["case.toml"]);
}

#[test]
fn an_output_that_is_not_a_plan_is_never_touched() {
    let place = Place::new();
    fs::create_dir(place.path("mine")).unwrap();
    fs::write(place.path("mine/thesis.tex"), "text").unwrap();
    fs::write(place.path("file"), "text").unwrap();
    for out in ["mine", "file"] {
        let ran = place.run(&["plan", "--phantom", "block", "--out", out]);
        ran.refused(&[out, "exists and is not a plan"]);
    }
    assert_eq!(names(&place.path("mine")), ["thesis.tex"]);
    assert_eq!(place.names(), ["file", "mine"]);
}

#[test]
fn a_full_disk_is_bad_input_and_leaves_nothing() {
    let place = Place::new();
    let disk = place.path("disk");
    fs::create_dir(&disk).unwrap();
    let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=64k", "none"]).arg(&disk).output();
    if !mounted.is_ok_and(|o| o.status.success()) {
        bonemill_geometry::testkit::skipped("a small disk cannot be mounted here");
        return;
    }
    let phantom = place.run(&["phantom", "--kind", "block", "--out", "disk/block", "--quiet"]);
    let plan = place.run(&["plan", "--phantom", "block", "--out", "disk/plan", "--quiet"]);
    let left = names(&disk);
    let unmounted = Command::new("umount").arg(&disk).status().unwrap();
    assert!(unmounted.success() && left.is_empty(), "{left:?}");
    phantom.refused(&["ct.nii.gz", "No space left"]);
    plan.refused(&["ct.nii.gz", "No space left"]);
}

#[test]
fn a_folder_that_cannot_be_written_is_bad_input() {
    if !Path::new("/proc/sys").exists() {
        bonemill_geometry::testkit::skipped("there is no /proc here");
        return;
    }
    // not even root can make a folder there
    let ran = Place::new().run(&["phantom", "--kind", "block", "--out", "/proc/sys/block", "--quiet"]);
    ran.refused(&["error: cannot write into /proc/sys", "because: "]);
}

#[test]
fn wrong_arguments_exit_with_2() {
    let place = Place::new();
    for args in [
        &["plan", "--out", "p"][..],
        &["plan", "c.toml", "--phantom", "block", "--out", "p"],
        &["phantom", "--kind", "skull", "--out", "p"],
        &["phantom", "--kind", "block"],
        &["plan", "c.toml", "--out", "p", "--threads", "0"],
        &["simulate", "p"],
        &[],
    ] {
        let ran = place.run(args);
        assert_eq!(ran.code, 2, "{args:?}: {}", ran.err);
        assert!(!ran.err.contains("panicked"), "{args:?}: {}", ran.err);
    }
    assert!(place.names().is_empty());
}

#[test]
fn a_full_disk_or_a_closed_pipe_behind_standard_output_is_an_error() {
    let place = Place::new();
    let case = place.run(&["phantom", "--kind", "tibia", "--out", "tibia", "--quiet"]);
    assert_eq!(case.code, 0, "{}", case.err);
    assert_eq!(place.run(&["plan", "tibia/case.toml", "--out", "plan", "--quiet"]).code, 0);
    let full = || std::fs::OpenOptions::new().write(true).open("/dev/full");
    if full().is_err() {
        bonemill_geometry::testkit::skipped("there is no /dev/full here");
        return;
    }
    for args in [
        &["keys"][..],
        &["columns"],
        &["--help"],
        &["--version"],
        &["compare", "plan", "plan"],
        &["compare", "plan", "plan", "--json"],
        &["verify", "plan"],
        &["verify", "plan", "--json"],
        &["plan", "tibia/case.toml", "--out", "plan", "--json"],
        &["phantom", "--kind", "tibia", "--out", "other"],
        &["plan", "nowhere.toml", "--out", "p", "--json"],
        &["plan", "--json"],
    ] {
        // a pipe of which nobody reads the other end
        let (reader, closed) = std::io::pipe().unwrap();
        drop(reader);
        for (out, says) in [
            (full().unwrap().into(), "No space left"),
            (Into::<std::process::Stdio>::into(closed), "Broken pipe"),
        ] {
            let mut command = Command::new(env!("CARGO_BIN_EXE_bonemill"));
            let ran = command.args(args).current_dir(place.0.path()).stdout(out).output().unwrap();
            let said = String::from_utf8(ran.stderr).unwrap();
            assert_eq!(ran.status.code(), Some(2), "{args:?}: {said}");
            assert!(
                said.contains("error: cannot write to standard output") && said.contains(says),
                "{args:?}: {said}"
            );
            let _ = fs::remove_dir_all(place.path("other"));
        }
    }
    // what is to be written is written all the same, and silence has nothing to lose
    assert!(place.path("plan/verification.toml").exists() || place.path("plan/plan.toml").exists());
    let mut quiet = Command::new(env!("CARGO_BIN_EXE_bonemill"));
    let quiet = quiet.args(["compare", "plan", "plan", "--quiet"]).current_dir(place.0.path());
    assert_eq!(quiet.stdout(full().unwrap()).status().unwrap().code(), Some(0));
}

#[test]
fn wrong_arguments_are_an_object_with_json() {
    let place = Place::new();
    for (args, says) in [
        (&["plan", "--json"][..], "required arguments were not provided"),
        (
            &["--json", "phantom", "--kind", "skull", "--out", "p"],
            "invalid value 'skull' for '--kind <KIND>'",
        ),
        (
            &["verify", "p", "--json", "--samples", "-5"],
            "invalid value '-5' for '--samples <N>': -5 is not in 1..=1000000",
        ),
        (&["nothing", "--json"], "unrecognized subcommand 'nothing'"),
    ] {
        let ran = place.run(args);
        ran.refused(&[says]);
        let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
        assert_eq!(object["outcome"], "error");
        let error = object["error"].as_str().unwrap();
        assert!(error.contains(says) && !error.starts_with("error:"), "{error}");
        assert_eq!(ran.out.lines().count(), 1);
    }
    // without it, and where help was asked for, there is none
    assert_eq!(place.run(&["plan"]).out, "");
    assert!(place.run(&["plan", "--help", "--json"]).out.starts_with("Plan a case"));
}

#[test]
fn a_negative_number_is_a_value_and_not_an_option() {
    let place = Place::new();
    for (args, says) in [
        (&["verify", "p", "--samples", "-5"][..], "-5 is not in 1..=1000000"),
        (
            &["phantom", "--kind", "block", "--out", "p", "--seed", "-1"],
            "invalid value '-1' for '--seed <SEED>'",
        ),
        (&["plan", "c.toml", "--out", "p", "--threads", "-2"], "-2 is not in 1..=1024"),
        (
            &["stock", "add", "A", "--size-mm", "1", "2", "3", "--count", "-1"],
            "invalid value '-1' for '--count <COUNT>'",
        ),
    ] {
        let ran = place.run(args);
        ran.refused(&[says]);
        assert!(!ran.err.contains("tip:"), "{}", ran.err);
    }
}

#[test]
fn the_command_that_a_phantom_prints_runs_as_written() {
    let place = Place::new();
    for (out, folder) in [("tibia", "tibia"), ("a 'foam' block", "it")] {
        let ran = place.run(&["phantom", "--kind", "tibia", "--out", out]);
        let next = ran.out.trim_end().split_once("; next: bonemill ").unwrap().1;
        let script = format!("'{}' {next}", env!("CARGO_BIN_EXE_bonemill"));
        // from a folder of its own, as one would from a shell elsewhere
        fs::create_dir(place.path(&format!("from-{folder}"))).unwrap();
        let mut shell = Command::new("sh");
        let ran =
            shell.args(["-c", &script]).current_dir(place.path(&format!("from-{folder}"))).output().unwrap();
        assert!(ran.status.success(), "{script}: {}", String::from_utf8_lossy(&ran.stderr));
        assert!(place.path(&format!("{out}-plan/plan.toml")).exists(), "{script}");
    }
}

#[test]
fn the_folder_in_which_the_command_runs_is_not_replaced() {
    let place = Place::new();
    for args in [
        &["phantom", "--kind", "block", "--out", "."][..],
        &["plan", "--phantom", "tibia", "--out", "."],
        &["plan", "--phantom", "tibia", "--out", "../"],
        &["prosthesis", "--phantom", "prosthesis", "--out", "."],
    ] {
        place.run(args).refused(&["is the folder in which this runs, or holds it", "choose another folder"]);
    }
    assert!(place.names().is_empty());
}

/// The first time that each stage is told, in order.
fn stages(said: &str) -> Vec<&str> {
    let mut found: Vec<&str> = Vec::new();
    let told = ["takes about", "will fall short", "fell short"];
    let stages = said.lines().filter(|line| !told.iter().any(|told| line.starts_with(told)));
    stages.for_each(|line| {
        if !found.contains(&line) {
            found.push(line)
        }
    });
    found
}

#[test]
fn the_stages_that_a_job_announces_are_those_that_run() {
    use bonemill_planner::stages::{
        CHANNEL, DRAW_ERRORS, PHANTOM, PLAN, READ_PLAN, SIMULATE, SIMULATE_CHANNEL, VERIFY, VERIFY_CHANNEL,
        WRITE_FILES, WRITE_VERDICT,
    };
    let listed = |of: &[&'static [Stage]]| {
        of.iter().flat_map(|of| of.iter()).map(|(name, _)| *name).collect::<Vec<_>>()
    };
    let place = Place::new();
    assert_eq!(stages(&place.run(&["phantom", "--kind", "block", "--out", "block"]).err), listed(&[PHANTOM]));
    let case = fs::read_to_string(place.path("block/case.toml")).unwrap();
    // a coarse plan of a small part
    let case = case
        .replace("label = 20                       #", "ball = { center_mm = [0, 0, -2], radius_mm = 4 } #");
    let case =
        case.replace("step_mm = 0.25 ", "step_mm = 1.0 ").replace("spacing_mm = 0.25 ", "spacing_mm = 0.5 ");
    fs::write(place.path("block/case.toml"), case).unwrap();
    let ran = place.run(&["plan", "block/case.toml", "--out", "milled"]);
    assert_eq!(stages(&ran.err), listed(&[PLAN, &[WRITE_FILES]]), "{}", ran.out);
    let ran = place.run(&["plan", "--phantom", "tibia", "--out", "drilled"]);
    assert_eq!(stages(&ran.err), listed(&[PHANTOM, CHANNEL, &[WRITE_FILES]]));
    for (plan, checked, replayed) in
        [("milled", VERIFY, SIMULATE), ("drilled", VERIFY_CHANNEL, SIMULATE_CHANNEL)]
    {
        let ran = place.run(&["verify", plan, "--samples", "2"]);
        let said: Vec<_> =
            stages(&ran.err).into_iter().filter(|line| !line.starts_with("fell short")).collect();
        assert_eq!(said, listed(&[&[READ_PLAN], checked, DRAW_ERRORS, &[WRITE_VERDICT]]));
        let ran = place.run(&["simulate", plan, "--step-mm", "1"]);
        assert_eq!(stages(&ran.err), listed(&[&[READ_PLAN], replayed, &[WRITE_FILES]]));
    }
}

#[test]
fn the_case_files_keys_are_printed() {
    let ran = Place::new().run(&["keys"]);
    assert_eq!(ran.code, 0);
    assert_eq!(
        ran.out,
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/case.md")).unwrap()
    );
}
