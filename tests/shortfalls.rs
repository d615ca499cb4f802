//! A plan that misses a guarantee or a figure of its case says so, with the figure and the reason, and `verify` agrees.

use crate::support::place::{Place, Ran};
use bonemill_planner::plan::{StoredPlan, Value};

/// The healthy patient with keys at the top of some tables.
fn with(tables: &[(&str, &str)]) -> Place {
    let add = |place: Place, (table, keys): &(&str, &str)| match *table {
        "orientation" => place.with_case("[robot]\n", &format!("[orientation]\n{keys}\n\n[robot]\n")),
        _ => place.with_case(&format!("[{table}]\n"), &format!("[{table}]\n{keys}\n")),
    };
    tables.iter().fold(Place::healthy(), add)
}

fn modelled(place: &Place, name: &str) -> i64 {
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    match plan.record.modelled(name) {
        Some(Value::Integer(count)) => *count,
        other => unreachable!("{name} = {other:?}"),
    }
}

/// The one shortfall of a plan.
#[track_caller]
fn only_shortfall(ran: &Ran) -> &str {
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    let told: Vec<&str> = ran.err.lines().filter_map(|line| line.strip_prefix("fell short: ")).collect();
    assert_eq!(told.len(), 1, "{}", ran.err);
    told[0]
}

/// Axes that are chosen for each waypoint alone, or not at all, may need turns on which the shank meets bone.
#[test]
fn turns_on_which_the_shank_is_not_free_are_a_shortfall_in_every_mode() {
    let thin = "[[25.0, 0.7], [60.0, 6.0]]";
    for (mode, limit, shank, are_free) in [
        ("greedy", 45, thin, false),
        ("greedy", 12, thin, true),
        ("fixed", 45, "[[12.0, 1.2], [60.0, 4.0]]", false),
        ("fixed", 45, thin, true),
    ] {
        let keys = format!("mode = \"{mode}\"\ntilt_limit_deg = {limit}");
        let place = with(&[("orientation", &keys), ("speed", "mode = \"constant\"")]).with_case(thin, shank);
        let ran = place.plan();
        let turns = modelled(&place, "blocked_turns");
        assert_eq!((ran.code == 0, turns == 0), (are_free, are_free), "{mode}, {shank}: {}", ran.err);
        let told = format!("fell short: the shank cannot turn as it must on {turns} moves");
        assert_eq!(ran.err.contains(&told), !are_free, "{mode}, {shank}: {}", ran.err);
        assert_eq!(place.run(&["verify", "plan"]).code, ran.code, "{mode}, {shank}");
    }
}

#[test]
fn a_time_that_the_joints_do_not_allow_names_the_joint_and_its_limit() {
    let slow = "total_time_s = 60\nmode = \"constant\"";
    let place = with(&[
        ("orientation", "mode = \"fixed\""),
        ("speed", slow),
        ("robot", "velocity_limits = [20, 0.4, 20, 1]"),
    ]);
    let ran = place.plan();
    let told = only_shortfall(&ran);
    for part in [
        "speed.total_time_s = 60 s cannot be met: the shortest time is ",
        "N; the joints' limits are the reason, most of all those of y, ",
        "chiefly of its velocity: with speed.max_mm_s = ",
    ] {
        assert!(told.contains(part), "{part}: {told}");
    }
}

#[test]
fn a_time_that_the_speeds_or_the_caps_do_not_allow_says_which() {
    let fixed = ("orientation", "mode = \"fixed\"");
    for (speed, reason) in [
        ("total_time_s = 5\nmode = \"constant\"", "the speed range is the reason: with speed.max_mm_s = "),
        ("total_time_s = 9000\nmode = \"constant\"", "no cut is slower than speed.min_mm_s = 0.5 mm/s"),
        (
            "total_time_s = 100\nmode = \"force_limited\"\nforce_n = 0.9",
            "the caps of the case are the reason (speed.force_n = 0.9 N, ",
        ),
    ] {
        let ran = with(&[fixed, ("speed", speed)]).plan();
        assert!(only_shortfall(&ran).contains(reason), "{reason}: {}", ran.err);
    }
}

#[test]
fn a_cap_that_no_speed_keeps_is_named_with_its_figure() {
    let speed = "mode = \"force_limited\"\nforce_n = 0.01\npower_w = 0.001";
    let place = with(&[("orientation", "mode = \"fixed\""), ("speed", speed)]);
    let ran = place.plan();
    assert_eq!(ran.code, 1, "{}{}", ran.out, ran.err);
    for part in [
        " moves break speed.force_n even at the least speed; the worst, waypoint ",
        " moves break speed.power_w even at the least speed; the worst, waypoint ",
        " W at 0.5 mm/s instead of at most 0.001 W, and would need ",
        " N at 0.5 mm/s instead of at most 0.010 N, and would need ",
    ] {
        assert!(ran.err.contains(part), "{part}: {}", ran.err);
    }
    let found = place.run(&["verify", "plan"]).out;
    for check in [
        "force asked for (speed.force_n)",
        "driven force asked for (speed.force_n)",
        "driven force asked for (speed.power_w)",
    ] {
        assert!(found.contains(&format!("FAIL  {check}: ")), "{check}: {found}");
    }
}

#[test]
fn the_layers_of_a_plan_are_those_of_its_waypoints() {
    let place = with(&[("orientation", "mode = \"fixed\"")]);
    assert_eq!(place.plan().code, 0);
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    let last = plan.waypoints.iter().map(|w| w.layer).max().unwrap();
    assert_eq!(modelled(&place, "layers"), i64::from(last) + 1);
    let compared = place.run(&["compare", "plan", "plan", "--all"]).out;
    let told = compared.lines().find(|line| line.split_whitespace().next() == Some("layers")).unwrap();
    assert_eq!(told.split_whitespace().nth(1), Some((last + 1).to_string().as_str()), "{told}");
}
