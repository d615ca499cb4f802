//! The command with bad images, targets and outputs: exit code 2 with what is wrong, where, and what was expected, and nothing
//! written. A valid case that cannot be fulfilled ends with exit code 1 and the reasons.

use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;

use flate2::Compression;
use flate2::write::GzEncoder;

use crate::support::body::{self, AIR_FROM, NERVE, TARGET};
use crate::support::image::{Image, Stored, field, put, put_shorts, put_singles};
use crate::support::place::Place;

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn a_missing_image_is_named_with_its_key_and_line() {
    for (key, name) in [("images.ct", "ct.nii"), ("images.labels", "labels.nii")] {
        let place = Place::healthy();
        fs::remove_file(place.path(name)).unwrap();
        place.refuses(&[&place.line_of(name), key, name, "No such file"]);
    }
}

#[test]
fn a_truncated_image_says_how_much_there_is_and_how_much_was_expected() {
    for (key, name, voxel) in [("images.ct", "ct.nii", 4), ("images.labels", "labels.nii", 2)] {
        let whole = 352 + 48_000 * voxel;
        let place = Place::healthy().with_bytes(name, |b| b.truncate(whole - 1));
        let sizes = [format!("need {whole} bytes"), format!("the file's {} bytes", whole - 1)];
        place.refuses(&[&place.line_of(name), key, name, "truncated", &sizes[0], &sizes[1]]);
        let place = Place::healthy().with_bytes(name, |b| b.truncate(100));
        place.refuses(&[key, name, "ends after 100 bytes; expected a NIfTI header of 348 bytes"]);
        // if it is compressed, only the end of the stream shows it
        let place =
            Place::healthy().with_bytes(name, |b| *b = gzip(b)).with_bytes(name, |b| b.truncate(b.len() / 2));
        place.refuses(&[key, name, "gzip stream is damaged or cut off"]);
        let place = Place::healthy().with_bytes(name, |b| *b = gzip(&b[..whole / 2]));
        place.refuses(&[key, name, "truncated", &format!("expected {}", whole - 352)]);
    }
}

#[test]
fn a_corrupt_image_is_refused_whatever_is_wrong_with_it() {
    for (key, name) in [("images.ct", "ct.nii"), ("images.labels", "labels.nii")] {
        let damage: [(&str, fn(&mut Vec<u8>), &str); 11] = [
            ("no image", |b| *b = b"a thesis, not a scan. ".repeat(40), "is not NIfTI:"),
            (
                "NRRD",
                |b| *b = b"NRRD0004\ntype: short\ndimension: 3\n\n".to_vec(),
                "the header has no field `sizes`",
            ),
            ("empty", Vec::clear, "ends after 0 bytes; expected a NIfTI header"),
            ("magic", |b| put(b, 344, b"xyz\0"), "magic \"xyz\\0\", expected \"n+1\\0\""),
            (
                "half of a pair",
                |b| put(b, 344, b"ni1\0"),
                "is the header of a .hdr/.img pair, whose voxels in ",
            ),
            (
                "colour",
                |b| put_shorts(b, field::DATATYPE, &[128, 24]),
                "voxel type 128 (colour); expected an integer or float",
            ),
            ("bits", |b| put_shorts(b, field::DATATYPE + 2, &[7]), "bitpix 7 contradicts voxel type"),
            ("offset", |b| put_singles(b, 108, &[12.5]), "vox_offset 12.5: expected"),
            ("slope", |b| put_singles(b, 112, &[f32::INFINITY]), "scl_slope inf"),
            ("surplus", |b| b.extend([0; 10_000]), "after the last voxel"),
            (
                "checksum",
                |b| {
                    *b = gzip(b);
                    let middle = b.len() - 8; // of gzip's own trailer
                    b[middle] ^= 1;
                },
                "gzip stream is damaged or cut off",
            ),
        ];
        for (what, change, message) in damage {
            eprintln!("{name}: {what}");
            Place::healthy().with_bytes(name, change).refuses(&[key, name, message]);
        }
    }
}

#[test]
fn a_folder_in_an_images_place_is_refused() {
    for name in ["ct.nii", "labels.nii"] {
        let place = Place::healthy();
        fs::remove_file(place.path(name)).unwrap();
        fs::create_dir(place.path(name)).unwrap();
        place.refuses(&[&place.line_of(name), name, "is a folder without images; expected an image file"]);
        let file = [&[0; 128][..], b"DICM", &[0; 400]].concat();
        fs::write(place.path(name).join("0001.dcm"), file).unwrap();
        place.refuses(&[&place.line_of(name), name, "0001.dcm", "cannot be read as DICOM"]);
    }
}

#[test]
fn impossible_sizes_are_refused_before_memory_is_taken() {
    let dims = |sizes: [i16; 4]| move |b: &mut Vec<u8>| put_shorts(b, field::DIM, &sizes);
    let place = Place::healthy().with_bytes("ct.nii", dims([3, 1000, 1000, 1000]));
    place.refuses(&["images.ct", "ct.nii", "dims [1000, 1000, 1000] need 4000000352 bytes", "192352 bytes"]);
    // a compressed file may really be small
    let place = place.with_bytes("ct.nii", |b| *b = gzip(b));
    place.refuses(&["images.ct", "ct.nii", "dims [1000, 1000, 1000]"]);
    let place = Place::healthy().with_bytes("labels.nii", dims([3, 32767, 32767, 32767]));
    place.refuses(&[
        "images.labels",
        "labels.nii",
        "dims [32767, 32767, 32767]",
        "expected at most 2147483648",
    ]);
    for (sizes, message) in [
        ([3, 40, -40, 30], "dim [3, 40, -40, 30, 1, 1, 1, 1]: expected 1 to 7 dimensions"),
        ([3, 40, 0, 30], "each at least 1"),
        ([9, 40, 40, 30], "dim [9, "),
        ([0, 40, 40, 30], "dim [0, "),
    ] {
        Place::healthy().with_bytes("ct.nii", dims(sizes)).refuses(&["images.ct", "ct.nii", message]);
    }
    let series = |b: &mut Vec<u8>| put_shorts(b, field::DIM, &[4, 40, 40, 15, 2]);
    Place::healthy().with_bytes("ct.nii", series).refuses(&["ct.nii", "2 volumes in one file; expected one"]);
}

// images: voxels

#[test]
fn a_voxel_that_is_no_number_is_named() {
    for (value, word) in [(f32::NAN, "NaN"), (f32::NEG_INFINITY, "-inf")] {
        let place = Place::healthy().with_ct(|ct| ct.fill([3..4, 5..7, 6..7], value));
        let message = format!("voxel [3, 5, 6] is {word}; expected finite numbers everywhere, 2 are not");
        place.refuses(&[&place.line_of("ct.nii"), "images.ct", "ct.nii", &message]);
    }
}

#[test]
fn a_voxel_that_is_no_label_is_named() {
    for (value, word) in [(f32::NAN, "NaN"), (2.5, "2.5"), (-1.0, "-1"), (70_000.0, "70000")] {
        let place = Place::healthy();
        let mut labels = body::labels();
        labels.fill([3..4, 5..6, 6..7], value);
        fs::write(place.path("labels.nii"), labels.bytes(Stored::Single)).unwrap();
        let message = format!("voxel [3, 5, 6] is {word}");
        place.refuses(&["images.labels", "labels.nii", &message, "expected whole numbers 0 to 65535"]);
    }
}

#[test]
fn a_scan_whose_density_is_not_hu_says_what_it_looks_like() {
    let hu_to = |map: fn(f32) -> f32| move |ct: &mut Image| ct.values.iter_mut().for_each(|v| *v = map(*v));
    for (map, looks) in [
        (hu_to(|v| ((v + 1000.0) / 2300.0 * 255.0).floor()), "8-bit"),
        (hu_to(|v| (v + 1000.0) / 2300.0), "normalised to 0..1"),
        (hu_to(|v| v + 1024.0), "HU + 1024"),
        (hu_to(|v| (v + 1000.0) * 28.0), "raw 16-bit"),
        (hu_to(|_| 0.0), "the same value"),
        (hu_to(|_| -1000.0), "the same value"),
    ] {
        let place = Place::healthy().with_ct(map);
        let parts = [
            &*place.line_of("ct.nii"),
            "images.ct",
            "ct.nii",
            "not Hounsfield units",
            looks,
            "air near -1000",
        ];
        place.refuses(&parts);
    }
    let place = Place::healthy();
    let mut ct = body::ct();
    hu_to(|v| (v + 1000.0) / 2300.0 * 255.0)(&mut ct);
    fs::write(place.path("ct.nii"), ct.bytes(Stored::Byte)).unwrap();
    place.refuses(&["images.ct", "8-bit"]);
}

// images: where they lie

#[test]
fn an_affine_that_is_none_is_refused() {
    for (key, name) in [("images.ct", "ct.nii"), ("images.labels", "labels.nii")] {
        let damage: [(fn(&mut Vec<u8>), &str); 5] = [
            (|b| put_singles(b, field::SROW + 4, &[f32::NAN]), "the sform holds a value that is not finite"),
            (|b| put_singles(b, field::SROW, &[0.0; 3]), "the sform is singular"),
            (|b| put_singles(b, field::SROW + 4, &[0.2]), "the sform has shear"),
            (|b| put_singles(b, field::SROW, &[0.0005]), "wrong unit?"),
            (|b| put_shorts(b, field::SFORM_CODE, &[0]), "has neither sform nor qform"),
        ];
        for (change, message) in damage {
            Place::healthy().with_bytes(name, change).refuses(&[key, name, message]);
        }
    }
}

#[test]
fn affines_that_disagree_are_refused_until_the_case_says_which_holds() {
    // a qform without rotation, shifted by 3 mm
    let add_qform = |b: &mut Vec<u8>| {
        put_shorts(b, field::QFORM_CODE, &[1]);
        let [x, y, z] = body::ORIGIN_MM.map(|v| v as f32);
        put_singles(b, field::QUATERN_B, &[0.0, 0.0, 0.0, x + 3.0, y, z]);
    };
    let place = Place::healthy().with_bytes("ct.nii", add_qform);
    let parts = ["sform (code 1) and qform (code 1) differ by 6.000 voxels", "limit 0.1", "images.ct_affine"];
    place.refuses(&[&[&*place.line_of("[images]"), "ct.nii"], &parts[..]].concat());
    let place = place.with_case("ct = \"ct.nii\"", "ct = \"ct.nii\"\nct_affine = \"sform\"");
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    assert!(fs::read_to_string(place.path("plan/plan.toml")).unwrap().contains("sform code 1, qform code 1"));
    // the other transform can be chosen too, but not one that is not set
    let place = Place::healthy().with_bytes("labels.nii", add_qform);
    place.refuses(&["images.labels_affine", "labels.nii", "differ by"]);
    let place =
        place.with_case("labels = \"labels.nii\"", "labels = \"labels.nii\"\nlabels_affine = \"sform\"");
    assert_eq!(place.plan().code, 0);
    let place = Place::healthy().with_case("ct = \"ct.nii\"", "ct = \"ct.nii\"\nct_affine = \"qform\"");
    place.refuses(&["ct.nii", "the case asks for the qform, whose code is 0"]);
    // a transform with NaN disagrees with everything, but does not matter if the other is chosen
    let place = Place::healthy()
        .with_bytes("ct.nii", add_qform)
        .with_bytes("ct.nii", |b| put_singles(b, field::QUATERN_B, &[f32::NAN]));
    place.refuses(&["ct.nii", "the qform holds a value that is not finite"]);
    let place = place.with_case("ct = \"ct.nii\"", "ct = \"ct.nii\"\nct_affine = \"sform\"");
    assert_eq!(place.plan().code, 0);
}

/// A body that was made larger without its pixdim, as a program that edits matrices only leaves it.
#[test]
fn voxel_sizes_that_contradict_pixdim_are_refused_until_the_case_chooses_the_sform() {
    let larger = |b: &mut Vec<u8>| {
        let size = 1.155 * body::SPACING_MM as f32;
        (0..3).for_each(|a| put_singles(b, field::SROW + 20 * a, &[size]));
    };
    for (key, name) in [("ct", "ct.nii"), ("labels", "labels.nii")] {
        let place = Place::healthy().with_bytes(name, larger);
        place.refuses(&[
            &place.line_of("[images]"),
            &format!("images.{key}_affine"),
            name,
            "voxels of 0.5775 × 0.5775 × 0.5775 mm by the sform's columns, 0.5 × 0.5 × 0.5 mm by pixdim",
        ]);
    }
    let chosen = "[images]\nct_affine = \"sform\"\nlabels_affine = \"sform\"";
    let place = Place::healthy().with_bytes("ct.nii", larger).with_bytes("labels.nii", larger);
    let ran = place.with_case("[images]", chosen).plan();
    assert!(ran.code < 2, "{}{}", ran.out, ran.err);
}

#[test]
fn images_of_different_places_are_refused_with_both_extents() {
    let place = Place::healthy().with_labels(|labels| labels.affine[0][3] += 1000.0);
    place.refuses(&[
        &place.line_of("labels.nii"),
        "images.labels",
        "do not overlap",
        "-11.2..8.8 × -8.2..11.8 × 2.8..17.8 mm",
        "988.8..1008.8",
    ]);
}

// target and structures

#[test]
fn a_target_of_air_is_refused() {
    let place = Place::healthy().with_labels(|labels| {
        labels.fill([0..40, 0..40, 0..AIR_FROM], 0.0);
        labels.fill([30..32, 24..36, 12..14], NERVE);
        labels.fill([11..27, 12..26, AIR_FROM + 1..29], TARGET);
    });
    place.refuses(&[&place.line_of("[target]"), "the target is empty", "air_hu = -700 HU"]);
    let place =
        Place::healthy().with_case("label = 20", "box = { min_mm = [-5, -2, 15], max_mm = [2, 4, 17] }");
    place.refuses(&[&place.line_of("[target]"), "the target is empty", "air_hu = -700 HU"]);
}

#[test]
fn a_target_outside_the_scan_is_refused_with_both_extents() {
    for shape in [
        "box = { min_mm = [100, 0, 0], max_mm = [110, 10, 10] }",
        "ball = { center_mm = [0, 0, 500], radius_mm = 4 }",
        "frustum = { from_mm = [0, -90, 0], to_mm = [0, -80, 0], from_radius_mm = 4, to_radius_mm = 3 }",
    ] {
        let place = Place::healthy().with_case("label = 20", shape);
        place.refuses(&[
            &place.line_of("[target]"),
            "lies outside the CT",
            "the CT -11.2..8.8 × -8.2..11.8 × 2.8..17.8 mm",
        ]);
    }
    // a map larger than the scan, with the target beyond the scan
    let place = Place::healthy();
    let mut labels =
        Image::new(
            [80, 40, 30],
            body::SPACING_MM,
            body::ORIGIN_MM,
            |[i, ..]| if i > 60 { TARGET } else { 0.0 },
        );
    labels.fill([30..32, 24..36, 12..14], NERVE);
    place.put_labels(&labels);
    let said = ["the target (label 20) lies wholly outside the CT", "do not share a place"];
    place.refuses(&[&[&*place.line_of("[target]")], &said[..]].concat());
}

/// The patient with another target, voxels of the image.
fn with_target(target: [std::ops::Range<usize>; 3]) -> Place {
    Place::healthy().with_labels(|labels| {
        labels.fill([0..40, 0..40, 0..AIR_FROM], 0.0);
        labels.fill([30..32, 24..36, 12..14], NERVE);
        labels.fill(target, TARGET);
    })
}

const NOTHING_REACHABLE: &str = "a burr of radius 1.5 mm can reach no voxel of the target";

#[test]
fn a_target_deep_in_the_bone_is_refused() {
    // a cavity in which the burr has room, but which it cannot enter
    let place = with_target([10..26, 12..26, 4..12]);
    place.refuses(&[
        &place.line_of("[target]"),
        NOTHING_REACHABLE,
        "bone outside the target",
        "approach.direction",
    ]);
}

#[test]
fn an_approach_out_of_the_wrong_side_is_refused() {
    let place = Place::healthy().with_case("direction = [0.0, 0.0, 1.0]", "direction = [0, 0, -1]");
    place.refuses(&[
        &place.line_of("direction"),
        "approach.direction (0.00, 0.00, -1.00) faces bone",
        " 0 % of",
    ]);
}

#[test]
fn a_target_without_any_way_out_is_refused_when_the_approach_is_to_be_chosen() {
    let place =
        with_target([10..26, 12..26, 4..12]).with_case("[approach]\ndirection = [0.0, 0.0, 1.0]\n", "");
    place.refuses(&["case.toml: `approach.direction`", "reach no place at the target along any direction"]);
}

#[test]
fn a_slit_narrower_than_the_burr_is_refused() {
    let place = with_target([14..16, 12..26, 10..14]);
    place.refuses(&[
        &place.line_of("[target]"),
        NOTHING_REACHABLE,
        "bone outside the target",
        "burr's radius",
    ]);
}

#[test]
fn clearances_that_leave_nothing_are_refused() {
    let place = Place::healthy().with_case("clearance_mm = 1.0", "clearance_mm = 40.0");
    let parts = [NOTHING_REACHABLE, "the clearances of the structures", "structure.clearance_mm"];
    place.refuses(&[&[&*place.line_of("[target]")], &parts[..]].concat());
}

// a valid case that cannot be fulfilled: exit code 1

#[test]
fn a_patient_out_of_the_arms_reach_falls_short() {
    let far = "rate_hz = 100\nbase_from_ct = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [9000, 0, 0] }";
    let place = Place::healthy().with_case("rate_hz = 100", far);
    place.falls_short_of_a_plan(&[
        &place.line_of("base_from_ct"),
        "the arm cannot reach the target",
        "robot.base_from_ct",
    ]);
    let ran = place.run(&["plan", "case.toml", "--out", "plan", "--json"]);
    let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!((ran.code, &object["outcome"]), (1, &"fell_short".into()));
}

#[test]
fn a_time_that_cannot_be_met_is_a_plan_with_its_reason() {
    for (time, near) in [("0.5", "speed.total_time_s = 0.5 s"), ("1000000", "speed.total_time_s = 1000000 s")]
    {
        let place = Place::healthy().with_case("min_mm_s = 0.5", &format!("total_time_s = {time}"));
        let ran = place.plan();
        assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
        assert!(ran.err.contains("fell short: ") && ran.err.contains(near), "{}", ran.err);
        assert!(ran.err.contains("cannot be met"), "{}", ran.err);
        let [said, written] =
            ["will fall short: speed.total_time_s", "write files"].map(|part| ran.err.find(part));
        assert!(said.is_some() && said < written, "said before anything is written: {}", ran.err);
        let record = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
        assert!(record.contains("cannot be met"), "the plan says so too");
    }
}

// the output

#[test]
fn an_output_that_is_not_a_plan_is_never_touched() {
    let place = Place::healthy();
    fs::create_dir(place.path("mine")).unwrap();
    fs::write(place.path("mine/thesis.tex"), "text").unwrap();
    fs::write(place.path("file"), "text").unwrap();
    place.refuses_into("mine", &["mine", "exists and is not a plan", "choose another folder"]);
    place.refuses_into("file", &["file", "exists and is not a plan", "it is not a folder"]);
    place.refuses_into(".", &["the folder in which this runs"]); // the case's own folder
    // a plan's folder with a foreign file in it
    assert_eq!(place.plan().code, 0);
    fs::write(place.path("plan/notes.txt"), "text").unwrap();
    place.refuses(&["plan", "it also holds notes.txt, which would be lost"]);
    fs::remove_file(place.path("plan/notes.txt")).unwrap();
    assert_eq!(place.plan().code, 0, "a plan is replaced");
}

#[test]
fn bad_input_leaves_the_plan_that_stood_there() {
    let place = Place::healthy();
    assert_eq!(place.plan().code, 0);
    let place = place.with_ct(|ct| ct.fill([3..4, 5..7, 6..7], f32::NAN));
    place.refuses(&["voxel [3, 5, 6] is NaN"]);
    assert!(place.path("plan/plan.toml").exists());
}

#[test]
fn folders_on_the_way_to_the_output_are_only_made_for_a_plan() {
    let place = Place::healthy().with_ct(|ct| ct.fill([3..4, 5..7, 6..7], f32::NAN));
    place.refuses_into("new/deep/plan", &["voxel [3, 5, 6] is NaN"]);
    let ran = place.run(&["plan", "case.toml", "--out", "new/deep/plan", "--json"]);
    let object: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!((ran.code, &object["outcome"]), (2, &"error".into()));
    assert!(object["error"].as_str().unwrap().contains("voxel [3, 5, 6] is NaN"));
    assert!(!place.path("new").exists());
}

#[test]
fn a_folder_that_cannot_be_written_is_refused() {
    let place = Place::healthy();
    if Path::new("/proc/sys").exists() {
        // not even root can make a folder there
        place.refuses_into("/proc/sys/plan", &["cannot write into /proc/sys", "because: "]);
    } else {
        bonemill_geometry::testkit::skipped("there is no /proc");
    }
    fs::write(place.path("file"), "text").unwrap();
    place.refuses_into("file/plan", &["file"]);
}

#[test]
fn a_full_disk_leaves_nothing() {
    let place = Place::healthy();
    let disk = place.path("disk");
    fs::create_dir(&disk).unwrap();
    // there is room for the first files of a plan, but not for all
    for size in ["8k", "64k", "256k"] {
        let mount = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={size}"), "none"])
            .arg(&disk)
            .output();
        if !mount.is_ok_and(|o| o.status.success()) {
            bonemill_geometry::testkit::skipped("a small disk cannot be mounted here");
            return;
        }
        let ran = place.run(&["plan", "case.toml", "--out", "disk/plan"]);
        let left = fs::read_dir(&disk).unwrap().count();
        assert!(Command::new("umount").arg(&disk).status().unwrap().success());
        assert_eq!(left, 0, "{size}: left on the disk");
        ran.refused(&["disk", "because: ", "No space left on device"]);
    }
}
