//! `bonemill report`: a run's log beside its plan, with errors that are known because the log is made here.

use std::fmt::Write;
use std::fs;

use crate::support::place::Place;
use bonemill_planner::plan::{Sha256, StoredPlan};

const UR: &str = "rate_hz = 500\nmodel = \"ur5e\"\n\
                  flange_from_burr = { translation_mm = [0, 0, 180], rpy_rad = [3.141592653589793, 0, 0] }";
/// How many rows the arm is behind.
const BEHIND: usize = 17;
/// By how much its first joint is off, rad.
const OFF_RAD: f64 = 5e-4;

/// What the run saw as the farthest off its path, between two entries, mm.
const FARTHEST_MM: f64 = 4.321;

/// CRC-32 (IEEE 802.3), bit by bit.
fn crc32(text: &str) -> u32 {
    !text.bytes().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| (crc >> 1) ^ (0xEDB8_8320 & (crc & 1).wrapping_neg()))
    })
}

fn line(log: &mut String, text: &str) {
    writeln!(log, "{text},{:08x}", crc32(text)).unwrap();
}

fn cells(q: &[f64]) -> String {
    q.iter().map(|v| format!("{v:.9}")).collect::<Vec<_>>().join(",")
}

/// A run of the first `rows` rows by an arm that is late and off, logged every fifth row.
fn log(plan: &StoredPlan, rows: usize) -> String {
    let digest = Sha256::of_file(&plan.dir.join("trajectory.csv")).unwrap();
    let mut log = String::new();
    line(&mut log, &format!("bonemill-run,1,{digest},{},0.002", plan.trajectory.len()));
    line(&mut log, "E,0.000000,connect");
    for row in (0..rows).step_by(5) {
        let reached = row.saturating_sub(BEHIND);
        let mut actual = plan.trajectory.q_at(reached).to_vec();
        actual[0] += OFF_RAD;
        let (time_s, commanded) = (0.5 + row as f64 * 0.002, cells(plan.trajectory.q_at(row)));
        let text = format!(
            "R,{time_s:.6},run,{row}.0,1.0,{reached}.0,{:.5},,0.004,0.0015,{time_s:.6},1,2,1.0,3.0,0.0,4.0,{commanded},{}",
            if row == 1000 { FARTHEST_MM } else { 0.01 },
            cells(&actual)
        );
        line(&mut log, &text);
    }
    line(&mut log, "E,9.000000,ended: stopped by the user");
    log
}

#[test]
fn a_run_is_set_beside_its_plan_and_no_other() {
    let place = Place::healthy().with_case("rate_hz = 100", UR);
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    let plan = StoredPlan::load(&place.path("plan")).unwrap();
    let good = log(&plan, 2000);
    fs::write(place.path("run.log"), &good).unwrap();
    let ran = place.run(&["report", "plan", "--run", "run.log", "--json", "--out", "run.html"]);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let found: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let figures = &found["figures"];
    let figure = |name: &str, of: &str| figures[name][of].as_f64().unwrap();

    // the lever of the first joint is the burr's distance from the base's axis
    let burr = |row: usize| plan.arm.burr(plan.trajectory.q_at(row)).unwrap().translation_mm;
    let moved_mm = (0..1978).map(|row| OFF_RAD * burr(row).xy().norm()).fold(0.0, f64::max);
    let off_mm = figure("off_at_entries_mm", "max");
    assert!(off_mm <= moved_mm * 1.001 && off_mm > 0.5 * moved_mm, "{off_mm} mm");
    assert_eq!(figures["farthest_off_mm"].as_f64(), Some(FARTHEST_MM));
    let way_mm = |from: usize, to: usize| (from..to).map(|n| (burr(n + 1) - burr(n)).norm()).sum::<f64>();
    let behind_mm = (BEHIND..1995).map(|row| way_mm(row - BEHIND, row)).fold(0.0, f64::max);
    let said_mm = figure("behind_mm", "max");
    assert!((said_mm - behind_mm).abs() < moved_mm + 0.02, "{said_mm} mm, {behind_mm} mm");
    // at most the turn of the joint; less where the shaft is turned there anyway, or stands along the joint's axis
    let turned_mrad = figure("axis_mrad", "max");
    assert!(turned_mrad <= 0.501 && turned_mrad > 0.05, "{turned_mrad} mrad");
    assert!(
        (figure("late_ms", "p50") - 1.5).abs() < 1e-9 && (figure("measured_n", "max") - 5.0).abs() < 1e-9
    );
    assert!((figure("between_entries_ms", "p99") - 10.0).abs() < 1e-6);
    let reached = figures["reached_row"].as_f64().unwrap();
    assert!((reached - (1995 - BEHIND) as f64).abs() < 1e-9, "{reached}");
    assert!(
        figures["least_room_mm"].as_f64().unwrap() > 0.0 && found["events"].as_array().unwrap().len() == 2
    );
    let page = fs::read_to_string(place.path("run.html")).unwrap();
    let last = plan.trajectory.len() - 1;
    for card in [
        format!("<b>{FARTHEST_MM:.3} mm</b><span>farthest of the tool from its path at any step"),
        format!("<b>{off_mm:.3} mm</b><span>farthest of the tool from its path at the log's entries"),
        format!("Reached row {} of {last}", 1995 - BEHIND),
    ] {
        assert!(page.contains(&card), "{card}");
    }
    assert!(
        page.contains("Burr off its path") && page.contains("stopped by the user") && page.contains("[mrad]")
    );

    let refused = |text: &str, says: &[&str]| {
        fs::write(place.path("bad.log"), text).unwrap();
        place.run(&["report", "plan", "--run", "bad.log"]).refused(says);
    };
    let other = good.lines().next().unwrap().split(',').nth(2).unwrap();
    let foreign = good.replacen(other, &"0".repeat(64), 1);
    refused(&foreign, &["bad.log", "line 1"]);
    let mut head = String::new();
    line(&mut head, &format!("bonemill-run,1,{},{},0.002", "0".repeat(64), plan.trajectory.len()));
    let rest = good.split_once('\n').unwrap().1;
    refused(&format!("{head}{rest}"), &["another plan"]);
    refused(&good.replacen("run,100.0", "run,101.0", 1), &["line"]);
    refused("", &["line 1"]);
    refused(
        &good.lines().take(2).map(|l| format!("{l}\n")).collect::<String>(),
        &["no step on the plan", "connect"],
    );
    place.run(&["report", "plan", "--run", "nowhere.log"]).refused(&["nowhere.log"]);
    // a last line that a kill cut off is left out
    fs::write(place.path("cut.log"), &good[..good.len() - 20]).unwrap();
    assert_eq!(place.run(&["report", "plan", "--run", "cut.log"]).code, 0);
}
