//! `bonemill case`: a plan in two commands without an editor, and what cannot be told is refused with the labels.

use std::fs;

use bonemill_planner::case::{Case, LabelRef, Registration, Target};
use serde_json::Value;

use crate::support::body;
use crate::support::image::Stored;
use crate::support::place::{Place, Ran};

/// The names of the healthy body's labels.
const NAMES: &str = "{\"Mastoid cavity\": 20, \"facial_nerve\": 7}";

/// The healthy body without a case, with names.
fn named() -> Place {
    let place = Place::healthy();
    fs::remove_file(place.path("case.toml")).unwrap();
    fs::write(place.path("labels.json"), NAMES).unwrap();
    place
}

/// Makes a case with these further arguments.
fn make(place: &Place, more: &[&str]) -> Ran {
    place.run(&[&["case", "ct.nii", "labels.nii", "--out", "case.toml"], more].concat())
}

fn read(place: &Place) -> Case {
    let path = place.path("case.toml");
    Case::parse(&fs::read_to_string(&path).unwrap(), &path).unwrap()
}

/// Checks that a case is refused and that no file is written or changed.
#[track_caller]
fn refuses(place: &Place, more: &[&str], parts: &[&str]) {
    let before = place.files();
    let ran = make(place, more);
    ran.refused(parts);
    assert!(before == place.files(), "the folder is changed");
}

#[test]
fn two_commands_make_a_plan_of_a_phantoms_images() {
    let place = Place::empty();
    assert_eq!(place.run(&["phantom", "--kind", "block", "--out", "block"]).code, 0);
    fs::remove_file(place.path("block/case.toml")).unwrap();
    fs::create_dir(place.path("cases")).unwrap();
    let made = place.run(&["case", "block/ct.nii.gz", "block/labels.nii.gz", "--out", "cases/mine.toml"]);
    assert_eq!(made.code, 0, "{}{}", made.out, made.err);
    for part in ["facial nerve", "target", "3375.0", "spares facial_nerve", "bonemill plan cases/mine.toml"] {
        assert!(made.out.contains(part), "{part}: {}", made.out);
    }
    // as a preview, which takes half the time
    let text = fs::read_to_string(place.path("cases/mine.toml")).unwrap();
    fs::write(place.path("cases/mine.toml"), text + "\n[accuracy]\nlevel = \"coarse\"\n").unwrap();
    let planned = place.run(&["plan", "cases/mine.toml", "--out", "plan", "--json"]);
    assert_eq!(planned.code, 0, "{}{}", planned.out, planned.err);
    let object: Value = serde_json::from_str(&planned.out).unwrap();
    let share = object["metrics"]["removed_share"].as_f64().unwrap();
    assert!(share > 0.9, "{share}");
}

#[test]
fn labels_are_listed_and_the_case_names_its_images_from_its_own_folder() {
    let place = named();
    fs::create_dir(place.path("a b")).unwrap();
    let ran = place.run(&["case", "ct.nii", "labels.nii", "--out", "a b/case.toml", "--json"]);
    assert_eq!((ran.code, ran.err.as_str()), (0, ""));
    let object: Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!(object["outcome"], "done");
    let figures = &object["figures"];
    assert_eq!((&figures["target_label"], &figures["side"]), (&20.into(), &Value::Null));
    let nerve = &figures["labels"][0];
    assert_eq!((&nerve["number"], &nerve["taken_for"]), (&7.into(), &"facial nerve".into()));
    // 2 × 12 × 2 voxels of 0.5 mm
    assert_eq!(nerve["volume_mm3"], 6.0);
    let path = place.path("a b/case.toml");
    let case = Case::parse(&fs::read_to_string(&path).unwrap(), &path).unwrap();
    assert_eq!(case.images.ct.to_str(), Some("../ct.nii"));
    assert_eq!(case.target, Target::Label(LabelRef::Name("Mastoid cavity".into())));
}

#[test]
fn what_no_name_tells_is_refused_until_it_is_named() {
    let place = Place::healthy();
    fs::remove_file(place.path("case.toml")).unwrap();
    refuses(
        &place,
        &[],
        &["no label's name tells the target", "--target NAME|NUMBER", "the labels are 7, 20"],
    );
    refuses(&place, &["--target", "9"], &["--target", "no label \"9\"", "7, 20"]);
    refuses(&place, &["--target", "20", "--structure", "20"], &["label 20 is given twice"]);
    let ran = make(&place, &["--target", "20"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(ran.out.contains("warning: label 7 is not known by its name: it is not spared"), "{}", ran.out);
    assert!(ran.out.contains("warning: no label is taken for something to spare"), "{}", ran.out);
    assert_eq!(read(&place).structures, []);
    let ran = make(&place, &["--target", "20", "--structure", "7", "--force"]);
    assert!(ran.code == 0 && !ran.out.contains("warning"), "{}{}", ran.out, ran.err);
    assert_eq!(read(&place).structures[0].label, LabelRef::Number(7));
    let ball = ["--target-ball-mm", "-1", "0.5", "12", "3", "--ignore", "7", "--ignore", "20", "--force"];
    assert_eq!(make(&place, &ball).code, 0);
    let Target::Ball { center_mm, radius_mm } = read(&place).target else { panic!() };
    assert_eq!((<[f64; 3]>::from(center_mm), radius_mm), ([-1.0, 0.5, 12.0], 3.0));
}

#[test]
fn masks_of_single_structures_are_named_by_their_files() {
    let place = named();
    let only = |keep: f32| {
        let mut labels = body::labels();
        labels.values.iter_mut().for_each(|value| *value = if *value == keep { 20.0 } else { 0.0 });
        labels.bytes(Stored::Unsigned16)
    };
    fs::write(place.path("labels.nii"), only(body::TARGET)).unwrap();
    fs::write(place.path("labels.json"), "{\"target\": 20}").unwrap();
    fs::write(place.path("Chorda_L.nii"), only(body::NERVE)).unwrap();
    let ran = place.run(&["case", "ct.nii", "labels.nii", "Chorda_L.nii", "--out", "case.toml"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let structure = &read(&place).structures[0];
    assert_eq!((structure.name.as_str(), structure.clearance_mm), ("Chorda_L", 0.5));
    assert_eq!(structure.label, mask("Chorda_L.nii"));
    assert!(ran.out.contains("side left"), "{}", ran.out);
    fs::remove_file(place.path("case.toml")).unwrap();
    let refuses = |more: &[&str], parts: &[&str]| {
        place.run(&[&["case", "ct.nii", "labels.nii", "--out", "case.toml"], more].concat()).refused(parts);
    };
    refuses(&["Chorda_L.nii", "./Chorda_L.nii"], &["Chorda_L.nii is given twice"]);
    refuses(&["labels.nii"], &["labels.nii is given twice"]);
    let mut other = body::labels();
    other.affine[0][3] += 1.0;
    other.values.iter_mut().for_each(|value| *value = if *value > 0.0 { 1.0 } else { 0.0 });
    fs::write(place.path("beside.nii"), other.bytes(Stored::Unsigned16)).unwrap();
    refuses(&["beside.nii"], &["beside.nii", "another spacing or origin", "1.000 mm"]);
    other.values.fill(0.0);
    fs::write(place.path("empty.nii"), other.bytes(Stored::Unsigned16)).unwrap();
    refuses(&["empty.nii"], &["empty.nii"]);
    assert!(!place.path("case.toml").exists());
}

/// A mask in a file of its own.
fn mask(path: &str) -> LabelRef {
    LabelRef::File { path: path.into(), label: None }
}

#[test]
fn a_folder_of_masks_and_a_target_of_its_own_make_a_case_that_is_planned() {
    let place = named();
    let only = |of: &[(f32, f32)]| {
        let mut labels = body::labels();
        let number =
            |value: f32| of.iter().find(|(label, _)| *label == value).map_or(0.0, |(_, number)| *number);
        labels.values.iter_mut().for_each(|value| *value = number(*value));
        labels.bytes(Stored::Unsigned16)
    };
    for name in ["labels.nii", "labels.json"] {
        fs::remove_file(place.path(name)).unwrap();
    }
    fs::create_dir(place.path("masks")).unwrap();
    fs::write(place.path("masks/facial_nerve.nii"), only(&[(body::NERVE, 1.0)])).unwrap();
    fs::write(place.path("masks/skull.nii"), only(&[(body::TARGET, 1.0)])).unwrap();
    fs::write(place.path("my_target.nii"), only(&[(body::TARGET, 1.0)])).unwrap();
    let ran = place.run(&["case", "ct.nii", "masks", "my_target.nii", "--out", "case.toml"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let case = read(&place);
    assert_eq!(case.images.labels.to_str(), Some("masks"));
    assert_eq!(case.target, Target::Label(mask("my_target.nii")));
    assert_eq!(case.structures[0].label, LabelRef::Name("facial_nerve".into()));
    let planned = place.run(&["plan", "case.toml", "--out", "plan"]);
    assert!(planned.code < 2 && planned.out.contains("removed"), "{}{}", planned.out, planned.err);
    // files alone: the first is a mask too; and one file of several labels
    let ran = place.run(&["case", "ct.nii", "masks/facial_nerve.nii", "my_target.nii", "--out", "b.toml"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let text = fs::read_to_string(place.path("b.toml")).unwrap();
    let of_files = Case::parse(&text, &place.path("b.toml")).unwrap();
    assert_eq!(of_files.structures[0].label, mask("masks/facial_nerve.nii"));
    fs::create_dir(place.path("two")).unwrap();
    fs::write(place.path("two/all.nii"), only(&[(body::NERVE, 1.0), (body::TARGET, 2.0)])).unwrap();
    fs::write(place.path("two/labels.json"), "{\"chorda\": 1, \"bone\": 2}").unwrap();
    let ran = place.run(&["case", "ct.nii", "my_target.nii", "two/all.nii", "--out", "c.toml"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let of_two =
        Case::parse(&fs::read_to_string(place.path("c.toml")).unwrap(), &place.path("c.toml")).unwrap();
    let chorda = Some(Box::new(LabelRef::Name("chorda".into())));
    assert_eq!(of_two.structures[0].label, LabelRef::File { path: "two/all.nii".into(), label: chorda });
    assert_eq!(of_two.structures.len(), 1);
}

#[test]
fn a_target_that_touches_a_structure_gives_way_and_is_planned() {
    let place = named().with_labels(|labels| {
        let side = labels.dims[0];
        let is_target = |value: f32| (value - body::TARGET).abs() < 0.5;
        let far = labels
            .values
            .iter()
            .enumerate()
            .filter(|(_, v)| is_target(**v))
            .map(|(n, _)| n % side)
            .max()
            .unwrap();
        let touching =
            labels.values.iter_mut().enumerate().filter(|(n, v)| is_target(**v) && n % side == far);
        touching.for_each(|(_, value)| *value = body::NERVE);
    });
    let ran = make(&place, &[]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(ran.out.contains("taken away from it with a margin: facial_nerve by 1 mm"), "{}", ran.out);
    assert_eq!(read(&place).less.len(), 1);
    let planned = place.run(&["plan", "case.toml", "--out", "plan"]);
    assert!(planned.code < 2 && planned.out.contains("removed"), "{}{}", planned.out, planned.err);
}

#[test]
fn nothing_is_replaced_unasked_and_nothing_that_is_read() {
    let place = named();
    fs::write(place.path("case.toml"), "mine").unwrap();
    refuses(&place, &[], &["case.toml exists", "--force"]);
    assert_eq!(make(&place, &["--force"]).code, 0);
    read(&place);
    for (out, part) in [
        ("ct.nii", "expected a file such as case.toml"),
        ("labels.json", "expected a file such as case.toml"),
        (".", "expected a file such as case.toml"),
        ("gone/case.toml", "gone"),
    ] {
        let before = place.files();
        place.run(&["case", "ct.nii", "labels.nii", "--force", "--out", out]).refused(&[part]);
        assert!(before == place.files(), "{out}");
    }
    let out = ["--out", "b.toml"];
    place.run(&[&["case", "no.nii", "labels.nii"], &out[..]].concat()).refused(&["no.nii"]);
    place.run(&[&["case", "ct.nii", "none.seg.nrrd"], &out[..]].concat()).refused(&["none.seg.nrrd"]);
    place.run(&[&["case", "labels.nii", "labels.nii"], &out[..]].concat()).refused(&["not Hounsfield units"]);
    place.run(&["case", "ct.nii", "--out", "b.toml"]);
    assert!(!place.path("b.toml").exists());
}

#[cfg(unix)]
#[test]
fn a_link_is_not_replaced() {
    let place = named();
    fs::write(place.path("mine"), "text").unwrap();
    std::os::unix::fs::symlink(place.path("mine"), place.path("case.toml")).unwrap();
    make(&place, &["--force"]).refused(&["case.toml is no ordinary file"]);
    assert_eq!(fs::read_to_string(place.path("mine")).unwrap(), "text");
}

#[cfg(unix)]
#[test]
fn a_folder_that_takes_no_file_is_an_error() {
    use std::os::unix::fs::PermissionsExt;
    let place = named();
    let closed = place.path("closed");
    fs::create_dir(&closed).unwrap();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o555)).unwrap();
    if fs::write(closed.join("probe"), "").is_ok() {
        bonemill_geometry::testkit::skipped("this user may write into every folder");
        return;
    }
    place
        .run(&["case", "ct.nii", "labels.nii", "--out", "closed/case.toml"])
        .refused(&["case.toml", "cannot write"]);
}

#[test]
fn points_and_transforms_of_slicer_come_into_the_case_in_ras() {
    let place = named();
    let markups = |points: &str| {
        format!(
            "{{\"markups\": [{{\"type\": \"Line\", \"coordinateSystem\": \"LPS\", \"controlPoints\": [{points}]}}]}}"
        )
    };
    let point = |at: &str| format!("{{\"position\": {at}, \"positionStatus\": \"defined\"}}");
    let line = [point("[-30, -4, 12]"), point("[10, 0, 12]")].join(", ");
    fs::write(place.path("way.mrk.json"), markups(&line)).unwrap();
    let tfm = "#Insight Transform File V1.0\n#Transform 0\nTransform: AffineTransform_double_3_3\n\
        Parameters: 1 0 0 0 1 0 0 0 1 10 20 -30\nFixedParameters: 0 0 0\n";
    fs::write(place.path("T.tfm"), tfm).unwrap();
    let more = ["--approach", "way.mrk.json", "--registration", "T.tfm", "--robot", "ur5e"];
    let ran = make(&place, &more);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let case = read(&place);
    // from inside (-10, 0, 12) to outside (30, 4, 12), RAS
    let direction = case.approach.unwrap();
    assert!(
        (direction * 1616.0_f64.sqrt() - nalgebra::Vector3::new(40.0, 4.0, 0.0)).norm() < 1e-4,
        "{direction}"
    );
    let Registration::Given { translation_mm, .. } = case.robot.base_from_ct else { panic!() };
    assert_eq!(<[f64; 3]>::from(translation_mm), [10.0, 20.0, 30.0]);
    assert_eq!(case.robot.flange_from_burr.unwrap().0, [0.0, 0.0, 180.0]);
    let fcsv = "# Markups fiducial file version = 4.10\n# CoordinateSystem = 0\n# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID\n\
        a,1,2,3,0,0,0,1,1,1,0,F-1,,\nb,4,5,6.5,0,0,0,1,1,1,0,F-2,,\nc,-7,8,9,0,0,0,1,1,1,0,F-3,,\n";
    fs::write(place.path("F.fcsv"), fcsv).unwrap();
    assert_eq!(make(&place, &["--fiducials", "F.fcsv", "--force"]).code, 0);
    let text = fs::read_to_string(place.path("case.toml")).unwrap();
    assert!(text.contains("ct_mm = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.5], [-7.0, 8.0, 9.0]]"), "{text}");
    fs::write(place.path("T.h5"), b"\x89HDF\r\n\x1a\n").unwrap();
    fs::write(place.path("one.mrk.json"), markups(&point("[1, 2, 3]"))).unwrap();
    for (more, part) in [
        (["--registration", "T.h5"], "T.h5: the file: found what cannot be read"),
        (["--approach", "one.mrk.json"], "1 point; expected a line"),
        (["--fiducials", "way.mrk.json"], "2 points; expected at least three"),
        (["--fiducials", "T.tfm"], "T.tfm: line"),
        (["--approach", "gone.mrk.json"], "gone.mrk.json: cannot be read"),
    ] {
        refuses(&place, &[&more[..], &["--force"]].concat(), &[part]);
    }
}
