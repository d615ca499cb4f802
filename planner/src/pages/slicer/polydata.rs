//! The path as lines with force and speed: VTK's legacy format, in text.
//!
//! A point is a waypoint and has what belongs to the move that ends there; a line is a run of moves that all cut or all do not (`is_cut`).
//!
//! **Source:** Kitware, "VTK file formats", simple legacy formats, version 3.0.

use std::ops::Range;

use bonemill_cutting::cutter::MoveKind;
use bonemill_planfile::{StoredPlan, Waypoint};

use super::lps;

/// The file's text.
pub(super) fn forces(plan: &StoredPlan) -> String {
    let waypoints = &plan.waypoints;
    let point = |w: &Waypoint| lps(w.position).map(|mm| format!("{mm:?}")).join(" ");
    let points: Vec<String> = waypoints.iter().map(point).collect();
    // + 0.0 turns −0 into 0
    let column = |value: fn(&Waypoint) -> f64| -> String {
        waypoints.iter().map(|w| format!("{:?}\n", value(w) + 0.0)).collect()
    };
    let lines = lines(waypoints);
    let line = |(_, along): &(bool, Range<usize>)| {
        let numbers: Vec<String> = along.clone().map(|n| n.to_string()).collect();
        format!("{} {}\n", along.len(), numbers.join(" "))
    };
    let numbers: usize = lines.iter().map(|(_, along)| along.len() + 1).sum();
    let [count, runs] = [points.len(), lines.len()];
    [
        "# vtk DataFile Version 3.0\nbonemill forces, mm and N, SPACE=LPS\nASCII\nDATASET POLYDATA\n"
            .to_owned(),
        format!("POINTS {count} double\n{}\n", points.join("\n")),
        format!("LINES {runs} {numbers}\n{}", lines.iter().map(line).collect::<String>()),
        format!("CELL_DATA {runs}\nFIELD FieldData 1\nis_cut 1 {runs} int\n"),
        lines.iter().map(|(is_cut, _)| if *is_cut { "1\n" } else { "0\n" }).collect(),
        format!("POINT_DATA {count}\nSCALARS force_n double 1\nLOOKUP_TABLE default\n"),
        column(|w| w.force_n.norm()),
        format!("FIELD FieldData 2\nforce_toward_n 1 {count} double\n"),
        column(|w| w.force_toward_n.unwrap_or(0.0)),
        format!("driven_mm_s 1 {count} double\n"),
        column(|w| w.driven_mm_s),
    ]
    .concat()
}

/// Runs of moves that all cut or all do not, with the waypoints along them.
fn lines(waypoints: &[Waypoint]) -> Vec<(bool, Range<usize>)> {
    let mut lines: Vec<(bool, Range<usize>)> = Vec::new();
    for (n, waypoint) in waypoints.iter().enumerate().skip(1) {
        let is_cut = waypoint.kind == MoveKind::Cut;
        match lines.last_mut() {
            Some((before, along)) if *before == is_cut => along.end = n + 1,
            _ => lines.push((is_cut, n - 1..n + 1)),
        }
    }
    lines
}
