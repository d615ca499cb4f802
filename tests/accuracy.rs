//! The approximations' keys and levels: what a plan says that its forces err by, and what a level sets.

use crate::support::body;
use crate::support::figures::entry;
use crate::support::place::Place;
use bonemill_geometry::testkit::pocket::{TARGET, label};
use bonemill_planner::case::{Accuracy, Level};
use bonemill_planner::plan::{StoredPlan, Value};
use nalgebra::Vector3;
use rayon::prelude::*;

/// The plan made with `[accuracy]` keys.
fn planned(keys: &str) -> StoredPlan {
    let place = Place::healthy().with_case("[grid]\n", &format!("[accuracy]\n{keys}\n\n[grid]\n"));
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    StoredPlan::load(&place.path("plan")).unwrap()
}

fn error(plan: &StoredPlan, name: &str) -> f64 {
    match entry(&plan.record.modelled, &["force_error", name]) {
        Value::Number(share) => *share,
        Value::Integer(n) => *n as f64,
        other => panic!("{other:?} is no number"),
    }
}

#[test]
fn a_plan_says_what_its_forces_err_by_and_finer_sums_err_less() {
    let [coarse, default, fine] =
        ["force_elements = 8\nforce_directions = 64\nforce_change = 1.0", "", "level = \"fine\""]
            .map(planned);
    let of_cuts = [&coarse, &default, &fine].map(|plan| error(plan, "of_cuts"));
    assert!(of_cuts[0] > 5.0 * of_cuts[1] && of_cuts[1] > 1.2 * of_cuts[2], "{of_cuts:?}");
    assert!(of_cuts[1] < 0.03 && of_cuts[2] > 0.0, "{of_cuts:?}");
    for plan in [&coarse, &default, &fine] {
        // the mean over cuts errs by no more than the cuts
        assert!(error(plan, "mean") <= error(plan, "of_cuts") && error(plan, "cuts") > 20.0);
    }
}

#[test]
fn an_error_that_is_asked_for_sets_the_level_is_kept_and_a_miss_is_told() {
    // the cheapest level keeps it
    let preview = planned("force = 0.03");
    let errs = |plan: &StoredPlan| error(plan, "of_cuts").max(error(plan, "toward"));
    assert_eq!(preview.record.case.accuracy.level, Level::Coarse);
    assert!(error(&preview, "elements") == 32.0 && errs(&preview) <= 0.03, "{}", errs(&preview));
    // a level that errs more on this body is summed more finely
    let given = planned("level = \"coarse\"");
    let asked = 0.8 * errs(&given);
    let refined = planned(&format!("level = \"coarse\"\nforce = {asked}"));
    assert_eq!((error(&refined, "elements"), refined.record.case.accuracy.force_elements), (64.0, 32));
    assert!(errs(&refined) <= asked, "{} instead of {asked}", errs(&refined));
    // and what cannot be kept is a shortfall
    let place =
        Place::healthy().with_case("[grid]\n", "[accuracy]\nlevel = \"coarse\"\nforce = 0.0005\n\n[grid]\n");
    let ran = place.plan();
    assert_eq!(ran.code, 1, "{}", ran.err);
    let page = std::fs::read_to_string(place.path("plan/report.html")).unwrap();
    for text in [ran.out + &ran.err, page] {
        assert!(text.contains("accuracy.force = 0.0005 is missed: over "), "{text}");
    }
}

#[test]
fn the_error_of_the_removed_volume_is_that_of_a_count_of_points_and_a_miss_is_told() {
    const PARTS: usize = 8;
    let asked = "removed = 0.0001\ndistance_mm = 0.2";
    let place = Place::healthy().with_case("[grid]\n", &format!("[accuracy]\n{asked}\n\n[grid]\n"));
    let ran = place.plan();
    assert_eq!(ran.code, 1, "{}", ran.err);
    let (missed, kept) =
        ("accuracy.removed = 0.0001 is missed: the removed volume errs by ", "accuracy.distance_mm");
    assert!(ran.err.contains(missed) && !ran.err.contains(kept), "{}", ran.err);
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    let ways: Vec<[Vector3<f64>; 2]> =
        plan.waypoints.windows(2).map(|w| [w[0].position.coords, w[1].position.coords]).collect();
    let radius_mm = plan.record.case.burr.radius_mm;
    let is_removed = |p: &Vector3<f64>| {
        ways.iter().any(|[a, b]| {
            let d = b - a;
            let share =
                if d.norm() > 0.0 { ((p - a).dot(&d) / d.norm_squared()).clamp(0.0, 1.0) } else { 0.0 };
            (p - a - d * share).norm() <= radius_mm
        })
    };
    let counts = (0..body::DIMS.iter().product()).into_par_iter().filter_map(|n: usize| {
        let voxel =
            [n % body::DIMS[0], n / body::DIMS[0] % body::DIMS[1], n / (body::DIMS[0] * body::DIMS[1])];
        (label(voxel) == TARGET).then(|| {
            let part = |part: usize| {
                let at = [part % PARTS, part / PARTS % PARTS, part / (PARTS * PARTS)];
                let along = |a: usize| voxel[a] as f64 + (at[a] as f64 + 0.5) / PARTS as f64 - 0.5;
                Vector3::from_fn(|a, _| body::ORIGIN_MM[a] + body::SPACING_MM * along(a))
            };
            [(0..PARTS.pow(3)).filter(|n| is_removed(&part(*n))).count(), PARTS.pow(3)]
        })
    });
    let [removed, all] = counts.reduce(|| [0; 2], |a, b| [a[0] + b[0], a[1] + b[1]]);
    let counted = removed as f64 / all as f64;
    let stated = plan.record.metrics.removed_mm3 / plan.record.metrics.target_mm3;
    let Value::Number(error) = entry(&plan.record.modelled, &["path_error", "removed"]) else {
        panic!("no number")
    };
    // parts of voxels themselves are counted to about a thousandth
    assert!((stated + error - counted).abs() < 2e-3, "{stated} {error} {counted}");
    assert!(error.abs() > 1e-2, "{error}");
}

#[test]
fn a_level_sets_what_the_case_leaves_out_and_verify_accepts_a_preview() {
    let place = Place::healthy().with_case("spacing_mm = 0.5\n", "").with_case("step_mm = 0.5\n", "");
    let place = place.with_case("[grid]\n", "[accuracy]\nlevel = \"coarse\"\nforce_elements = 40\n");
    let case = place.verified().record.case;
    let found = (case.grid.spacing_mm, case.path.step_mm, case.accuracy);
    assert_eq!(found, (0.5, 0.5, Accuracy { force_elements: 40, ..Accuracy::of(Level::Coarse) }));
    let unknown = place.with_case("level = \"coarse\"", "level = \"rough\"");
    unknown.refuses(&["accuracy.level", "rough", "`default` or `coarse` or `fine`"]);
}

#[test]
fn a_level_on_the_command_line_is_a_case_of_its_own_in_the_plan() {
    let place = Place::healthy().with_case("spacing_mm = 0.5", "spacing_mm = 0.4");
    let before = std::fs::read(place.path("case.toml")).unwrap();
    let ran = place.run(&["plan", "case.toml", "--accuracy", "coarse", "--out", "preview"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let preview = StoredPlan::load(&place.path("preview")).unwrap();
    assert_eq!(preview.record.case.accuracy.level, Level::Coarse);
    // grid and step are the level's, though the case gives them
    assert_eq!(preview.record.case.grid.spacing_mm, 0.5);
    assert_eq!(std::fs::read(place.path("case.toml")).unwrap(), before);
    assert_eq!(preview.record.case_file, std::path::Path::new("inputs/case.toml"));
    let ran = place.run(&["verify", "preview"]);
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    // the same as a case that says so, from any folder
    let same = Place::healthy();
    let text = String::from_utf8(before).unwrap();
    let kept = text.lines().filter(|l| !l.starts_with("spacing_mm") && !l.starts_with("step_mm"));
    let text = kept.collect::<Vec<_>>().join("\n") + "\n[accuracy]\nlevel = \"coarse\"\n";
    std::fs::write(same.path("case.toml"), text).unwrap();
    assert_eq!(same.plan().code, 0);
    for file in ["waypoints.csv", "trajectory.csv"] {
        let [a, b] =
            [place.path("preview"), same.path("plan")].map(|dir| std::fs::read(dir.join(file)).unwrap());
        assert!(a == b, "{file}");
    }
    let ran = place.run(&["plan", "case.toml", "--accuracy", "rough", "--out", "other"]);
    assert!(ran.code == 2 && ran.err.contains("[possible values: coarse, default, fine]"), "{}", ran.err);
}
