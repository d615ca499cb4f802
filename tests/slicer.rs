//! A plan as a scene for 3D Slicer: every file is read back here without the writers' code, and compared with the plan and the body.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Read;

use crate::support::body;
use crate::support::image::Image;
use crate::support::place::Place;
use bonemill_planner::cutter::MoveKind;
use bonemill_planner::plan::{StoredPlan, Value};
use nalgebra::Vector3;

const BURR_MM: f64 = 1.5;
/// The burr holds before it comes so near to the nerve.
const HOLD: &str = "\n[[hold]]\nstructure = \"nerve\"\ndistance_mm = 3.0\n";
/// The name of a patient, as some converters leave it in a NIfTI header.
const PATIENT: &[u8] = b"DOE^JANE 1961-04-01";
/// Where a NIfTI header has 80 bytes of free text.
const DESCRIPTION: usize = 148;

/// The CT in another order of voxels than the world's axes.
fn ct() -> Image {
    body::ct().stored_as([2, 0, 1], [false, true, false])
}

/// A folder with the plan of a body whose CT is stored in another order than its labels and names a patient.
fn planned() -> (Place, StoredPlan) {
    let place = Place::healthy();
    place.put_ct(&ct());
    let place = place.with_bytes("ct.nii", |bytes| {
        bytes[DESCRIPTION..DESCRIPTION + PATIENT.len()].copy_from_slice(PATIENT);
    });
    let text = fs::read_to_string(place.path("case.toml")).unwrap();
    fs::write(place.path("case.toml"), text + HOLD).unwrap();
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    (place, plan)
}

fn exported() -> (Place, StoredPlan) {
    let (place, plan) = planned();
    let ran = place.run(&["export", "plan", "--format", "slicer", "--out", "scene"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    assert!(ran.out.contains("open plan.mrml in 3D Slicer"), "{}", ran.out);
    (place, plan)
}

/// Checks numbers that were read from text, of which serde_json's reader may lose the last bit.
#[track_caller]
fn same(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (n, (a, b)) in found.iter().zip(expected).enumerate() {
        assert!((a - b).abs() <= 1e-14 * (1.0 + b.abs()), "number {n}: {a} for {b}");
    }
}

/// From RAS+ to LPS and back.
fn mirrored([x, y, z]: [f64; 3]) -> [f64; 3] {
    [-x, -y, z]
}

/// Header fields and keys of a `.seg.nrrd`, and its voxels.
fn segments(bytes: &[u8]) -> (BTreeMap<String, String>, Vec<u8>) {
    let end = bytes.windows(2).position(|pair| pair == b"\n\n").unwrap();
    let text = std::str::from_utf8(&bytes[..end]).unwrap();
    let entry = |line: &str| {
        let (key, value) = line.split_once(":=").or_else(|| line.split_once(": "))?;
        Some((key.to_owned(), value.to_owned()))
    };
    let mut voxels = Vec::new();
    flate2::read::GzDecoder::new(&bytes[end + 2..]).read_to_end(&mut voxels).unwrap();
    (text.lines().filter_map(entry).collect(), voxels)
}

fn numbers(text: &str) -> Vec<f64> {
    text.split([' ', ',', '(', ')'])
        .filter(|word| !word.is_empty())
        .map(|word| word.parse().unwrap())
        .collect()
}

/// Distance of a point from the path, mm.
fn from_path(plan: &StoredPlan, p: Vector3<f64>) -> f64 {
    let off = |ends: &[bonemill_planner::plan::Waypoint]| {
        let (a, b) = (ends[0].position.coords, ends[1].position.coords);
        let way = b - a;
        let share = if way.norm_squared() > 0.0 { (p - a).dot(&way) / way.norm_squared() } else { 0.0 };
        (p - a - way * share.clamp(0.0, 1.0)).norm()
    };
    plan.waypoints.windows(2).map(off).fold(f64::INFINITY, f64::min)
}

/// Label of the body at a point of the world.
fn label_at(labels: &Image, p: [f64; 3]) -> u16 {
    let index = [0, 1, 2].map(|a| ((p[a] - labels.affine[a][3]) / labels.affine[a][a]).round());
    let inside = (0..3).all(|a| index[a] >= 0.0 && index[a] < labels.dims[a] as f64);
    let [i, j, k] = index.map(|v| v as usize);
    if inside { labels.values[i + labels.dims[0] * (j + labels.dims[1] * k)] as u16 } else { 0 }
}

#[test]
fn every_voxel_is_what_the_plan_makes_of_it_on_the_grid_of_the_ct() {
    let (place, plan) = exported();
    let (head, voxels) = segments(&fs::read(place.path("scene/plan.seg.nrrd")).unwrap());
    let ct = ct();
    // the CT's grid, seen from LPS
    assert_eq!(head["space"], "left-posterior-superior");
    assert_eq!(numbers(&head["sizes"]), ct.dims.map(|n| n as f64));
    assert_eq!(numbers(&head["space origin"]), mirrored([0, 1, 2].map(|row| ct.affine[row][3])));
    let axes: Vec<f64> = (0..3).flat_map(|a| mirrored([0, 1, 2].map(|row| ct.affine[row][a]))).collect();
    assert_eq!(numbers(&head["space directions"]), axes);

    let value = |name: &str| -> u8 {
        let n =
            (0..20).find(|n| head.get(&format!("Segment{n}_Name")).is_some_and(|own| own.starts_with(name)));
        n.map(|n| head[&format!("Segment{n}_LabelValue")].parse().unwrap())
            .unwrap_or_else(|| panic!("{name}: {head:?}"))
    };
    let [cavity, sweep, bone, nerve] =
        ["cavity", "sweep outside the target", "bone that remains", "nerve"].map(value);
    assert_eq!(head["Segment0_ID"], "cavity");
    assert!(head["Segment2_Tags"].contains("SCT^272673000^Bone"));
    let labels = body::labels();
    let [pocket, rod] = [body::TARGET, body::NERVE].map(|label| label as u16);
    // a border may lie half a voxel of the planning grid off
    let unsure_mm = 0.5 * 3f64.sqrt() * plan.record.case.grid.spacing_mm;
    let mut seen = BTreeMap::new();
    for (n, found) in voxels.iter().enumerate() {
        let [nx, ny, _] = ct.dims;
        let p = ct.world([n % nx, n / nx % ny, n / nx / ny].map(|v| v as f64));
        let off_mm = from_path(&plan, Vector3::from(p));
        if (off_mm - BURR_MM).abs() < unsure_mm {
            continue;
        }
        let (label, removed) = (label_at(&labels, p), off_mm < BURR_MM);
        let is_bone = ct.values[n] >= 200.0;
        let expected = match label {
            _ if removed && label == pocket => Some(cavity),
            _ if removed && is_bone => Some(sweep),
            _ if removed => Some(0),
            _ if label == rod => Some(nerve),
            // for one of the causes
            _ if label == pocket => None,
            _ if is_bone => Some(bone),
            _ => Some(0),
        };
        *seen.entry(expected).or_insert(0) += 1;
        match expected {
            Some(expected) => assert_eq!(*found, expected, "{p:?}, {off_mm} mm from the path, label {label}"),
            None => assert!(*found >= 4 && *found != nerve, "{p:?}: {found}"),
        }
    }
    for kind in [Some(cavity), Some(bone), Some(nerve), Some(0)] {
        assert!(seen.get(&kind).is_some_and(|count| *count > 10), "{kind:?} in {seen:?}");
    }
    // extents, and the same voxels as a label map with the same names
    for n in (0..20).map_while(|n| Some((n, head.get(&format!("Segment{n}_LabelValue"))?))) {
        let (n, label): (usize, u8) = (n.0, n.1.parse().unwrap());
        let mut extent = [f64::INFINITY, -1.0, f64::INFINITY, -1.0, f64::INFINITY, -1.0];
        for (at, _) in voxels.iter().enumerate().filter(|(_, v)| **v == label) {
            let [nx, ny, _] = ct.dims;
            for (a, v) in [at % nx, at / nx % ny, at / nx / ny].into_iter().enumerate() {
                extent[2 * a] = extent[2 * a].min(v as f64);
                extent[2 * a + 1] = extent[2 * a + 1].max(v as f64);
            }
        }
        if extent[1] >= 0.0 {
            assert_eq!(numbers(&head[&format!("Segment{n}_Extent")]), extent);
        }
        let names: BTreeMap<String, String> =
            serde_json::from_slice(&fs::read(place.path("scene/labels.json")).unwrap()).unwrap();
        assert_eq!(names[&label.to_string()], head[&format!("Segment{n}_Name")]);
    }
    let mut map = Vec::new();
    let packed = fs::read(place.path("scene/plan.nii.gz")).unwrap();
    flate2::read::GzDecoder::new(&packed[..]).read_to_end(&mut map).unwrap();
    assert!(map[352..] == voxels);
    let row = |n: usize| f64::from(f32::from_le_bytes(map[n..n + 4].try_into().unwrap()));
    for (r, c) in (0..12).map(|n| (n / 4, n % 4)) {
        assert_eq!(row(280 + 16 * r + 4 * c), ct.affine[r][c], "srow {r} {c}");
    }
}

#[test]
fn what_stays_of_the_target_is_as_much_for_each_cause_as_the_plan_states() {
    let (place, plan) = exported();
    let (head, voxels) = segments(&fs::read(place.path("scene/plan.seg.nrrd")).unwrap());
    let stated = plan.record.metrics.more.iter().find(|(name, _)| name == "not_removed_mm3").unwrap();
    let Value::Table(stated) = &stated.1 else { panic!("{stated:?}") };
    assert!(!stated.is_empty());
    let voxel_mm3 = body::SPACING_MM.powi(3);
    for (cause, mm3) in stated {
        let Value::Number(mm3) = mm3 else { panic!("{mm3:?}") };
        let n =
            (0..20).find(|n| head.get(&format!("Segment{n}_Name")) == Some(&format!("not removed: {cause}")));
        let label: u8 = head[&format!("Segment{}_LabelValue", n.unwrap())].parse().unwrap();
        let found_mm3 = voxels.iter().filter(|v| **v == label).count() as f64 * voxel_mm3;
        // CT and planning grid have voxels of one size, but not at the same places
        assert!((found_mm3 - mm3).abs() < 0.3 * mm3 + 8.0 * voxel_mm3, "{cause}: {found_mm3} of {mm3} mm³");
    }
    let cavity_mm3 = voxels.iter().filter(|v| **v == 1).count() as f64 * voxel_mm3;
    let removed_mm3 = plan.record.metrics.removed_mm3;
    assert!((cavity_mm3 / removed_mm3 - 1.0).abs() < 0.03, "{cavity_mm3} of {removed_mm3} mm³");
}

#[test]
fn curves_points_and_lines_are_the_plan_in_lps_with_its_speeds_and_forces() {
    let (place, plan) = exported();
    let read = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&fs::read(place.path("scene").join(name)).unwrap()).unwrap()
    };
    let first_cut = plan.waypoints.iter().position(|w| w.kind == MoveKind::Cut).unwrap();
    let toward = |n: usize| plan.waypoints[n].force_toward_n.unwrap_or(0.0);
    let ends = [("path.mrk.json", 0..plan.waypoints.len()), ("approach.mrk.json", 0..first_cut + 1)];
    for (name, range) in ends {
        let markup = &read(name)["markups"][0];
        assert_eq!((&markup["type"], &markup["coordinateSystem"]), (&"Curve".into(), &"LPS".into()));
        let points = markup["controlPoints"].as_array().unwrap();
        assert_eq!(points.len(), range.len());
        for (point, n) in points.iter().zip(range.clone()) {
            let at: [f64; 3] = serde_json::from_value(point["position"].clone()).unwrap();
            same(&mirrored(at), plan.waypoints[n].position.coords.as_slice());
        }
        let values = |m: usize| -> Vec<f64> {
            serde_json::from_value(markup["measurements"][m]["controlPointValues"].clone()).unwrap()
        };
        let of = |value: &dyn Fn(usize) -> f64| range.clone().map(value).collect::<Vec<f64>>();
        assert_eq!(markup["measurements"][0]["units"], "mm/s");
        same(&values(0), &of(&|n| plan.waypoints[n].driven_mm_s));
        same(&values(1), &of(&|n| plan.waypoints[n].force_n.norm()));
        same(&values(2), &of(&toward));
    }
    let holds = &read("holds.mrk.json")["markups"][0];
    assert_eq!(holds["controlPoints"][0]["label"], "hold 3 mm from nerve");
    let at: [f64; 3] = serde_json::from_value(holds["controlPoints"][0]["position"].clone()).unwrap();
    let hold = &bonemill_planner::plan::hold_points(&plan)[0];
    let before = plan.waypoints[hold.before_waypoint - 1].position.coords;
    same(&mirrored(at), before.as_slice());

    let text = fs::read_to_string(place.path("scene/forces.vtk")).unwrap();
    assert!(text.lines().nth(1).unwrap().contains("SPACE=LPS"));
    let block = |title: &str, count: usize| -> Vec<Vec<f64>> {
        let rows = text.lines().skip_while(|line| !line.starts_with(title)).skip(1);
        rows.filter(|line| !line.starts_with("LOOKUP")).take(count).map(numbers).collect()
    };
    let count = plan.waypoints.len();
    for (n, point) in block("POINTS", count).iter().enumerate() {
        assert_eq!(
            mirrored([point[0], point[1], point[2]]),
            <[f64; 3]>::from(plan.waypoints[n].position.coords)
        );
    }
    let column = |title: &str| block(title, count).concat();
    let of = |value: &dyn Fn(usize) -> f64| (0..count).map(value).collect::<Vec<f64>>();
    assert_eq!(column("SCALARS force_n"), of(&|n| plan.waypoints[n].force_n.norm()));
    assert_eq!(column("force_toward_n"), of(&toward));
    assert_eq!(column("driven_mm_s"), of(&|n| plan.waypoints[n].driven_mm_s));
    // every move lies in one line, and lines do not mix cuts and links
    let runs =
        numbers(text.lines().find(|line| line.starts_with("LINES")).unwrap().trim_start_matches("LINES "))[0];
    let (lines, cuts) = (block("LINES", runs as usize), block("is_cut", runs as usize).concat());
    let mut moves = Vec::new();
    for (line, is_cut) in lines.iter().zip(cuts) {
        assert_eq!(line.len() as f64, line[0] + 1.0);
        for pair in line[1..].windows(2) {
            assert_eq!(pair[1], pair[0] + 1.0);
            assert_eq!(plan.waypoints[pair[1] as usize].kind == MoveKind::Cut, is_cut == 1.0);
            moves.push(pair[1] as usize);
        }
    }
    assert_eq!(moves, (1..count).collect::<Vec<_>>());
}

/// Corners of an STL's box, as its file has them.
fn stl_box(bytes: &[u8]) -> [Vector3<f64>; 2] {
    assert!(bytes.starts_with(b"bonemill, mm, SPACE=LPS"));
    let number = |at: usize| f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
    let corner = |at: usize| Vector3::new(number(at), number(at + 4), number(at + 8));
    let facets = (bytes.len() - 84) / 50;
    let corners: Vec<_> = (0..facets).flat_map(|n| [12, 24, 36].map(|at| corner(84 + 50 * n + at))).collect();
    [corners.iter().fold(corners[0], |a, b| a.inf(b)), corners.iter().fold(corners[0], |a, b| a.sup(b))]
}

#[test]
fn left_stays_left_and_the_scene_refers_to_every_file() {
    let (place, plan) = exported();
    // the pocket reaches from -5.75 to 2.25 mm to the right, from -2.25 to 7.25 to the front, and the cavity nearly fills it
    let [low, high] = stl_box(&fs::read(place.path("scene/cavity.stl")).unwrap());
    for (found, expected) in [(low, [-2.25, -7.25, 10.25]), (high, [5.75, 2.25, 13.75])] {
        assert!((found - Vector3::from(expected)).amax() < 0.6, "{found} for {expected:?}");
    }
    // the tool's lowest point lies a radius below the path's beginning, and its handpiece out of the bone
    let [low, high] = stl_box(&fs::read(place.path("scene/tool.stl")).unwrap());
    let start = plan.waypoints[0].position;
    let axis = plan.waypoints[0].axis;
    assert!((low.z - (start.z() - BURR_MM)).abs() < 0.05 && high.z > start.z() + 60.0 * axis.z);
    // no registration is given, so no base is drawn
    assert!(!place.path("scene/arm_base.stl").exists());

    let text = fs::read_to_string(place.path("scene/plan.mrml")).unwrap();
    assert!(text.contains("has NOT passed a verification"));
    let referred: BTreeSet<&str> =
        text.split("fileName=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    let there: BTreeSet<String> = fs::read_dir(place.path("scene"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name != "plan.mrml" && name != "labels.json")
        .collect();
    let expected: BTreeSet<&str> = there.iter().map(String::as_str).chain(["../ct.nii"]).collect();
    assert_eq!(referred, expected);
    for entry in fs::read_dir(place.path("scene")).unwrap() {
        let bytes = fs::read(entry.unwrap().path()).unwrap();
        assert!(!bytes.windows(8).any(|part| part == &PATIENT[..8]), "a file names the patient");
    }
}

#[test]
fn a_registered_arm_has_a_base_at_its_place_and_a_verified_plan_says_so() {
    // at the place that is assumed where none is given
    let place = Place::healthy();
    assert_eq!(place.plan().code, 0);
    let text = fs::read_to_string(place.path("plan/plan.toml")).unwrap();
    let assumed = text.lines().find(|line| line.starts_with("base_from_ct")).unwrap();
    let place = Place::healthy().with_case("rate_hz = 100", &format!("rate_hz = 100\n{assumed}"));
    let plan = place.verified();
    let ran = place.run(&["export", "plan", "--format", "slicer", "--out", "scene"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let [low, high] = stl_box(&fs::read(place.path("scene/arm_base.stl")).unwrap());
    // a disc of 15 mm around the origin, with a rod of 40 mm along z
    let ct_from_base = plan.record.frames.base_from_ct.inverse();
    let z = ct_from_base.rotation * Vector3::z();
    let reach = z.map(|c| 15.0 * (1.0 - c * c).max(0.0).sqrt());
    let origin = ct_from_base.translation_mm;
    let end = origin + 40.0 * z;
    let rod = reach * (2.0 / 15.0);
    let corners = [origin - reach, origin + reach, end - rod, end + rod];
    let corners = corners.map(|corner| Vector3::from(mirrored(corner.into())));
    let expected =
        [corners.iter().fold(corners[0], |a, b| a.inf(b)), corners.iter().fold(corners[0], |a, b| a.sup(b))];
    for (found, expected) in [(low, expected[0]), (high, expected[1])] {
        assert!((found - expected).amax() < 0.3, "{found} for {expected}");
    }
    assert!(
        fs::read_to_string(place.path("scene/plan.mrml")).unwrap().contains("has passed its verification")
    );
}

#[test]
fn a_scene_is_written_whole_or_not_at_all_and_replaces_only_a_scene() {
    let (place, _) = exported();
    let export = |out: &str| place.run(&["export", "plan", "--format", "slicer", "--out", out]);
    let before = place.files();
    let ran = export("scene");
    assert_eq!(ran.code, 0, "{}", ran.err);
    assert!(before == place.files(), "the same plan gives the same bytes");
    fs::write(place.path("scene/notes.txt"), "mine").unwrap();
    let before = place.files();
    export("scene").refused(&["scene", "notes.txt, which would be lost"]);
    export("plan").refused(&[
        "plan",
        "a folder that `export --format slicer` wrote",
        "no readable plan.mrml",
    ]);
    export(".").refused(&["the folder in which this runs"]);
    place.run(&["export", "plan", "--format", "slicer", "--out", "b", "--rate", "100"]).refused(&["--rate"]);
    assert!(before == place.files());
    fs::remove_file(place.path("ct.nii")).unwrap();
    let before = place.files();
    export("other").refused(&["ct.nii"]);
    assert!(before == place.files());
}
