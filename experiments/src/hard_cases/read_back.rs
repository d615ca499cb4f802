//! What is written of a plan for others, read back: its export and its report must tell what its files tell.

use bonemill_planner::plan::{REPORT, StoredPlan};
use bonemill_planner::report::percent;
use bonemill_robot::JointKind;
use bonemill_robot::export::{Between, ExportRows, write_ros_json};
use serde_json::Value;

/// How far a controller may leave the sampled path, and the longest time between two rows, as `bonemill export` has them: mm, s.
const EXPORTED: (f64, f64) = (0.005, 0.1);
/// Decimals of the export: mm, rad or s.
const SAME: f64 = 2e-9;

/// Where the export or the report of a plan differs from its files.
pub(super) fn differences(plan: &StoredPlan) -> Vec<String> {
    let exported = exported(plan).unwrap_or_else(|error| vec![format!("export: {error}")]);
    exported.into_iter().chain(reported(plan)).collect()
}

/// The points of the ROS export against the rows of the trajectory.
pub(super) fn exported(plan: &StoredPlan) -> Result<Vec<String>, Box<dyn std::error::Error>> {
    let t = &plan.trajectory;
    let rows = ExportRows::new(plan.arm.joints(), &t.time_s, &t.q, &t.qd, 1)?;
    let (most_mm, most_s) = EXPORTED;
    let rows = rows.thinned(&plan.arm, &[Between::Straight, Between::Cubic], most_mm, most_s)?;
    let mut bytes = Vec::new();
    write_ros_json(&mut bytes, &rows)?;
    let read: Value = serde_json::from_slice(&bytes)?;
    let points = read["points"].as_array().ok_or("no points")?;
    // ROS has metres
    let per_unit: Vec<f64> = plan
        .arm
        .joints()
        .iter()
        .map(|joint| if joint.kind == JointKind::Prismatic { 1e-3 } else { 1.0 })
        .collect();
    let in_si = |of: &[f64]| of.iter().zip(&per_unit).map(|(v, unit)| v * unit).collect::<Vec<_>>();
    let mut said = Vec::new();
    for (n, point) in points.iter().enumerate() {
        let stamp = &point["time_from_start"];
        let [whole, parts] = ["sec", "nanosec"].map(|key| stamp[key].as_f64().unwrap_or(f64::NAN));
        let time_s = whole + 1e-9 * parts;
        let row = t.time_s.partition_point(|s| *s < time_s - SAME).min(t.len() - 1);
        let numbers = |key: &str| {
            let list = point[key].as_array().cloned().unwrap_or_default();
            list.iter().map(|v| v.as_f64().unwrap_or(f64::NAN)).collect::<Vec<_>>()
        };
        let is_same =
            |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() <= SAME);
        let is_row = (t.time_s[row] - time_s).abs() <= SAME
            && is_same(&numbers("positions"), &in_si(t.q_at(row)))
            && is_same(&numbers("velocities"), &in_si(t.qd_at(row)));
        let is_end = [0, points.len() - 1].contains(&n) && row != [0, t.len() - 1][usize::from(n > 0)];
        if !is_row || is_end {
            said.push(format!("export: point {n} is not row {row} of the trajectory"));
            break;
        }
    }
    Ok(said)
}

/// The report's figures against those of the plan.
fn reported(plan: &StoredPlan) -> Vec<String> {
    let Ok(page) = std::fs::read_to_string(plan.dir.join(REPORT)) else {
        return vec!["report: there is none".into()];
    };
    let metrics = &plan.record.metrics;
    let peak_n = metrics.number("peak_force_n").unwrap_or(f64::NAN);
    let removed = percent(metrics.number("removed_share").unwrap_or(f64::NAN));
    let told = [format!("{peak_n:.2} N"), removed].into_iter();
    told.filter(|figure| !page.contains(figure))
        .map(|figure| format!("report: {figure} is missing"))
        .collect()
}
