//! The path, the way in and the holds as markups of 3D Slicer, with speed and force at every point.
//!
//! As in `waypoints.csv`, what stands at a point belongs to the move that ends there. **Source:** 3D Slicer's markups schema 1.0.3.

use bonemill_cutting::cutter::MoveKind;
use bonemill_planfile::{StoredPlan, Waypoint, hold_points};
use serde_json::{Value, json};

use super::lps;

const SCHEMA: &str = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/\
                      markups-schema-v1.0.3.json#";

/// A value at a waypoint.
type At = fn(&Waypoint) -> f64;

/// The values at each point: name, unit, what it is.
const MEASURED: [(&str, &str, &str, At); 3] = [
    ("driven speed", "mm/s", "greatest speed within the move that ends at the point", |w| w.driven_mm_s),
    ("force", "N", "of the bone on the burr, mean over a turn, at that speed", |w| w.force_n.norm()),
    ("force toward structure", "N", "its component toward the nearest structure", |w| {
        w.force_toward_n.unwrap_or(0.0)
    }),
];

/// The markups of a plan, by name: the path; the moves before the first cut and that cut, if there are any; the holds, if there are any.
pub(super) fn markups(plan: &StoredPlan) -> Vec<(&'static str, String)> {
    let labelled = |waypoints: &[Waypoint]| -> Vec<(String, Waypoint)> {
        waypoints.iter().enumerate().map(|(n, w)| (n.to_string(), w.clone())).collect()
    };
    let mut markups = vec![("path", text("Curve", "path", &labelled(&plan.waypoints)))];
    let first_cut = plan.waypoints.iter().position(|w| w.kind == MoveKind::Cut);
    if let Some(way_in) = first_cut.and_then(|n| plan.waypoints.get(..=n)).filter(|way| way.len() > 1) {
        markups.push(("approach", text("Curve", "approach", &labelled(way_in))));
    }
    let holds: Vec<(String, Waypoint)> = hold_points(plan)
        .into_iter()
        .filter_map(|hold| {
            let name = &plan.record.case.structures.get(hold.structure)?.name;
            let at = plan.waypoints.get(hold.before_waypoint.saturating_sub(1))?;
            Some((format!("hold {} mm from {name}", hold.distance_mm), at.clone()))
        })
        .collect();
    if !holds.is_empty() {
        markups.push(("holds", text("Fiducial", "holds", &holds)));
    }
    markups
}

fn text(kind: &str, name: &str, points: &[(String, Waypoint)]) -> String {
    let is_list = kind == "Fiducial";
    let point = |(n, (label, w)): (usize, &(String, Waypoint))| {
        json!({
            "id": (n + 1).to_string(), "label": label, "position": lps(w.position), "selected": true, "locked": true,
            "visibility": is_list, "positionStatus": "defined",
        })
    };
    let measured = |(name, units, description, value): &(&str, &str, &str, At)| {
        let values: Vec<f64> = points.iter().map(|(_, w)| value(w)).collect();
        let largest = values.iter().copied().fold(0.0, f64::max);
        json!({
            "name": name, "units": units, "description": format!("{description}; the largest, and that at each point"),
            "enabled": true, "value": largest, "printFormat": "%.3g %s", "controlPointValues": values,
        })
    };
    let markup = json!({
        "type": kind, "name": name, "coordinateSystem": "LPS", "coordinateUnits": "mm", "locked": true,
        "fixedNumberOfControlPoints": true,
        "controlPoints": points.iter().enumerate().map(point).collect::<Vec<Value>>(),
        "measurements": MEASURED.iter().map(measured).collect::<Vec<Value>>(),
    });
    json!({ "@schema": SCHEMA, "markups": [markup] }).to_string() + "\n"
}
