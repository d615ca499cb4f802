//! What the burr does when streaming fails: every fault on a simulated arm, at drawn moments of a plan.
//!
//! Each run takes a piece of the plan, lets one thing break, and measures the true motion against the bound that is printed before a
//! start. A stopped run is resumed. The arm stands where the plan says, so an assumed registration is no obstacle here.

use bonemill_planner::Progress;
use bonemill_planner::plan::{Need, StoredPlan, stream_input};
use bonemill_robot::stream::bound::{self, Failure};
use bonemill_robot::stream::simulated::fault::{Draws, Fault};
use bonemill_robot::stream::simulated::trial::{Piece, TrialResult};
use bonemill_robot::stream::{Settings, Standing, StreamPlan};
use rayon::prelude::*;

use crate::{ExperimentError, Size, Table};

/// Pieces of the plan that runs are drawn from, and rows of each.
const PIECES: usize = 400;
const ROWS: usize = 150;
/// Runs of each fault per seed.
const RUNS: u64 = 100;
/// Depths of a buffer on the controller that are compared with servoj, s.
const DEPTHS_S: [f64; 3] = [0.02, 0.1, 0.5];

/// The table of faults, and that of bounds, of the plan in `--case`.
///
/// # Errors
/// [`ExperimentError`]: no plan of a UR arm in the folder.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let Some(folder) = size.case else {
        let mut table = faults_table("no plan");
        table.push_note("none".into(), "give the folder of a UR arm's plan as --case".into());
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
    Ok(vec![bounds(&plan, &name), faults(&plan, &name, size.seeds, progress)])
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
        "resumed to the end",
        "what the user reads (most often)",
    ];
    Table::new("stream-faults", format!("{name}: a simulated UR arm, one fault a run"), &columns)
}

/// What came of all runs of one fault.
#[derive(Default)]
struct Tally {
    results: Vec<TrialResult>,
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

fn faults(plan: &StreamPlan, name: &str, seeds: u64, progress: &dyn Progress) -> Table {
    let mut draws = Draws::new(25);
    let from = |draws: &mut Draws| draws.below(plan.track.rows().saturating_sub(ROWS).max(1));
    let starts: Vec<usize> = (0..PIECES).map(|_| from(&mut draws)).collect();
    let pieces: Vec<Piece> = starts.into_par_iter().map(|row| Piece::new(plan, row, ROWS)).collect();
    let mut table = faults_table(name);
    for (n, (what, fault)) in Fault::ALL.iter().enumerate() {
        progress.advance(n, Fault::ALL.len());
        let one = |run: u64| {
            let seed = run * Fault::ALL.len() as u64 + n as u64;
            pieces[(run as usize * 7919) % pieces.len()].run(*fault, seed, run.is_multiple_of(10))
        };
        let tally = Tally { results: (0..RUNS * seeds).into_par_iter().map(one).collect() };
        let (beyond, hung) = (tally.count(|r| !r.is_within()), tally.count(TrialResult::hung));
        let unfinished = tally.count(|r| r.resumed.as_ref().is_some_and(|o| o.cause.is_some()));
        let left_out = tally.count(|r| r.skipped_mm > 1e-6);
        if beyond + hung + unfinished + left_out > 0 {
            let counts = format!(
                "{beyond} beyond the bound, {hung} hung, {unfinished} not resumed, {left_out} left something out"
            );
            table.shortfalls.push(format!("{name}, {what}: {counts}"));
        }
        table.push(row(what, *fault, &tally, beyond, hung));
    }
    table
}

fn row(what: &str, fault: Fault, tally: &Tally, beyond: usize, hung: usize) -> Vec<String> {
    let mm = |value: Option<f64>| value.map_or_else(|| "-".into(), |mm| format!("{mm:.3}"));
    let stopped = tally.count(|r| r.outcome.cause.is_some());
    let along = tally.most(|r| r.travel.along_mm).filter(|_| stopped > 0);
    let off = tally.most(|r| r.travel.off_mm).filter(|_| !matches!(fault, Fault::Offset(_)));
    let asked = tally.count(|r| r.resumed.is_some());
    let went = tally.count(|r| r.resumed.as_ref().is_some_and(|o| o.cause.is_none()));
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
        if asked > 0 { format!("{went} of {asked}") } else { "-".into() },
        tally.reads(),
    ]
}
