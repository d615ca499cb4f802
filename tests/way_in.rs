//! An approach that the case leaves out is chosen, told, and as good as an expert's; where the arm's place is given, the arm can take it.

use std::fs;

use bonemill_planner::plan::StoredPlan;
use nalgebra::{Rotation3, Vector3};

use crate::support::place::Place;

const GIVEN: &str = "[approach]\ndirection = [0.0, 0.0, 1.0]\n";

/// A plan that passes `verify`, and the removed share of the target.
fn planned(place: &Place) -> (StoredPlan, f64) {
    let plan = place.verified();
    let share = plan.record.metrics.number("removed_share").unwrap();
    (plan, share)
}

#[test]
fn a_direction_that_is_left_out_is_chosen_and_removes_what_an_expert_s_does() {
    let (_, expert) = planned(&Place::healthy());
    let place = Place::healthy().with_case(GIVEN, "");
    let (plan, share) = planned(&place);
    // a grid along the scan, as the expert's, lets the burr half a voxel of 0.5 mm deeper on every face
    assert!(share > expert - 0.05, "{share}, along an expert's direction {expert}");
    let said = plan.record.warnings.iter().find(|said| said.starts_with("approach.direction is not given"));
    assert!(said.is_some_and(|said| said.contains(" was chosen")), "{:?}", plan.record.warnings);
    let report = fs::read_to_string(place.path("plan/report.html")).unwrap();
    assert!(report.contains("approach.direction is not given"));
}

#[test]
fn a_ur_whose_place_is_given_can_hold_the_tool_along_the_way_in() {
    let arm = "rate_hz = 100\nmodel = \"ur5e\"\n\
               flange_from_burr = { translation_mm = [0, 0, 180], rpy_rad = [3.141592653589793, 0, 0] }\n\
               base_from_ct = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [850, 0, 200] }";
    let (plan, share) = planned(&Place::healthy().with_case(GIVEN, "").with_case("rate_hz = 100", arm));
    let said = plan.record.warnings.iter().find(|said| said.starts_with("approach.direction is not given"));
    assert!(
        said.is_some_and(|said| said.contains("held by the arm where it stands")),
        "{:?}",
        plan.record.warnings
    );
    assert!(share > 0.9, "{share}");
}

/// The pocket's middle lies at the base's origin; the base leans, so that the pocket's normal is not among the arm's shaft axes.
#[test]
fn a_bone_attached_arm_whose_place_is_given_is_approached_across_its_hinge() {
    let base_from_ct = Rotation3::from_axis_angle(&Vector3::x_axis(), 20f64.to_radians());
    let at_mm = -(base_from_ct * Vector3::new(-1.5, 1.5, 12.0));
    let rows: Vec<Vec<f64>> =
        base_from_ct.matrix().row_iter().map(|row| row.iter().copied().collect()).collect();
    let at_mm: [f64; 3] = at_mm.into();
    let arm = format!("rate_hz = 100\nbase_from_ct = {{ rotation = {rows:?}, translation_mm = {at_mm:?} }}");
    let (plan, share) = planned(&Place::healthy().with_case(GIVEN, "").with_case("rate_hz = 100", &arm));
    let hinge = base_from_ct.inverse() * Vector3::y();
    assert!(plan.record.frames.approach_direction.dot(&hinge).abs() < 1e-9);
    assert!(share > 0.9, "{share}");
}

/// A metre is less than the UR5e's links and the tool are long together, but more than it reaches.
#[test]
fn a_target_that_the_arm_cannot_reach_is_refused_before_a_path_is_laid() {
    let arm = "rate_hz = 100\nmodel = \"ur5e\"\n\
               flange_from_burr = { translation_mm = [0, 0, 12], rpy_rad = [3.141592653589793, 0, 0] }\n\
               base_from_ct = { rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]], translation_mm = [1000, 0, 0] }";
    let ran = Place::healthy().with_case("rate_hz = 100", arm).run(&["plan", "case.toml", "--out", "plan"]);
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    for words in
        ["`robot.base_from_ct`: the arm reaches none of", "of the approach", "only 12.00 mm from the flange"]
    {
        assert!(ran.err.contains(words), "{words} is missing in {}", ran.err);
    }
    assert!(!ran.err.contains("lines"), "{}", ran.err);
}
