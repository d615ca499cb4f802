//! `bonemill simulate`: a plan's table and report, poses from standard input, a force log, and refused input.

use std::fs;
use std::io::Write;
use std::process::{Command, Stdio};

use crate::support::place::{Place, Ran};

const HEADER: &str = "time_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,torque_nmm,power_w,mrr_mm3_s,\
                      force_toward_n,structure,distance_mm,deflection_um";

/// The healthy patient, planned.
fn planned(place: Place) -> Place {
    let ran = place.plan();
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
    place
}

/// The cells of a table, by rows.
fn table(place: &Place, name: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(place.path(name)).unwrap();
    text.lines().skip(1).map(|line| line.split(',').map(str::to_owned).collect()).collect()
}

fn number(cell: &str) -> f64 {
    cell.parse().unwrap()
}

#[track_caller]
fn done(ran: &Ran) {
    assert_eq!(ran.code, 0, "{}{}", ran.out, ran.err);
}

/// Feeds lines to `simulate --stream`.
fn stream(place: &Place, lines: &[u8]) -> (Vec<String>, String) {
    let mut child = Command::new(env!("CARGO_BIN_EXE_bonemill"))
        .args(["simulate", "plan", "--stream"])
        .current_dir(place.path(""))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let text = lines.to_owned();
    let writer = std::thread::spawn(move || stdin.write_all(&text).unwrap());
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    assert!(output.status.success());
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (text(output.stdout).lines().map(str::to_owned).collect(), text(output.stderr))
}

#[test]
fn a_plan_s_simulation_agrees_with_its_waypoints_and_is_the_same_on_any_number_of_threads() {
    let place = planned(Place::healthy());
    done(&place.run(&["simulate", "plan", "--threads", "1"]));
    let one = fs::read(place.path("plan/simulation.csv")).unwrap();
    let ran = place.run(&["simulate", "plan", "--threads", "2", "--json"]);
    done(&ran);
    assert!(one == fs::read(place.path("plan/simulation.csv")).unwrap());
    assert!(String::from_utf8(one).unwrap().starts_with(HEADER));
    assert!(
        ran.out.contains("\"outcome\":\"done\"") && ran.out.contains("\"stopped_steps\":0"),
        "{}",
        ran.out
    );

    let rows = table(&place, "plan/simulation.csv");
    let force = |row: &[String], x: usize| (0..3).map(|a| number(&row[x + a]).powi(2)).sum::<f64>().sqrt();
    let (mut off, mut before) = (Vec::new(), 0.0);
    for waypoint in table(&place, "plan/waypoints.csv") {
        let (time, planned) = (number(&waypoint[3]), force(&waypoint, 16));
        // a row states the force at the greatest speed within its move, which ends at a lower one where the next move is slower
        let within = rows.partition_point(|row| number(&row[0]) <= before)
            ..(rows.partition_point(|row| number(&row[0]) < time) + 1).min(rows.len());
        before = time;
        if waypoint[2] == "cut" && !waypoint[15].is_empty() && planned > 0.1 {
            let simulated = rows[within].iter().map(|row| force(row, 4)).fold(0.0, f64::max);
            off.push((simulated / planned - 1.0).abs());
        }
    }
    off.sort_by(f64::total_cmp);
    let median = off[off.len() / 2];
    // voxels are a third of the burr's radius: at the target's walls the plan's density falls to 0 over one voxel, while the
    // simulation's bone continues
    assert!(off.len() > 50 && median < 0.1, "median {median} of {}", off.len());
    // the shank is free, no bone outside the target is cut, and every row has its structure
    for row in &rows {
        assert_eq!(row.len(), 14);
        assert!(row[11] == "nerve" && number(&row[12]) > 2.5 - 0.05 && row[13].is_empty(), "{row:?}");
    }
    // the report has one section, however often it is simulated
    let page = fs::read_to_string(place.path("plan/report.html")).unwrap();
    assert_eq!(page.matches("<h2>Simulation of the trajectory</h2>").count(), 1);
    // a plan with a simulation can be replaced by a new plan
    done(&place.plan());
}

#[test]
fn removed_volume_is_the_plan_s() {
    let place = planned(Place::healthy());
    let ran = place.run(&["simulate", "plan", "--json"]);
    done(&ran);
    let found: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let plan: toml::Table = fs::read_to_string(place.path("plan/plan.toml")).unwrap().parse().unwrap();
    let planned = plan["metrics"]["removed_material_mm3"].as_float().unwrap();
    let removed = &found["figures"]["simulated_removed"];
    let sum = |unit: &str, kinds: &[&str]| -> f64 {
        kinds.iter().map(|k| removed[*k][unit].as_f64().unwrap()).sum()
    };
    let volume = sum("mm3", &["material", "bone"]);
    // rates are means over their steps, so rates times durations add up to the removed volume
    let rows = table(&place, "plan/simulation.csv");
    let by_rows: f64 =
        rows.windows(2).map(|w| number(&w[1][9]) * (number(&w[1][0]) - number(&w[0][0]))).sum();
    let all = sum("mm3", &["material", "bone", "obstacle", "structure"]);
    assert!((by_rows / all - 1.0).abs() < 1e-9, "{by_rows} of {all}");
    assert!((volume / planned - 1.0).abs() < 0.04, "{volume} of {planned}");
    assert_eq!(removed["structure"]["mm3"].as_f64(), Some(0.0));
    // the sum of the surface's rates at the end of each step: its bone is the images', that of the volume the planning grid's, and
    // surface is touched again within the error of interpolated depths
    let by_rate = |found: &serde_json::Value| {
        let mass: f64 = ["material", "bone", "obstacle"]
            .map(|k| found["figures"]["simulated_removed"][k]["mg"].as_f64().unwrap())
            .iter()
            .sum();
        (found["figures"]["removed_by_rate_mg"].as_f64().unwrap() / mass - 1.0).abs()
    };
    let ran = place.run(&["simulate", "plan", "--json", "--step-mm", "0.02"]);
    done(&ran);
    let finer: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let [coarse, fine] = [by_rate(&found), by_rate(&finer)];
    assert!(fine < 0.03 && coarse < 0.03, "{coarse} at 0.1 mm, {fine} at 0.02 mm");
}

#[test]
fn a_soft_arm_is_deflected_and_a_stiff_one_is_not() {
    let deflected = |stiffness: &str| {
        let place = Place::healthy()
            .with_case("rate_hz = 100", &format!("rate_hz = 100\njoint_stiffness = {stiffness}"));
        let place = planned(place);
        done(&place.run(&["simulate", "plan"]));
        table(&place, "plan/simulation.csv").iter().map(|row| number(&row[13])).fold(0.0, f64::max)
    };
    let soft = deflected("[30.0, 30.0, 30.0, 2e4]");
    let stiff = deflected("[3e4, 3e4, 3e4, 2e7]");
    assert!(soft > 10.0 && soft < 1000.0, "{soft} µm");
    // a thousand times as stiff; the soft arm deflects before the full force acts
    assert!(stiff < 5e-3 * soft && stiff > 0.0, "{stiff} of {soft} µm");
}

#[test]
fn a_hand_s_poses_are_answered_line_by_line() {
    let place = planned(Place::healthy());
    // down into the pocket's middle, from ct z = 20 to 12; then invalid poses; then further steps
    let mut lines = String::new();
    for n in 0..=80 {
        lines += &format!("{} -1.5 1.5 {} 0 0 1\n", 0.1 * n as f64, 20.0 - 0.1 * n as f64);
    }
    lines += "8.1 NaN 0 0 0 0 1\n8.1 0 0\n8.1 -1.5 1.5 11.9 0 0 0\n7.0 -1.5 1.5 11.9 0 0 1\n";
    lines += "8.1,-1.5,1.5,11.9,0,0,1\n8.1000001 -1.5 1.5 11.8 0 0 1\n";
    // and bytes that are not text
    let lines = [lines.as_bytes(), b"\xff\xfe\n"].concat();
    let (answers, said) = stream(&place, &lines);
    assert_eq!(answers.len(), 88);
    let refused: Vec<usize> = (0..88).filter(|n| answers[*n].starts_with("refused: ")).collect();
    assert_eq!(refused, [81, 82, 83, 84, 86, 87], "{answers:#?}");
    let cells = |n: usize| answers[n].split(',').map(str::to_owned).collect::<Vec<_>>();
    assert!(answers.iter().enumerate().all(|(n, _)| refused.contains(&n) || cells(n).len() == 11));
    // in air there is no force, in bone a force against the motion
    assert_eq!(number(&cells(1)[3]), 0.0);
    assert!(number(&cells(75)[3]) > 0.0, "{}", answers[75]);
    // refused lines change nothing: the next step is like the one before
    let (before, after) = (number(&cells(80)[3]), number(&cells(85)[3]));
    assert!((before - after).abs() < 0.1 * before, "{before} {after}");
    assert!(said.contains("88 lines; time of one: p50 ") && said.contains("p99 "), "{said}");
}

#[test]
fn coefficients_come_back_from_a_log_and_a_poor_log_is_refused() {
    let place = Place::healthy().with_case(
        "[path]",
        "[material]\nk_t = 1000\nk_r = 700\nk_a = 200\nk_te = 0.05\nk_re = 0.08\nk_ae = 0.02\n\n[path]",
    );
    let place = planned(place);
    // slots at several depths, feeds and tilts
    let (mut lines, mut t) = (String::new(), 0.0);
    let mut poses = Vec::new();
    for pass in 0..6 {
        let (z, v) = (13.6 - 0.5 * pass as f64, [0.5, 4.0, 1.0, 3.0, 0.7, 2.0][pass]);
        let (tilt, y) = (0.12 * pass as f64 - 0.3, 0.5 + 0.4 * pass as f64);
        for n in 0..=30 {
            let x = if pass % 2 == 0 { -4.0 + 0.2 * n as f64 } else { 2.0 - 0.2 * n as f64 };
            poses.push((t, [x, y, z, 0.0, tilt.sin(), tilt.cos()]));
            t += 0.2 / v;
        }
    }
    for (t, p) in &poses {
        lines += &format!("{t} {} {} {} {} {} {}\n", p[0], p[1], p[2], p[3], p[4], p[5]);
    }
    let (answers, _) = stream(&place, lines.as_bytes());
    let mut log = "time_s,x_mm,y_mm,z_mm,axis_x,axis_y,axis_z,fx_n,fy_n,fz_n\n".to_owned();
    for ((t, p), answer) in poses.iter().zip(&answers) {
        let cells: Vec<_> = answer.split(',').collect();
        let contact = !cells[10].is_empty();
        if !contact {
            let place = p.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
            log += &format!("{t},{place},{},{},{}\n", cells[1], cells[2], cells[3]);
        }
    }
    fs::write(place.path("log.csv"), &log).unwrap();
    let ran = place.run(&["simulate", "plan", "--calibrate", "log.csv", "--json"]);
    done(&ran);
    let found: serde_json::Value = serde_json::from_str(&ran.out).unwrap();
    let fitted = &found["figures"]["coefficients"];
    for (key, expected) in
        [("k_t", 1000.0), ("k_r", 700.0), ("k_a", 200.0), ("k_te", 0.05), ("k_re", 0.08), ("k_ae", 0.02)]
    {
        let value = fitted[key]["value"].as_f64().unwrap();
        assert!((value / expected - 1.0).abs() < 0.02, "{key}: {value} of {expected}");
    }
    // the burr in air only
    let air: String = log.lines().take(3).map(|l| format!("{l}\n")).collect::<String>()
        + "9e3,0,0,40,0,0,1,0,0,0\n9.1e3,0,1,40,0,0,1,0,0,0\n";
    fs::write(place.path("air.csv"), air).unwrap();
    place.run(&["simulate", "plan", "--calibrate", "air.csv"]).refused(&[
        "air.csv",
        "observations",
        "at least 7",
    ]);
    fs::write(place.path("bad.csv"), log.replace(",fz_n", "")).unwrap();
    place.run(&["simulate", "plan", "--calibrate", "bad.csv"]).refused(&["bad.csv:1:"]);
}

#[test]
fn what_cannot_be_simulated_is_refused_and_leaves_the_plan_as_it_was() {
    let place = planned(Place::healthy());
    let before = place.files();
    place.run(&["simulate", "nowhere"]).refused(&["nowhere", "plan.toml"]);
    for (option, value) in
        [("--step-mm", "0"), ("--step-mm", "NaN"), ("--rate-hz", "0"), ("--step-mm", "1e-12")]
    {
        place.run(&["simulate", "plan", option, value]).refused(&["simulation ", "above 0"]);
    }
    let nonsense = place.run(&["simulate", "plan", "--model", "magic"]);
    assert!(nonsense.code == 2 && nonsense.err.contains("lumped-as-printed"), "{}", nonsense.err);
    assert!(before == place.files());
    // another force model, another rate
    done(&place.run(&["simulate", "plan", "--model", "lumped", "--rate-hz", "20"]));
    let rows = table(&place, "plan/simulation.csv");
    assert!((number(&rows[1][0]) - 0.05).abs() < 1e-12);
    assert!(rows.iter().any(|row| number(&row[8]) > 0.0));
    fs::write(place.path("ct.nii"), fs::read(place.path("labels.nii")).unwrap()).unwrap();
    place.run(&["simulate", "plan"]).refused(&["ct.nii", "changed"]);
}
