//! Compares optimal with greedy orientation on the paper's own cost, for one and two angles: cost, forces toward structures,
//! angular rates, permissibility, time.

use std::time::Instant;

use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_planner::Progress;
use bonemill_planner::case::OrientationMode;
use bonemill_planner::orientation::directions::angle_between;
use bonemill_planner::pipeline::{Choices, Chosen, Prepared, with_prepared};

use crate::body::{Body, data};
use crate::{ExperimentError, Size, Table};

const COLUMNS: [&str; 12] = [
    "body",
    "angles",
    "mode",
    "waypoints",
    "Σ C Δs [mm]",
    "∫ (da/ds)² ds [rad²/mm]",
    "fastest turn [°/mm]",
    "mean F toward [N]",
    "peak F toward [N]",
    "low-pass left the free set",
    "turns not certainly free",
    "orientation [s]",
];

/// The table over phantoms of every seed and, if available, the segmented temporal bone.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let mut table = Table::new("orientation", title(size), &COLUMNS);
    for (kind, name) in [(PhantomKind::Block, "block"), (PhantomKind::Temporal, "temporal")] {
        for seed in 1..=size.seeds {
            let body = Body::phantom(&phantom(kind, seed))?;
            rows(&body, &format!("{name} {seed}"), progress, &mut table)?;
        }
    }
    if let Some(body) = Body::case_file(&data().join("tbone_RT143/case.toml")) {
        rows(&body, "segmented temporal bone", progress, &mut table)?;
    }
    Ok(vec![table])
}

fn title(size: Size) -> String {
    let absent = if data().join("tbone_RT143/case.toml").exists() {
        ""
    } else {
        " The segmented bone is not there: left out."
    };
    format!(
        "Optimal against greedy on the paper's cost (equation 6), {} seeds of each phantom; both on the same path. Greedy takes each waypoint alone, then the low-pass, held at free directions.{absent}",
        size.seeds
    )
}

fn rows(body: &Body, name: &str, progress: &dyn Progress, table: &mut Table) -> Result<(), ExperimentError> {
    for angles in [1, 2] {
        let mut case = body.case(false)?;
        // two angles need another arm than the case's; only the choice of axes is compared, not the joints
        case.orientation.angles = angles;
        progress.stage(name);
        for (mode, word) in [(OrientationMode::Greedy, "greedy"), (OrientationMode::Optimal, "optimal")] {
            case.orientation.mode = mode;
            with_prepared(&case, body.case_path(), &(), |prepared| {
                let start = Instant::now();
                let chosen = prepared.choose(&Choices::of(&case))?;
                let seconds = start.elapsed().as_secs_f64();
                let head = [name.to_owned(), angles.to_string(), word.to_owned()];
                let figures = figures(prepared, &chosen, case.speed.nominal_mm_s);
                table.push(head.into_iter().chain(figures).chain([format!("{seconds:.2}")]).collect());
                Ok(())
            })?;
        }
    }
    Ok(())
}

fn figures(prepared: &Prepared, chosen: &Chosen, nominal_mm_s: f64) -> [String; 8] {
    let axes = &chosen.oriented.axes;
    let length = prepared.length_mm();
    let count = axes.len();
    let cost: f64 = (0..count).map(|i| chosen.costs[i].cost * length[i]).sum();
    let turn = |i: usize| angle_between(&axes[i - 1], &axes[i]);
    let moves = || (1..count).filter(|i| length[*i] > 1e-6);
    let bend: f64 = moves().map(|i| turn(i).powi(2) / length[i]).sum();
    let fastest = moves().map(|i| turn(i) / length[i]).fold(0.0, f64::max);
    let toward: Vec<f64> = (0..count)
        .filter_map(|i| {
            Some(chosen.forces[i]?.force_n(nominal_mm_s).dot(&prepared.nearest(i)?.toward).max(0.0))
        })
        .collect();
    let mean = toward.iter().sum::<f64>() / toward.len().max(1) as f64;
    let peak = toward.iter().copied().fold(0.0, f64::max);
    [
        count.to_string(),
        format!("{cost:.1}"),
        format!("{bend:.2}"),
        format!("{:.1}", fastest.to_degrees()),
        format!("{mean:.3}"),
        format!("{peak:.2}"),
        chosen.oriented.low_pass_held.to_string(),
        chosen.oriented.blocked_turns.len().to_string(),
    ]
}
