//! Forces toward structures: the choices that change them, and the comparison with a straight shaft at constant speed.

use std::fs;

use crate::support::figures::figure;
use crate::support::{body, place::Place};
use bonemill_planner::cutter::MoveKind;
use bonemill_planner::plan::{StoredPlan, Waypoint};

/// A case in which nothing is chosen: straight shaft, one speed, lines along work x.
const STILL: &str = "[orientation]\nmode = \"fixed\"\n\n[speed]\nmode = \"constant\"\n";

fn planned(place: &Place) -> StoredPlan {
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    StoredPlan::load(&place.path("plan")).unwrap()
}

/// The patient with a nerve along a whole wall of the pocket.
fn beside_a_wall() -> Place {
    Place::healthy().with_labels(|labels| labels.fill([30..32, 12..26, 14..20], body::NERVE))
}

fn still(path_keys: &str) -> Place {
    beside_a_wall()
        .with_case("[speed]\n", STILL)
        .with_case("step_mm = 0.5\n", &format!("step_mm = 0.5\nraster_deg = 90\n{path_keys}\n"))
}

/// Mean force along the feed over the length of cuts, N: the teeth pull the burr forward in climb cuts and backward in
/// conventional cuts.
fn along_feed_n(plan: &StoredPlan) -> f64 {
    let (mut sum, mut length) = (0.0, 0.0);
    for pair in plan.waypoints.windows(2) {
        let feed = pair[1].position - pair[0].position;
        if pair[1].mass_mg > 0.0 && feed.norm() > 1e-6 {
            sum += pair[1].force_n.dot(&feed);
            length += feed.norm();
        }
    }
    sum / length
}

/// Tested in layers as deep as the burr and in thin ones, where only the lower half of the burr cuts.
#[test]
fn climb_cuts_pull_the_burr_along_whichever_way_it_turns() {
    for (spin, layer) in [("spin = -1", "layer_mm = 1.5"), ("spin = 1", "layer_mm = 0.75")] {
        let of = |sense: &str| {
            let place = still(&format!("sense = \"{sense}\""));
            along_feed_n(&planned(&place.with_case("spin = -1", spin).with_case("layer_mm = 1.5", layer)))
        };
        let [climb, both, conventional] = ["climb", "both", "conventional"].map(of);
        assert!(climb > both && both > conventional, "{spin}: {climb} {both} {conventional} N");
        assert!(climb - conventional > 0.03, "{spin}: {climb} {conventional} N");
    }
}

#[test]
fn passes_that_push_away_push_less_toward_the_nerve() {
    let near = |sense: &str| {
        let plan = planned(&still(&format!("sense = \"{sense}\"")));
        let keys = ["structures", "nerve", "near", "mean_force_toward_with_zeros_n"];
        (figure(&plan.record, &keys), plan.record.metrics.removed_mm3)
    };
    let [(away, removed), (both, removed_before)] = [near("away"), near("both")];
    assert!(away < 0.8 * both, "{away} N, to and fro {both} N");
    assert!((removed - removed_before).abs() < 0.01 * removed_before, "{removed} mm³, {removed_before} mm³");
}

#[test]
fn a_burr_that_turns_both_ways_takes_the_gentler() {
    let peak = |spin: &str| {
        let place = still("sense = \"both\"").with_case("spin = -1", spin);
        let plan = planned(&place);
        let near = figure(&plan.record, &["structures", "nerve", "near", "mean_force_toward_with_zeros_n"]);
        let verified = place.run(&["verify", "plan"]);
        assert_eq!(verified.code, 0, "{spin}: {}{}", verified.out, verified.err);
        (near, plan)
    };
    let (forward, _) = peak("spin = -1");
    let (reverse, _) = peak("spin = 1");
    assert!((forward - reverse).abs() > 1e-3, "the two spins are alike: {forward} {reverse} N");
    let gentler = if forward < reverse { (forward, -1) } else { (reverse, 1) };
    // whichever way the case gives, the plan tells what it was given and what it chose
    for given in [-1, 1] {
        let (chosen, plan) = peak(&format!("spin = {given}\nturns = \"both_ways\""));
        assert_eq!(
            (chosen, plan.record.burr().spin, plan.record.case.burr.spin),
            (gentler.0, gentler.1, given)
        );
    }
}

/// With a fixed shaft, one speed and lines to and fro, the plan equals its control, except for the coarser sum of the control's
/// forces.
#[test]
fn a_straight_plan_at_constant_speed_is_its_control() {
    let plan = planned(&still("sense = \"both\""));
    for key in ["mean_force_toward_with_zeros_n", "peak_force_toward_n"] {
        let of = |who| figure(&plan.record, &["compared", who, "near", "nerve", key]);
        let (control, ours) = (of("control_1"), of("plan"));
        assert!((control - ours).abs() < 0.05 * control, "{key}: {control} {ours} N");
    }
    let speed = figure(&plan.record, &["compared", "control_1", "speed_mm_s"]);
    assert!((speed - 1.5).abs() < 0.02, "{speed} mm/s");
}

/// Whether the plan's force toward the nerve is larger than that of the better control, and whether the plan states it.
fn is_worse_and_says_so(plan: &StoredPlan) -> [bool; 2] {
    let near = |who: &str, key| figure(&plan.record, &["compared", who, "near", "nerve", key]);
    let figures = ["mean_force_toward_n", "mean_force_toward_with_zeros_n", "peak_force_toward_n"];
    let is_worse = figures
        .iter()
        .any(|f| near("plan", f) > near("control_1", f).min(near("control_2", f)).max(0.01) * (1.0 + 1e-6));
    [is_worse, plan.record.warnings.iter().any(|w| w.contains("pushes more than a straight shaft"))]
}

/// Cutting in one sense pushes toward the nerve along its whole wall, and the case leaves no choice that could help.
#[test]
fn a_plan_that_must_push_more_than_its_controls_says_so() {
    let found = ["climb", "conventional"].map(|sense| {
        let place = still(&format!("sense = \"{sense}\""));
        let plan = planned(&place);
        let [is_worse, is_said] = is_worse_and_says_so(&plan);
        assert_eq!(is_worse, is_said, "{sense}");
        // the highest priority that there is counts, whatever its number
        let second = planned(&place.with_case("label = 7\n", "label = 7\npriority = 2\n"));
        assert_eq!(is_worse_and_says_so(&second)[1], is_said, "{sense}, priority 2");
        let mean_n = figure(&plan.record, &["structures", "nerve", "near", "mean_force_toward_with_zeros_n"]);
        (mean_n, is_said)
    });
    let [(one_n, is_said), (other_n, is_also_said)] = found;
    assert!(is_said || is_also_said);
    assert!(
        one_n.max(other_n) > 1.5 * one_n.min(other_n),
        "one pushes toward the nerve, the other away: {found:?}"
    );
}

/// The time of a plan is that of the faster of two plain ones, which are planned here by themselves; its references take the same time, and
/// no judged figure is above that of the straight shaft with the least force.
#[test]
fn a_plan_takes_the_time_of_a_plain_one_and_is_nowhere_above_a_straight_shaft() {
    let place = beside_a_wall();
    let plan = planned(&place);
    let of = |who: &str, key: &str| figure(&plan.record, &["compared", who, key]);
    let total_s = plan.record.metrics.total_time_s;
    for who in ["control_1", "control_2", "straight"] {
        assert!(
            (of(who, "total_time_s") - total_s).abs() < 1e-3 * total_s,
            "{who}: {}",
            of(who, "total_time_s")
        );
    }
    // lines in one order and in the other, which an angle does not tell: one of them is that of the faster control
    let plain_s = ["control_1", "control_2"].map(|who| {
        [0.0, 180.0].map(|more| {
            let raster_deg = of(who, "raster_deg") + more;
            let lines = format!("step_mm = 0.5\nsense = \"both\"\nraster_deg = {raster_deg:?}\n");
            let plain = beside_a_wall().with_case("[speed]\n", STILL).with_case("step_mm = 0.5\n", &lines);
            planned(&plain).record.metrics.total_time_s
        })
    });
    let off = plain_s.as_flattened().iter().map(|plain_s| (total_s / plain_s - 1.0).abs());
    assert!(off.fold(f64::INFINITY, f64::min) < 0.005, "{total_s} s, plain plans {plain_s:?}");
    let least_s = plain_s.as_flattened().iter().copied().fold(f64::INFINITY, f64::min);
    assert!(total_s < 1.02 * least_s, "{total_s} s, plain plans {plain_s:?}");
    let toward = |who: &str, key: &str| figure(&plan.record, &["compared", who, "near", "nerve", key]);
    for key in ["mean_force_toward_n", "mean_force_toward_with_zeros_n", "peak_force_toward_n"] {
        let (ours, straight) = (toward("plan", key), toward("straight", key));
        assert!(ours <= 1.02 * straight.max(1e-3), "{key}: {ours} {straight} N");
    }
    assert!(of("plan", "mean_force_n") <= of("straight", "mean_force_n") * 1.001);
    let peaks = ["plan", "straight", "control_1"].map(|who| of(who, "peak_force_n"));
    assert!(peaks[0] <= peaks[1] * 1.02, "peaks {peaks:?}");
    assert!(of("plan", "peak_force_n") < of("control_1", "peak_force_n"));
    // no cap that the arm does not reach, but the slowest
    let least_mm_s = plan.record.case.speed.min_mm_s;
    let is_reached = |w: &&Waypoint| w.speed_mm_s <= (1.05 * w.driven_mm_s).max(least_mm_s);
    let cuts = plan.waypoints.iter().filter(|w| w.kind == MoveKind::Cut && w.driven_mm_s > 0.0);
    assert_eq!(cuts.clone().find(|w| !is_reached(w)), None);
    assert!(cuts.count() > 100);
}

/// A cap on force slows what pushes, not the moves on the way.
#[test]
fn under_force_caps_what_cuts_nothing_does_not_crawl() {
    let place = Place::healthy().with_case("[speed]\n", "[speed]\nmode = \"force_limited\"\nforce_n = 0.9\n");
    // what it cannot keep is another matter
    place.plan();
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    let least_mm_s = plan.record.case.speed.min_mm_s;
    // links touch what lies between the grid's voxels, with less than the cap
    let is_idle = |w: &&Waypoint| w.mass_mg == 0.0 && w.peak_force_n < 0.45;
    let idle: Vec<&Waypoint> = plan.waypoints.iter().skip(1).filter(is_idle).collect();
    assert!(idle.len() > 20, "{} moves cut nothing", idle.len());
    let slow = idle.iter().filter(|w| w.speed_mm_s < least_mm_s).count();
    assert_eq!(slow, 0, "of {}", idle.len());
}

#[test]
fn the_report_shows_the_controls_and_a_sentence_for_each_choice() {
    let place = Place::healthy();
    let plan = planned(&place);
    let page = fs::read_to_string(place.path("plan/report.html")).unwrap();
    let peak = figure(&plan.record, &["compared", "control_2", "peak_force_n"]);
    assert!(page.contains(&format!("<td>{peak:.3}</td>")));
    for part in [
        "Lines run at",
        "Passes are",
        "The burr turns forward",
        "The shaft is turned so that",
        "Speeds: the least force",
    ] {
        assert!(page.contains(part), "{part}");
    }
}

/// For a compliant arm, the deflection toward a structure counts.
#[test]
fn counting_the_deflection_lowers_the_deflection_toward_the_nerve() {
    let near = |force: &str| {
        let place = beside_a_wall()
            .with_case("[speed]\n", &format!("[cost]\nforce = \"{force}\"\n\n[speed]\n"))
            .with_case("rate_hz = 100", "rate_hz = 100\njoint_stiffness = [60.0, 300.0, 300.0, 2e4]");
        let plan = planned(&place);
        let radius_mm = plan.record.case.burr.radius_mm;
        let rows = plan
            .forces
            .iter()
            .filter(|f| f.distance_mm - radius_mm <= 2.0 && plan.waypoints[f.waypoint].mass_mg > 0.0);
        let um: Vec<f64> = rows.map(|f| f.deflection_toward_um.unwrap()).collect();
        assert!(um.len() > 30, "{} rows", um.len());
        (um.iter().sum::<f64>() / um.len() as f64, um.iter().copied().fold(0.0, f64::max))
    };
    let [(mean, peak), (mean_cutting, peak_cutting)] = [near("deflection"), near("cutting")];
    assert!(
        mean < mean_cutting && peak <= peak_cutting,
        "{mean} {peak} µm, {mean_cutting} {peak_cutting} µm"
    );
}
