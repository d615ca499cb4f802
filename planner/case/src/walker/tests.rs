//! What is told of a number that is out of range or of another type: its unit, and the unit that it looks like.

use std::path::Path;

use crate::Case;

#[track_caller]
fn told(more: &str) -> String {
    let text = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";
    Case::parse(&format!("{text}{more}"), Path::new("case.toml")).unwrap_err().to_string()
}

#[test]
fn angles_in_the_other_unit_are_told_so() {
    let flange = "[robot.flange_from_burr]\ntranslation_mm = [0,0,180]\n";
    for (more, says) in [
        (
            format!("{flange}rpy_rad = [-180,0,0]\n"),
            "`robot.flange_from_burr.rpy_rad[0]` = -180: expected -10 to 10 rad; it looks like degrees, which would be \
             -3.141592653589793 here",
        ),
        (
            "[robot.base_from_ct]\ntranslation_mm = [0,0,0]\nrpy_rad = [0,180,0]\n".into(),
            "looks like degrees, which would be 3.141592653589793 here",
        ),
        (
            "[tool]\nkind = \"drill\"\n[drill]\npoint_deg = 1.0\n".into(),
            "looks like radians, which would be 57.29",
        ),
    ] {
        assert!(told(&more).contains(says), "{}", told(&more));
    }
}

#[test]
fn per_cent_is_a_hint_for_shares_only() {
    assert!(told("[cost]\nalpha_max = 80\n").ends_with("it looks like per cent, which would be 0.8 here"));
    for (more, says) in [
        ("[burr]\nflutes = 100\n", "`burr.flutes` = 100: expected 1 to 64"),
        ("[material]\nexponent = 60\n", "`material.exponent` = 60: expected 0 to 5"),
        (
            "[robot.base_from_ct]\nquaternion_wxyz = [2,0,0,0]\ntranslation_mm = [0,0,0]\n",
            "has length 2; expected a unit quaternion [w, x, y, z], length 1 within 0.001",
        ),
    ] {
        assert!(told(more).ends_with(says), "{}", told(more));
    }
}

#[test]
fn no_unit_is_told_where_there_is_none() {
    assert!(told("[burr]\nflutes = true\n").ends_with("`burr.flutes` is true; expected a number"));
    assert!(
        told("[burr]\nradius_mm = true\n").ends_with("`burr.radius_mm` is true; expected a number in mm")
    );
    let direction = told("[approach]\ndirection = 3\n");
    assert!(
        direction.ends_with("`approach.direction` is the number 3; expected a list of numbers"),
        "{direction}"
    );
}
