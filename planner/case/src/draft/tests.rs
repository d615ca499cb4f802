//! Choosing and writing a case of a list of labels.

use std::path::Path;

use bonemill_geometry::Point;
use bonemill_imaging::{GreyValues, LabelSurvey};
use nalgebra::{Rotation3, Vector3};

use super::*;
use crate::{LabelRef, Registration, Target};

/// A label with a voxel at (x, 0, 0).
fn label(number: u16, name: &str, x_mm: f64) -> FoundLabel {
    let hu = Some(GreyValues { mean_hu: 700.0, low_hu: 100.0, high_hu: 1300.0 });
    let survey = LabelSurvey { number, volume_mm3: 12.5, center: Point::new(x_mm, 0.0, 0.0), hu };
    let name = Some(name.to_owned()).filter(|name| !name.is_empty());
    let of = name.clone().map_or(LabelRef::Number(number), LabelRef::Name);
    FoundLabel { number, name, of, survey: Some(survey) }
}

/// A mask in this file.
fn mask(path: &str) -> LabelRef {
    LabelRef::File { path: path.into(), label: None }
}

fn labels(names: &[&str]) -> Vec<FoundLabel> {
    names.iter().zip(1..).map(|(name, number)| label(number, name, 50.0)).collect()
}

fn with_target(name: &str) -> Wishes {
    Wishes { target: Some(TargetWish::Label(name.into())), ..Wishes::default() }
}

const EAR: [&str; 6] = ["bone", "ear canal", "target", "Facial Nerve", "Segment_5", "dura"];

/// The case of labels, and what is noted.
fn made(
    labels: &[FoundLabel],
    choice: &Choice,
    change: impl Fn(&mut Draft<'_>),
) -> Result<Drafted, DraftError> {
    let side = side(labels, choice, None);
    let images =
        ImagePaths { ct: "ct.nii.gz".into(), ct_series: None, labels: "a \"b\"/labels.nii.gz".into() };
    let mut of = Draft {
        images,
        labels,
        choice,
        beside_target: &[],
        diagonal_mm: 0.5,
        side: &side,
        approach: None,
        robot: "bone-attached",
        place: KnownPlace::Unknown,
    };
    change(&mut of);
    draft(&of, Path::new("case.toml"))
}

#[test]
fn names_tell_the_target_and_the_structures_by_their_importance() {
    let labels = labels(&EAR);
    let choice = choose(&labels, &Wishes::default()).unwrap();
    assert_eq!(choice.target, TargetChoice::Label(2));
    assert_eq!(choice.structures, [3, 5, 1]);
    assert_eq!(choice.roles[0], Role::Left(Meaning::Bone));
    assert_eq!(choice.roles[4], Role::Left(Meaning::Unknown));
    let made = made(&labels, &choice, |_| {}).unwrap();
    assert_eq!(made.case.target, Target::Label(LabelRef::Name("target".into())));
    let written: Vec<_> =
        made.case.structures.iter().map(|s| (s.name.as_str(), s.clearance_mm, s.priority)).collect();
    assert_eq!(written, [("Facial Nerve", 1.0, 1), ("dura", 0.5, 2), ("ear canal", 0.5, 3)]);
    assert_eq!(made.case.images.labels.to_str(), Some("a \"b\"/labels.nii.gz"));
    assert_eq!(made.notes.len(), 1, "{:?}", made.notes);
    assert!(made.notes[0].contains("label 5 \"Segment_5\" is not known"), "{:?}", made.notes);
    for part in ["# - 5 \"Segment_5\"", "# - 1 \"bone\"", "Side: not known", "[approach] is left out"] {
        assert!(made.text.contains(part), "{part}: {}", made.text);
    }
}

#[test]
fn wishes_go_before_names() {
    let labels = labels(&EAR);
    let wishes = Wishes {
        target: Some(TargetWish::Label("bone".into())),
        structures: vec!["segment 5".into()],
        ignored: vec!["6".into()],
    };
    let choice = choose(&labels, &wishes).unwrap();
    assert_eq!(choice.target, TargetChoice::Label(0));
    assert_eq!(choice.structures, [3, 1, 4]);
    assert_eq!(choice.roles[2], Role::Left(Meaning::Unknown), "what is named like a target is told");
    assert_eq!(choice.roles[5], Role::Ignored);
    let ball = Target::Ball { center_mm: Vector3::new(1.0, 2.0, 3.0), radius_mm: 4.0 };
    let wishes = Wishes { target: Some(TargetWish::Shape(ball.clone())), ..Wishes::default() };
    let choice = choose(&labels[..2], &wishes).unwrap();
    let made = made(&labels[..2], &choice, |_| {}).unwrap();
    assert_eq!(made.case.target, ball);
}

#[test]
fn what_cannot_be_told_is_refused_with_the_labels() {
    let ear = labels(&EAR);
    let refused = |labels: &[FoundLabel], wishes: &Wishes| choose(labels, wishes).unwrap_err().to_string();
    let structure = |names: &[&str]| Wishes {
        structures: names.iter().map(|name| (*name).to_owned()).collect(),
        ..with_target("target")
    };
    let mut empty = ear.clone();
    empty[2].survey = None;
    let unnamed = labels(&["", ""]);
    for (labels, wishes, parts) in [
        (&ear[..2], Wishes::default(), ["no label's name tells the target", "1 \"bone\", 2 \"ear canal\""]),
        (&unnamed, Wishes::default(), ["--target NAME|NUMBER", "the labels are 1, 2"]),
        (&empty, Wishes::default(), ["no label's name", "3 \"target\""]),
        (&empty, with_target("target"), ["--target", "in no voxel"]),
        (&labels(&["target", "cavity"]), Wishes::default(), ["several labels", "1 \"target\", 2 \"cavity\""]),
        (&ear, with_target("targt"), ["--target: there is no label \"targt\"", "did you mean \"target\"?"]),
        (&ear, with_target("9"), ["there is no label \"9\"", "6 \"dura\""]),
        (&ear, structure(&["3"]), ["label 3 \"target\" is given twice", "by --target and by --structure"]),
        (
            &ear,
            structure(&["dura", "Dura"]),
            ["label 6 \"dura\" is given twice", "by --structure and by --structure"],
        ),
        (
            &labels(&["target", "Nerve", "nerve"]),
            structure(&["NERVE"]),
            ["may be each of", "2 \"Nerve\", 3 \"nerve\""],
        ),
        (
            &labels(&["target", "dura, left", "dura  left"]),
            Wishes::default(),
            ["would both be named", "2 \"dura, left\""],
        ),
    ] {
        let said = refused(labels, &wishes);
        assert!(parts.iter().all(|part| said.contains(part)), "{said}");
    }
}

#[test]
fn a_mask_is_spared_whatever_its_name() {
    let mut labels = labels(&["target", "lump"]);
    labels[1].of = mask("masks/lump.nii.gz");
    let choice = choose(&labels, &Wishes::default()).unwrap();
    let made = made(&labels, &choice, |_| {}).unwrap();
    assert_eq!(made.case.structures[0].label, mask("masks/lump.nii.gz"));
    assert_eq!(made.case.structures[0].clearance_mm, 1.0);
}

#[test]
fn the_target_and_what_it_touches_may_be_in_files_of_their_own() {
    let mut labels = labels(&["bone", "target", "facial nerve"]);
    labels[1].of = mask("my target.nii.gz");
    let nerve = Some(Box::new(LabelRef::Number(4)));
    labels[2].of = LabelRef::File { path: "nerves.nii".into(), label: nerve };
    let choice = choose(&labels, &Wishes::default()).unwrap();
    let made = made(&labels, &choice, |draft| draft.beside_target = &[3]).unwrap();
    assert_eq!(made.case.target, Target::Label(mask("my target.nii.gz")));
    assert_eq!(made.case.structures[0].label, labels[2].of);
    assert_eq!(made.case.less[0].of, Target::Label(labels[2].of.clone()));
}

#[test]
fn a_target_gives_way_to_what_it_touches() {
    let ear = labels(&EAR);
    let choice = choose(&ear, &Wishes::default()).unwrap();
    // the bone is no structure
    let touching = made(&ear, &choice, |draft| draft.beside_target = &[1, 2, 4]).unwrap();
    let less: Vec<_> =
        touching.case.less.iter().map(|region| (region.of.clone(), region.margin_mm)).collect();
    let of = |name: &str, margin| (Target::Label(LabelRef::Name(name.into())), margin);
    assert_eq!(less, [of("Facial Nerve", 1.0), of("ear canal", 0.5)]);
    assert!(
        touching.notes.iter().any(|note| note.contains("Facial Nerve by 1 mm, ear canal by 0.5 mm")),
        "{:?}",
        touching.notes
    );
    let coarse =
        made(&ear, &choice, |draft| (draft.beside_target, draft.diagonal_mm) = (&[2], 1.71)).unwrap();
    assert_eq!(coarse.case.less[0].margin_mm, 1.8);
}

#[test]
fn the_side_is_told_by_names_or_by_a_scan_of_both_and_a_contradiction_is_noted() {
    let of = |names: &[&str], x_mm: f64, bone: Option<[f64; 2]>| {
        let labels: Vec<_> = names.iter().zip(1..).map(|(name, number)| label(number, name, x_mm)).collect();
        let choice = choose(&labels, &Wishes::default()).unwrap();
        let found = side(&labels, &choice, bone);
        (found.side, found.is_contradicted)
    };
    let skull = Some([-70.0, 74.0]);
    assert_eq!(of(&["target_left"], 50.0, None), (Some(Side::Left), false));
    assert_eq!(of(&["target", "facial_nerve_r", "dura"], 50.0, None), (Some(Side::Right), false));
    assert_eq!(of(&["target", "facial_nerve_r", "facial_nerve_l"], 50.0, None), (None, false));
    assert_eq!(of(&["target"], 50.0, skull), (Some(Side::Right), false));
    assert_eq!(of(&["target"], -50.0, skull), (Some(Side::Left), false));
    assert_eq!(of(&["target"], 10.0, skull), (None, false), "in the middle");
    assert_eq!(of(&["target"], 50.0, Some([20.0, 80.0])), (None, false), "one side only");
    assert_eq!(of(&["target_left"], 50.0, skull), (None, true));
}

#[test]
fn the_arm_and_where_the_patient_is_stand_in_the_case() {
    let ear = labels(&EAR);
    let choice = choose(&ear, &Wishes::default()).unwrap();
    let turn = Rigid::new(Rotation3::from_euler_angles(0.1, 0.2, 0.3), Vector3::new(400.0, 1.0, -2.5));
    let ur = made(&ear, &choice, |draft| {
        draft.robot = "ur5e";
        draft.place = KnownPlace::Registered(turn);
        draft.approach = Some(Vector3::new(2.0, 0.0, 0.0));
    })
    .unwrap();
    assert_eq!(ur.case.robot.model, "ur5e");
    let [translation, rpy] = ur.case.robot.flange_from_burr.map(|(t, r)| [t, r]).unwrap();
    assert_eq!((translation, rpy), ([0.0, 0.0, 180.0], [std::f64::consts::PI, 0.0, 0.0]));
    let Registration::Given { rotation, translation_mm } = ur.case.robot.base_from_ct else { panic!() };
    assert!(
        (rotation.matrix() - turn.rotation.matrix()).amax() < 1e-14 && translation_mm == turn.translation_mm
    );
    assert_eq!(ur.case.approach, Some(Vector3::x()));
    let points = |n: usize| KnownPlace::Fiducials((0..n).map(|n| Point::new(n as f64, 2.0, 0.0)).collect());
    let fiducials = made(&ear, &choice, |draft| draft.place = points(3)).unwrap();
    assert_eq!(fiducials.case.robot.base_from_ct, Registration::Assumed);
    let key = fiducials.text.lines().find_map(|line| line.strip_prefix("# base_from_ct = ")).unwrap();
    // the key as it will be once the arm has touched the points
    let touched = key.replace(
        "base_mm = [[0, 0, 0], [0, 0, 0], [0, 0, 0]]",
        "base_mm = [[5, 0, 0], [6, 0, 0], [7, 0, 1]]",
    );
    let completed = fiducials.text.replace("[robot]", &format!("[robot]\nbase_from_ct = {touched}"));
    assert!(crate::Case::parse(&completed, Path::new("case.toml")).is_ok(), "{completed}");
    let few = made(&ear, &choice, |draft| draft.place = points(2)).unwrap_err();
    assert!(few.to_string().contains("2 fiducials; expected at least three"), "{few}");
    let nowhere = made(&ear, &choice, |draft| draft.approach = Some(Vector3::zeros())).unwrap_err();
    assert!(matches!(nowhere, DraftError::Approach), "{nowhere}");
}

#[test]
fn hostile_names_stay_in_their_strings_and_comments() {
    let names = ["target", "dura\n[burr]\nradius_mm = 9", "x\n[speed]", "\u{7f}\"\\ nerve '"];
    let labels = labels(&names);
    let choice = choose(&labels, &Wishes::default()).unwrap();
    let made = made(&labels, &choice, |_| {}).unwrap();
    assert_eq!(made.case.burr.radius_mm, 2.0);
    assert_eq!(made.case.structures.len(), 2);
    assert_eq!(made.case.structures[0].label, LabelRef::Name(names[1].into()));
}

#[test]
fn a_case_can_be_made_for_every_named_arm() {
    let ear = labels(&EAR);
    let choice = choose(&ear, &Wishes::default()).unwrap();
    for robot in ROBOTS {
        assert_eq!(made(&ear, &choice, |draft| draft.robot = robot).unwrap().case.robot.model, robot);
    }
    let urs: Vec<&str> = bonemill_arm::ur::UrModel::ALL.iter().map(|model| model.name()).collect();
    assert_eq!(urs, ROBOTS[1..]);
}
