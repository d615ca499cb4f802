//! Labels that are absent, misnamed, used twice or beside the CT are refused or told; a target that gives way to structures, and
//! what a case adds and takes away.

use std::fs;

use serde_json::Value;

use crate::support::body;
use crate::support::image::Image;
use crate::support::place::Place;

#[test]
fn a_label_that_is_not_in_the_map_is_refused_with_those_that_are() {
    let place = Place::healthy().with_case("label = 20", "label = 21");
    place.refuses(&[&place.line_of("label = 21"), "target.label", "label 21", "7, 20"]);
    let place = Place::healthy().with_case("label = 7", "label = 8");
    place.refuses(&[&place.line_of("label = 8"), "structure[0].label", "label 8", "'nerve'", "7, 20"]);
}

#[test]
fn a_label_name_needs_the_list_of_names() {
    let named = || Place::healthy().with_case("label = 7", "label = \"facial_nerve\"");
    let place = named();
    place.refuses(&[
        &place.line_of("facial_nerve"),
        "structure[0].label",
        "the label \"facial_nerve\" is a name, but there is no ",
        "labels.json: give the label's number",
    ]);
    let with_names = |text: &str| {
        let place = named();
        fs::write(place.path("labels.json"), text).unwrap();
        place
    };
    let place = with_names("{\"Facial_nerv\": 7, \"dura\": 20}");
    place.refuses(&[
        &place.line_of("facial_nerve"),
        "labels.json has no \"facial_nerve\"; did you mean \"Facial_nerv\"? it has: Facial_nerv, dura",
    ]);
    let place = with_names("{\"bone\": 7}");
    place.refuses(&[&place.line_of("facial_nerve"), "labels.json has no \"facial_nerve\"; it has: bone"]);
    with_names("{\"facial_nerve\": ").refuses(&["labels.json", "expected a JSON object"]);
    with_names("{\"facial_nerve\": 7.5}").refuses(&[
        "labels.json",
        "\"facial_nerve\": 7.5",
        "expected a name and a whole number",
    ]);
    with_names("{\"facial_nerve\": 7, \"dura\": 7}").refuses(&[
        "labels.json",
        "label 7 is both",
        "expected one name",
    ]);
    with_names("{\"facial_nerve\": 9}").refuses(&["structure[0].label", "label 9", "7, 20"]);
    assert_eq!(with_names("{\"facial_nerve\": 7}").plan().code, 0);
}

#[test]
fn a_label_that_two_have_is_refused_with_both() {
    let more = "[[structure]]\nname = \"chorda\"\nlabel = 7\n\n[approach]";
    let place = Place::healthy().with_case("[approach]", more);
    let both = "the structures \"nerve\" and \"chorda\" are the same label";
    place.refuses(&["case.toml:15: ", "`structure[1].label` = 7", both]);
    // once by number and once by name
    let place = Place::healthy().with_case("[approach]", &more.replace("label = 7", "label = \"rod\""));
    fs::write(place.path("labels.json"), "{\"rod\": 7, \"pocket\": 20}").unwrap();
    place.refuses(&["case.toml:15: ", "structure 'nerve' and structure 'chorda' are both label 7"]);
    let place = Place::healthy().with_case("label = 7", "label = \"pocket\"");
    fs::write(place.path("labels.json"), "{\"rod\": 7, \"pocket\": 20}").unwrap();
    place.refuses(&[&place.line_of("pocket"), "the target and structure 'nerve' are both label 20"]);
}

/// Plans and verifies: exit code of `plan`, its JSON, and the verification's failures.
fn planned(place: &Place) -> (i32, Value, Vec<String>) {
    let ran = place.run(&["plan", "case.toml", "--out", "plan", "--json"]);
    assert!(ran.code < 2, "{}{}", ran.out, ran.err);
    let json = serde_json::from_str(ran.out.lines().last().unwrap()).unwrap();
    let checks = place.run(&["verify", "plan"]);
    assert!(checks.code < 2, "{}{}", checks.out, checks.err);
    (ran.code, json, checks.out.lines().filter(|l| l.contains("FAIL")).map(str::to_owned).collect())
}

#[test]
fn labels_beside_the_ct_are_told_and_beyond_a_voxel_refused_until_the_case_chooses() {
    let moved = |mm: f64| Place::healthy().with_labels(|labels| labels.affine[0][3] += mm);
    let place = moved(1.0);
    let said = ["images.labels_affine", "lie up to 1.000 mm (2.0 voxels) beside the CT's"];
    place.refuses(&[&[&*place.line_of("[images]")], &said[..]].concat());
    let chosen = place.with_case("[images]", "[images]\nlabels_affine = \"sform\"");
    for (place, mm) in [(chosen, "1.000 mm"), (moved(0.25), "0.250 mm")] {
        let (code, json, failed) = planned(&place);
        assert!(code == 1 || failed.is_empty(), "{failed:?}");
        let said = format!("lies up to {mm}");
        assert!(json["warnings"].to_string().contains(&said), "{json}");
        for file in ["plan.toml", "report.html"] {
            assert!(fs::read_to_string(place.path("plan").join(file)).unwrap().contains(&said), "{file}");
        }
    }
    // a nerve in the air above the block is planned, and told
    let place = Place::healthy().with_labels(|labels| {
        labels.fill([30..32, 24..36, 12..14], 0.0);
        labels.fill([30..32, 24..36, 25..27], body::NERVE);
    });
    let (_, json, _) = planned(&place);
    assert!(
        json["warnings"].to_string().contains("100 % of structure 'nerve' lies outside the body"),
        "{json}"
    );
}

/// The healthy body with its labels as 3D Slicer's segmentation, after a change.
fn segmented(change: impl FnOnce(Image) -> Image) -> Place {
    const SEGMENTS: &str = "Segment0_ID:=a\nSegment0_Name:=Cavity\nSegment0_LabelValue:=20\n\
                            Segment1_ID:=b\nSegment1_Name:=Facial nerve\nSegment1_LabelValue:=7\n";
    let place = Place::healthy().with_case("labels.nii", "a.seg.nrrd");
    fs::write(place.path("a.seg.nrrd"), change(body::labels()).nrrd(SEGMENTS)).unwrap();
    fs::remove_file(place.path("labels.nii")).unwrap();
    place
}

/// What `bonemill case` prints of its images.
#[track_caller]
fn cased(place: &Place) -> String {
    let ran = place.run(&["case", "ct.nii", "a.seg.nrrd", "--out", "made.toml", "--force"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    ran.out
}

#[test]
fn a_crop_between_the_cts_voxels_is_told_and_one_on_them_is_not() {
    let cropped = |by_mm: f64| {
        segmented(|labels| {
            let mut labels = labels.cropped([8..36, 10..38, 10..26]);
            labels.affine[0][3] += by_mm;
            labels
        })
    };
    let said = "voxels lie up to 0.125 mm (0.25 voxels) beside the CT's";
    for (place, is_told) in [(cropped(0.125), true), (cropped(0.5), false)] {
        let (_, json, failed) = planned(&place);
        assert_eq!(failed, Vec::<String>::new());
        assert_eq!(json["warnings"].to_string().contains(said), is_told, "{json}");
        let case = cased(&place);
        assert_eq!(case.contains(said), is_told, "{case}");
    }
}

#[test]
fn a_segmentation_of_the_cts_size_elsewhere_is_refused_without_a_key_that_it_does_not_have() {
    let place = segmented(|mut labels| {
        labels.affine[0][3] += 1.0;
        labels
    });
    let ran = place.run(&["plan", "case.toml", "--out", "plan"]);
    let said = "lie up to 1.000 mm (2.0 voxels) beside the CT's";
    ran.refused(&[&place.line_of("labels = "), "`images.labels`", said, "exporting the segmentation"]);
    assert!(!ran.err.contains("affine"), "{}", ran.err);
    assert!(cased(&place).contains(said));
}

#[test]
fn a_segment_outside_the_ct_is_told_in_mm3_and_refused_where_nothing_of_it_is_inside() {
    // the nerve's voxels are 30 and 31 along i
    let scanned = |is: usize| {
        let place = segmented(|labels| labels);
        place.put_ct(&body::ct().cropped([0..is, 0..40, 0..30]));
        place
    };
    let place = scanned(31);
    let (_, json, _) = planned(&place);
    let said = |name: &str| format!("50.0 % of structure '{name}' lies outside the CT: 3.00 of 6.00 mm³");
    assert!(json["warnings"].to_string().contains(&said("nerve")), "{json}");
    assert!(cased(&place).contains(&said("Facial nerve")));
    let place = scanned(30);
    let said = ["(label 7) lies wholly outside the CT: the nearest of its 6.00 mm³ is 0.25 mm beyond"];
    place.refuses(&[&[&*place.line_of("label = 7"), "structure 'nerve'"], &said[..]].concat());
    let case = cased(&place);
    assert!(case.contains("structure 'Facial nerve'") && case.contains(said[0]), "{case}");
}

/// The nerve's voxels span 3.75..4.75 × 3.75..9.75 × 8.75..9.75 mm; the block ends at 13.75 mm.
#[test]
fn a_box_is_planned_less_the_structure_in_it_and_verified() {
    let target = "box = { min_mm = [-5, -2, 8], max_mm = [6, 8, 13.75] }";
    let place =
        Place::healthy().with_case("label = 20", target).with_case("spacing_mm = 0.5", "spacing_mm = 0.4");
    let (_, json, failed) = planned(&place);
    assert!(failed.is_empty(), "{failed:?}");
    let target_mm3 = json["metrics"]["target_mm3"].as_f64().unwrap();
    // about 4.25 mm of the nerve's length and its rounded end lie in the box, with 1 mm around and 0.75 mm below it
    let [box_mm3, nerve_mm3] = [11.0 * 10.0 * 5.75, 4.25 * (2.75 * 3.0 - 0.59) + 6.0];
    assert!((target_mm3 - (box_mm3 - nerve_mm3)).abs() < 6.0, "{target_mm3} {box_mm3} {nerve_mm3}");
}

#[test]
fn what_a_case_adds_and_takes_away_is_planned_and_verified_on_any_grid() {
    let target = "label = 20\nalso = [{ label = 7, margin_mm = 1 }, { ball = { center_mm = [-7, -3, 12], radius_mm = 2 } }]";
    let place = Place::healthy().with_case("label = 20", target);
    place.refuses(&["target.also[0] and structure 'nerve' are both label 7"]);
    let target = "label = 20\nless = [{ label = 7, margin_mm = 2.5 }]\nalso = [{ ball = { center_mm = [-3, 0, 12], radius_mm = 2 }, \
                  margin_mm = 0.5 }]";
    let place =
        Place::healthy().with_case("label = 20", target).with_case("spacing_mm = 0.5", "spacing_mm = 0.41");
    let (_, _, failed) = planned(&place);
    assert!(
        failed.iter().all(|line| line.contains("plan meets its case") || line.contains("removed of")),
        "{failed:?}"
    );
    // a mask's volume is that of its voxels, not of those of another grid
    let place = Place::healthy().with_case("spacing_mm = 0.5", "spacing_mm = 0.41");
    let (code, json, failed) = planned(&place);
    assert_eq!((code, failed), (0, vec![]));
    assert!((json["metrics"]["target_mm3"].as_f64().unwrap() - 1743.0 / 8.0).abs() < 1e-9, "{json}");
}
