//! Target and structures in files of their own, on grids of their own: the plan is that of one label map, and is verified.

use std::fs;

use crate::support::body::{self, NERVE, TARGET};
use crate::support::image::{Image, Stored};
use crate::support::place::Place;

const VEIN: f32 = 8.0;
const PLATE: f32 = 9.0;

/// The healthy body's labels and two more structures.
fn labels() -> Image {
    let mut labels = body::labels();
    labels.fill([2..5, 4..30, 14..17], VEIN);
    labels.fill([8..30, 34..38, 6..8], PLATE);
    labels
}

/// The labels that are named, with numbers of their own, and 0.
fn only(labels: &Image, of: &[(f32, f32)]) -> Image {
    let number = |value: f32| of.iter().find(|(label, _)| *label == value).map_or(0.0, |(_, number)| *number);
    Image { values: labels.values.iter().map(|value| number(*value)).collect(), ..labels.clone() }
}

/// The same boxes in voxels of half the side.
fn halved(image: &Image) -> Image {
    let dims = image.dims.map(|n| 2 * n);
    let [nx, ny, _] = image.dims;
    let origin = [0, 1, 2].map(|a| image.affine[a][3] - 0.25 * body::SPACING_MM);
    let value = |[i, j, k]: [usize; 3]| image.values[i / 2 + nx * (j / 2 + ny * (k / 2))];
    Image::new(dims, 0.5 * body::SPACING_MM, origin, value)
}

fn put(place: &Place, name: &str, image: &Image) {
    fs::write(place.path(name), image.bytes(Stored::Unsigned16)).unwrap();
}

/// The case with these keys in place of those of the labels, the structures nerve, vein and plate.
fn case(map: &str, [target, nerve, vein, plate]: [&str; 4]) -> String {
    let more =
        |name: &str, keys: &str| format!("[[structure]]\nname = \"{name}\"\n{keys}\nclearance_mm = 0.5\n\n");
    let case = body::CASE.replace("labels = \"labels.nii\"\n", map).replace("label = 20", target);
    case.replace("label = 7", nerve)
        .replace("[approach]", &(more("vein", vein) + &more("plate", plate) + "[approach]"))
}

/// The plan of one label map.
fn of_one_map() -> Place {
    let place = Place::healthy();
    place.put_labels(&labels());
    let keys = ["label = 20", "label = 7", "label = 8", "label = 9"];
    fs::write(place.path("case.toml"), case("labels = \"labels.nii\"\n", keys)).unwrap();
    place.verified();
    place
}

#[track_caller]
fn has_the_same_path(place: &Place, other: &Place) {
    for file in ["waypoints.csv", "trajectory.csv"] {
        let [a, b] = [place, other].map(|of| fs::read(of.path("plan").join(file)).unwrap());
        assert!(a == b, "{file} differs");
    }
}

#[test]
fn masks_in_files_of_their_own_grids_give_the_plan_of_one_map() {
    let place = Place::healthy();
    fs::remove_file(place.path("labels.nii")).unwrap();
    fs::create_dir(place.path("masks")).unwrap();
    let all = labels();
    // cropped as 3D Slicer crops: the map that begins with it must grow; and in voxels of half the side
    put(&place, "target.nii", &only(&all, &[(TARGET, 1.0)]).cropped([9..29, 10..33, 13..24]));
    put(&place, "masks/nerve.nii", &halved(&only(&all, &[(NERVE, 255.0)])));
    put(&place, "masks/vein.nii", &only(&all, &[(VEIN, 1.0)]).stored_as([2, 0, 1], [true, false, true]));
    put(&place, "masks/plate.nii", &only(&all, &[(PLATE, 3.0)]));
    let keys =
        ["target", "masks/nerve", "masks/vein", "masks/plate"].map(|name| format!("file = \"{name}.nii\""));
    fs::write(place.path("case.toml"), case("", keys.each_ref().map(String::as_str))).unwrap();
    let plan = place.verified();
    has_the_same_path(&place, &of_one_map());
    let inputs: Vec<_> = plan.record.inputs.iter().map(|input| input.path.to_str().unwrap()).collect();
    let named = ["case.toml", "ct.nii", "target.nii", "masks/nerve.nii", "masks/vein.nii", "masks/plate.nii"];
    assert_eq!(inputs, named, "each file once");
    assert!(
        plan.record.warnings.iter().all(|said| !said.contains("another grid")),
        "{:?}",
        plan.record.warnings
    );
    // packed, the plan is whole without the files
    let ran = place.run(&["plan", "case.toml", "--out", "packed", "--pack"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    fs::remove_dir_all(place.path("masks")).unwrap();
    fs::remove_file(place.path("target.nii")).unwrap();
    let ran = place.run(&["verify", "packed"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
}

#[test]
fn several_files_of_several_labels_give_the_plan_of_one_map() {
    let place = Place::healthy();
    let all = labels();
    put(&place, "a.nii", &only(&all, &[(TARGET, 1.0), (NERVE, 2.0)]));
    put(&place, "b.nii", &only(&all, &[(VEIN, 1.0), (PLATE, 2.0)]));
    fs::write(place.path("labels.json"), "{\"cavity\": 1, \"plate\": 2}").unwrap();
    let [a, b] = ["a", "b"].map(|name| move |label: &str| format!("file = \"{name}.nii\"\nlabel = {label}"));
    let keys = [a("\"cavity\""), a("2"), b("1"), b("\"plate\"")];
    let text = case("", keys.each_ref().map(String::as_str));
    fs::write(place.path("case.toml"), &text).unwrap();
    let plan = place.verified();
    has_the_same_path(&place, &of_one_map());
    let inputs: Vec<_> = plan.record.inputs.iter().map(|input| input.path.to_str().unwrap()).collect();
    assert_eq!(inputs, ["case.toml", "ct.nii", "a.nii", "labels.json", "b.nii"]);
    let refuses = |old: &str, new: &str, parts: &[&str]| {
        assert_eq!(text.matches(old).count(), 1, "{old}");
        fs::write(place.path("case.toml"), text.replace(old, new)).unwrap();
        place.refuses_into("other", &[&[&*place.line_of(new.lines().next().unwrap())], parts].concat());
    };
    let first = "file = \"a.nii\"\nlabel = \"cavity\"";
    refuses(first, "file = \"a.nii\"", &["target.file", "a.nii holds the labels [1, 2]", "label or segment"]);
    refuses(
        "file = \"b.nii\"\nlabel = 1",
        "file = \"b.nii\"\nlabel = 3",
        &["structure 'vein'", "no voxel of label 3"],
    );
    refuses("file = \"b.nii\"\nlabel = 1", "file = \"gone.nii\"", &["gone.nii", "structure[1].file"]);
    fs::write(place.path("case.toml"), text.replace("\"plate\"\nclear", "\"plat\"\nclear")).unwrap();
    place.refuses_into("other", &["structure 'plate'", "has no \"plat\"", "did you mean \"plate\"?"]);
}

#[test]
fn a_mask_of_another_grid_keeps_all_of_a_structure_and_is_told() {
    let place = Place::healthy();
    // a nerve of 0.3 mm voxels across the map's: seven voxels along x are 2.1 mm
    let nerve = Image::new([7, 12, 4], 0.3, [3.9, 4.0, 9.0], |_| 1.0);
    put(&place, "nerve.nii", &nerve);
    fs::write(place.path("case.toml"), body::CASE.replace("label = 7", "file = \"nerve.nii\"")).unwrap();
    let plan = place.verified();
    let said = plan.record.warnings.join("\n");
    assert!(said.contains("nerve.nii lies on another grid than the label map"), "{said}");
    assert!(said.contains("every voxel that it touches"), "{said}");
    // no burr comes nearer to the mask's own voxels than the clearance of 1 mm
    let (low, high) = ([3.75, 3.85, 8.85], [5.85, 7.45, 10.05]);
    for waypoint in &plan.waypoints {
        let p = waypoint.position.coords;
        let beyond = |a: usize| (low[a] - p[a]).max(p[a] - high[a]).max(0.0);
        let distance_mm = beyond(0).hypot(beyond(1)).hypot(beyond(2)) - plan.record.case.burr.radius_mm;
        assert!(distance_mm >= 1.0 - 1e-3, "{distance_mm}");
    }
    // as many voxels as the map, one voxel and a half beside it: a mistake
    let mut beside = body::labels();
    beside.affine[0][3] += 0.75;
    put(&place, "nerve.nii", &only(&beside, &[(NERVE, 1.0)]));
    place.refuses_into(
        "other",
        &["structure 'nerve'", "nerve.nii has the dimensions of the label map", "0.750 mm"],
    );
}

/// Neither a file beside the map nor a map that grows to hold one hides that a file lies elsewhere than the CT.
#[test]
fn every_file_is_compared_with_the_ct_on_its_own_grid() {
    let place = Place::healthy();
    let all = labels();
    let keys = ["label = 20", "file = \"nerve.nii\"", "label = 8", "label = 9"];
    fs::write(place.path("case.toml"), case("labels = \"labels.nii\"\n", keys)).unwrap();
    // the map a crop, the mask of the CT's dimensions and two voxels beside it
    place.put_labels(&all.cropped([2..34, 3..39, 5..24]));
    let mut beside = only(&all, &[(NERVE, 1.0)]);
    beside.affine[0][3] += 2.0 * body::SPACING_MM;
    put(&place, "nerve.nii", &beside);
    place.refuses_into("other", &["structure 'nerve'", "nerve.nii has the dimensions of the CT", "1.000 mm"]);
    // the map of the CT's dimensions and beside it, the mask a crop at the true place, beyond the map's edge
    let mut beside = only(&all, &[(TARGET, TARGET), (VEIN, VEIN), (PLATE, PLATE)]);
    beside.affine[0][3] += 10.0 * body::SPACING_MM;
    place.put_labels(&beside);
    let mut wide = only(&all, &[(NERVE, 1.0)]);
    wide.fill([0..2, 4..6, 4..6], 1.0);
    put(&place, "nerve.nii", &wide.cropped([0..32, 2..38, 2..24]));
    place.refuses_into("other", &["the label map has the CT's dimensions", "5.000 mm"]);
}

#[test]
fn a_target_that_overlaps_a_structure_is_planned_less_its_clearance_and_verified() {
    let place = Place::healthy();
    let mut nerve = only(&body::labels(), &[(NERVE, 1.0)]);
    // two voxels deep in a corner of the pocket: 2 × 2 × 2 of its voxels
    nerve.fill([25..32, 24..36, 12..17], 1.0);
    put(&place, "nerve.nii", &nerve);
    fs::write(place.path("case.toml"), body::CASE.replace("label = 7", "file = \"nerve.nii\"")).unwrap();
    let plan = place.verified();
    let said = plan.record.warnings.join("\n");
    assert!(said.contains("structure 'nerve' shares 1.00 mm³ with the target"), "{said}");
    assert!(said.contains("the target touches structure 'nerve', which overlaps it by 1.00 mm³"), "{said}");
    let lost = said.split("left out of the target, ").nth(1).unwrap();
    let lost_mm3: f64 = lost.split(' ').next().unwrap().parse().unwrap();
    assert!(lost.contains(" of 217.88 mm³") && (1.0..20.0).contains(&lost_mm3), "{said}");
    // the same by target.less, which names the file
    let less = "label = 20\nless = [{ file = \"nerve.nii\", margin_mm = 1.0 }]";
    let other = Place::healthy();
    put(&other, "nerve.nii", &nerve);
    let case = body::CASE.replace("label = 7", "file = \"nerve.nii\"").replace("label = 20", less);
    fs::write(other.path("case.toml"), case).unwrap();
    let of_less = other.verified();
    assert!(!of_less.record.warnings.join("\n").contains("touches"), "{:?}", of_less.record.warnings);
    has_the_same_path(&place, &other);
}
