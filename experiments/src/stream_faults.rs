//! What the burr does when streaming fails: every fault on a simulated arm, at drawn moments of a plan.
//!
//! Each run takes a piece of the plan, lets one thing break, and measures the true motion against the bound that is printed before a
//! start. A stopped run is resumed, and what both runs sweep is compared with the plan. The arm stands where the plan says, so an assumed registration is no obstacle here.

use std::time::Instant;

use bonemill_planner::Progress;
use bonemill_planner::plan::{Need, StoredPlan};
use bonemill_planner::stream_input;
use bonemill_robot::stream::bound::{self, Failure};
use bonemill_robot::stream::simulated::fault::{Fault, SeededDraws};
use bonemill_robot::stream::simulated::swept::Swept;
use bonemill_robot::stream::simulated::trial::{TrialPiece, TrialResult};
use bonemill_robot::stream::{Settings, Standing, StreamPlan};
use rayon::prelude::*;

use crate::{ExperimentError, Size, Table};

/// Pieces of the plan that runs are drawn from, and rows of each.
const PIECES: usize = 400;
const ROWS: usize = 150;
/// Rows of each where targets are held back for up to 0.7 s.
const LONGER_ROWS: usize = 600;
/// Runs of each fault per seed.
const RUNS: u64 = 100;
/// Of each fault, so many runs are resumed where they stopped; of those after them every tenth.
const RESUMED: u64 = 1000;
/// Depths of a buffer on the controller that are compared with servoj, s.
const DEPTHS_S: [f64; 3] = [0.02, 0.1, 0.5];

/// The table of faults, and that of bounds, of the plan in `--case`.
///
/// # Errors
/// [`ExperimentError`]: no plan in the folder.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let Some(folder) = size.case else {
        let mut table = faults_table("no plan");
        table.push_note("none".into(), "give the folder of a plan as --case".into());
        return Ok(vec![table]);
    };
    let stored = StoredPlan::load_with(folder, None, Need::Unchanged)?;
    let mut input = stream_input(&stored)?;
    (input.registration_assumed, input.standing) = (false, Standing::Verified);
    let settings = Settings { slow: true, payload_kg: Some(1.0), run_up_s: 0.0, ..Settings::default() };
    progress.stage("bound");
    let plan = StreamPlan::new(input, settings)?;
    let name = folder.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    progress.stage("runs");
    let (pieces, longer) = (pieces(&plan, ROWS), pieces(&plan, LONGER_ROWS));
    Ok(vec![
        bounds(&plan, &name),
        refused(&plan, &name),
        buffers(&longer, &name, size.seeds),
        faults(&pieces, &name, size.seeds, progress),
    ])
}

/// Where the plan is refused at its planned speed, and how long its joints take to stop there.
fn refused(plan: &StreamPlan, name: &str) -> Table {
    let rows: Vec<usize> = (0..plan.track.rows()).step_by(5).collect();
    let found = rows.par_iter().map(|row| {
        let tube = bound::tube(plan, *row, 1.0);
        let fastest = plan.track.fastest(row.saturating_sub(40)..=row + 5, plan.period_s);
        (tube.off_mm, tube.gap_mm, fastest.stop_s)
    });
    let found: Vec<(f64, f64, f64)> = found.collect();
    let too_wide: Vec<_> = found.iter().copied().filter(|(off_mm, gap_mm, _)| off_mm > gap_mm).collect();
    let columns = ["rows", "share [%]", "quantile", "off [mm]", "room [mm]", "longest stop [s]"];
    let title = format!(
        "{name}: rows at their planned speed; refused are those whose bound is larger than their room"
    );
    let mut table = Table::new("stream-refused", title, &columns);
    for (what, of) in [("all", &found), ("refused", &too_wide)] {
        let share = 100.0 * of.len() as f64 / found.len() as f64;
        for quantile in [0.01, 0.5, 0.99, 1.0] {
            let at = |value: fn(&(f64, f64, f64)) -> f64| {
                let mut values: Vec<f64> = of.iter().map(value).collect();
                values.sort_by(f64::total_cmp);
                let place = (quantile * values.len().saturating_sub(1) as f64) as usize;
                values.get(place).map_or_else(|| "-".into(), |value| format!("{value:.2}"))
            };
            table.push(vec![
                what.into(),
                format!("{share:.2}"),
                quantile.to_string(),
                at(|v| v.0),
                at(|v| v.1),
                at(|v| v.2),
            ]);
        }
    }
    table
}

/// What the burr can travel, by what fails, at the planned speed and at the one that is allowed.
fn bounds(plan: &StreamPlan, name: &str) -> Table {
    let slowed_s: f64 = plan.rate.iter().map(|r| plan.period_s / r.max(0.05)).sum();
    let slow_rows = plan.rate.iter().filter(|r| **r < 1.0).count();
    let title = format!(
        "{name}: largest travel after a failure over all rows; {:.0} s as planned, {slowed_s:.0} s with --slow, {:.1} % of the rows slowed, \
         least room {:.2} mm",
        plan.duration_s(),
        100.0 * slow_rows as f64 / plan.rate.len() as f64,
        plan.gap_mm.iter().copied().fold(f64::INFINITY, f64::min),
    );
    let columns = ["", "planned speed [mm]", "slowed [mm]"];
    let mut table = Table::new("stream-bounds", title, &columns);
    let largest = |mm: &(dyn Fn(usize, f64) -> f64 + Sync), slowed: bool| {
        let rows = (0..plan.track.rows()).into_par_iter().step_by(5);
        rows.map(|row| mm(row, if slowed { plan.rate[row] } else { 1.0 })).reduce(|| 0.0, f64::max)
    };
    let mut push = |what: String, planned_mm: f64, slowed_mm: f64| {
        table.push(vec![what, format!("{planned_mm:.3}"), format!("{slowed_mm:.3}")]);
    };
    let off_mm = plan.off_mm.iter().copied().fold(0.0, f64::max);
    push("off the path".into(), largest(&|row, rate| bound::tube(plan, row, rate).off_mm, false), off_mm);
    for failure in Failure::ALL {
        let along = |row: usize, rate: f64| bound::along_mm(plan, row, rate, failure);
        push(format!("along, {}", failure.about()), largest(&along, false), largest(&along, true));
    }
    for depth_s in DEPTHS_S {
        let along = |row: usize, rate: f64| bound::along_buffered_mm(plan, row, rate, depth_s);
        let what = format!("along, supply of a buffer of {depth_s} s on the controller lost");
        push(what, largest(&along, false), largest(&along, true));
    }
    table
}

fn faults_table(name: &str) -> Table {
    let columns = [
        "fault",
        "runs",
        "stopped",
        "along, worst [mm]",
        "its bound [mm]",
        "off, worst [mm]",
        "its bound [mm] ",
        "beyond",
        "hung",
        "resumed to the end, same volume",
        "left out, worst [mm]",
        "volume other, worst [%]",
        "what the user reads (most often)",
    ];
    Table::new("stream-faults", format!("{name}: a simulated UR arm, one fault a run"), &columns)
}

/// What came of all runs of one fault.
#[derive(Default)]
struct Tally {
    results: Vec<TrialResult>,
    /// Those that were resumed to the end and did what the plan does.
    same: usize,
}

impl Tally {
    fn count(&self, what: impl Fn(&TrialResult) -> bool) -> usize {
        self.results.iter().filter(|r| what(r)).count()
    }

    /// The result with the most of something, mm.
    fn most(&self, mm: impl Fn(&TrialResult) -> f64) -> Option<&TrialResult> {
        self.results.iter().max_by(|a, b| mm(a).total_cmp(&mm(b)))
    }

    /// The cause that ended most runs, of one run.
    fn reads(&self) -> String {
        let kind = |r: &TrialResult| r.outcome.cause.as_ref().map(std::mem::discriminant);
        let often = self.results.iter().filter(|r| r.outcome.cause.is_some());
        let most = often.max_by_key(|r| self.count(|other| kind(other) == kind(r)));
        most.and_then(|r| r.outcome.cause.as_ref()).map_or_else(|| "-".into(), ToString::to_string)
    }
}

/// Pieces at drawn places of a plan.
fn pieces(plan: &StreamPlan, rows: usize) -> Vec<TrialPiece> {
    let mut draws = SeededDraws::new(25);
    let from = |draws: &mut SeededDraws| draws.below(plan.track.rows().saturating_sub(rows).max(1));
    let starts: Vec<usize> = (0..PIECES).map(|_| from(&mut draws)).collect();
    starts.into_par_iter().map(|row| TrialPiece::new(plan, row, rows)).collect()
}

/// servoJ against programs on the controller that follow a buffer of targets: how many runs a loss or a stall ends, and how far the burr goes.
fn buffers(pieces: &[TrialPiece], name: &str, seeds: u64) -> Table {
    let columns = [
        "fault",
        "program",
        "runs",
        "stopped",
        "along, worst [mm]",
        "its bound [mm]",
        "off, worst [mm]",
        "beyond",
    ];
    let title =
        format!("{name}: servoJ, and programs that hold targets for so long beyond what a stop needs");
    let mut table = Table::new("stream-buffers", title, &columns);
    let lost = Fault::ALL.iter().enumerate().filter(|(_, (_, fault))| {
        use Fault::{BothCut, ControlCut, Frozen, HalfOpen, Killed, ReceiveCut, Stall};
        matches!(fault, ControlCut | ReceiveCut | BothCut | HalfOpen | Killed | Frozen | Stall(_))
    });
    let buffered = DEPTHS_S.map(|depth_s| {
        let pieces: Vec<TrialPiece> =
            pieces.par_iter().map(|piece| piece.clone().buffered(depth_s)).collect();
        (format!("buffer of {depth_s} s"), pieces)
    });
    for (n, (what, fault)) in lost {
        let programs = std::iter::once(("servoJ", pieces))
            .chain(buffered.iter().map(|(p, all)| (p.as_str(), all.as_slice())));
        for (program, pieces) in programs {
            let one = |run: u64| {
                let seed = run * Fault::ALL.len() as u64 + n as u64;
                pieces[(run as usize * 7919) % pieces.len()].run(*fault, seed, false)
            };
            let results: Vec<_> = (0..RUNS * seeds).into_par_iter().map(one).collect();
            let tally = Tally { results, same: 0 };
            let stopped = tally.count(|r| r.outcome.cause.is_some());
            let beyond = tally.count(|r| !r.is_within());
            if beyond > 0 {
                table.shortfalls.push(format!("{name}, {what}, {program}: {beyond} beyond the bound"));
            }
            let most = |mm: &dyn Fn(&TrialResult) -> f64| {
                let most = tally.most(mm).filter(|_| stopped > 0);
                most.map_or_else(
                    || ("-".into(), "-".into()),
                    |r| (format!("{:.3}", r.travel.along_mm), format!("{:.3}", r.bound.along_mm)),
                )
            };
            let (along, bound) = most(&|r| r.travel.along_mm);
            let off = tally
                .most(|r| r.travel.off_mm)
                .map_or_else(|| "-".into(), |r| format!("{:.3}", r.travel.off_mm));
            let runs = tally.results.len().to_string();
            table.push(vec![
                (*what).into(),
                program.into(),
                runs,
                stopped.to_string(),
                along,
                bound,
                off,
                beyond.to_string(),
            ]);
        }
    }
    table
}

fn faults(pieces: &[TrialPiece], name: &str, seeds: u64, progress: &dyn Progress) -> Table {
    let mut table = faults_table(name);
    let began = Instant::now();
    for (n, (what, fault)) in Fault::ALL.iter().enumerate() {
        progress.advance(n, Fault::ALL.len());
        let one = |run: u64| {
            let seed = run * Fault::ALL.len() as u64 + n as u64;
            let piece = &pieces[(run as usize * 7919) % pieces.len()];
            let result = piece.run(*fault, seed, run < RESUMED || run.is_multiple_of(10));
            let same =
                result.swept.is_some_and(|swept| swept.left_mm.max(swept.beside_mm) <= piece.tolerance_mm());
            (result, same)
        };
        let (results, same): (Vec<_>, Vec<bool>) = (0..RUNS * seeds).into_par_iter().map(one).unzip();
        let tally = Tally { results, same: same.into_iter().filter(|same| *same).count() };
        let (beyond, hung) = (tally.count(|r| !r.is_within()), tally.count(TrialResult::hung));
        let unfinished = tally.count(|r| r.resumed.is_some()) - tally.same;
        let left_out = tally.count(|r| r.skipped_mm > 1e-6);
        if beyond + hung + unfinished + left_out > 0 {
            let counts = format!(
                "{beyond} beyond the bound, {hung} hung, {unfinished} not resumed to the same, {left_out} left something out"
            );
            table.shortfalls.push(format!("{name}, {what}: {counts}"));
        }
        table.push(row(what, *fault, &tally, beyond, hung));
    }
    let runs = Fault::ALL.len() as u64 * RUNS * seeds;
    let seconds = began.elapsed().as_secs_f64();
    table.title += &format!("; {runs} schedules in {seconds:.0} s, {:.0} a second", runs as f64 / seconds);
    table
}

fn row(what: &str, fault: Fault, tally: &Tally, beyond: usize, hung: usize) -> Vec<String> {
    let mm = |value: Option<f64>| value.map_or_else(|| "-".into(), |mm| format!("{mm:.3}"));
    let stopped = tally.count(|r| r.outcome.cause.is_some());
    let along = tally.most(|r| r.travel.along_mm).filter(|_| stopped > 0);
    let off = tally.most(|r| r.travel.off_mm).filter(|_| !matches!(fault, Fault::Offset(_)));
    let asked = tally.count(|r| r.resumed.is_some());
    let swept = |value: fn(&Swept) -> f64| {
        tally.results.iter().filter_map(|r| r.swept.as_ref().map(value)).reduce(f64::max)
    };
    let other = swept(|s| 100.0 * s.different_mm3 / s.planned_mm3);
    vec![
        what.to_owned(),
        tally.results.len().to_string(),
        stopped.to_string(),
        mm(along.map(|r| r.travel.along_mm)),
        mm(along.map(|r| r.bound.along_mm)),
        mm(off.map(|r| r.travel.off_mm)),
        mm(off.map(|r| r.bound.off_mm)),
        beyond.to_string(),
        hung.to_string(),
        if asked > 0 { format!("{} of {asked}", tally.same) } else { "-".into() },
        mm(swept(|s| s.left_mm)),
        mm(other),
        tally.reads(),
    ]
}
