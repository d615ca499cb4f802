//! A trial: a piece of a plan, run with one fault at a drawn moment, and how far the burr went because of it.
//!
//! Judged on the true motion, by what was printed before: at every moment the burr is no farther off the plan's path than the bound
//! there, and after the fault it goes no farther along it. Then the run is resumed from the place that it reported, to the end.

use std::cell::RefCell;
use std::rc::Rc;

use super::buffer::Buffer;
use super::fault::{Fault, SeededDraws};
use super::swept::{self, Swept};
use super::world::{World, WorldClock, WorldLink};
use bonemill_arm::arm::{ToolGoal, dls};
use nalgebra::Vector3;

use crate::stream::bound::{self, Travel};
use crate::stream::cause::{Cause, Event, Question, RunEnd};
use crate::stream::drive::{Operator, drive};
use crate::stream::link::{Clock, Joints, padded};
use crate::stream::log::LogWriter;
use crate::stream::plan::StreamPlan;
use crate::stream::session::Session;
use crate::stream::track::NearestOnTrack;

/// What came of a trial.
#[derive(Debug, Clone, PartialEq)]
pub struct TrialResult {
    /// How the run ended.
    pub outcome: RunEnd,
    /// Of the burr along the path after the fault, and off it where it was nearest to its bound, mm.
    pub travel: Travel,
    /// What was printed for the place of the fault, and for the place where the burr was nearest to what was printed off the path, mm.
    pub bound: Travel,
    /// How the run ended that went on from there; none where it was not asked for, or nothing was left to do.
    pub resumed: Option<RunEnd>,
    /// What both runs together swept, against the plan; none where it was not resumed to the end.
    pub swept: Option<Swept>,
    /// Way from where the arm truly was at the farthest to where the run goes on, mm: what is left out.
    pub skipped_mm: f64,
}

impl TrialResult {
    /// Whether it came to no end by itself.
    pub fn hung(&self) -> bool {
        matches!(self.outcome.cause, Some(Cause::NoAnswer { .. }))
    }

    /// Whether the burr stayed within what was printed.
    pub fn is_within(&self) -> bool {
        self.travel.along_mm <= self.bound.along_mm + 1e-9 && self.travel.off_mm <= self.bound.off_mm + 1e-9
    }
}

/// Says yes, and stops when the fault is that.
struct Yes {
    world: Rc<RefCell<World>>,
    fault: Fault,
    asked: bool,
    stopped: bool,
    /// Time between two looks at the files, s.
    look_s: f64,
    /// When the plan's first target was due, in true time, s.
    began_s: f64,
}

impl Operator for Yes {
    fn tell(&mut self, event: &Event) {
        if *event == Event::Stage("run") {
            self.began_s = self.world.borrow().now_s();
        }
    }

    fn ask(&mut self, _: &Question) {
        self.asked = true;
    }

    fn answer(&mut self) -> Option<bool> {
        std::mem::take(&mut self.asked).then_some(true)
    }

    fn stop(&mut self) -> Option<Cause> {
        if self.world.borrow().now_s() > MOST_S {
            return Some(Cause::NoAnswer { what: "the end of a trial", waited_s: MOST_S });
        }
        let since_s = self.world.borrow().struck_s().filter(|_| !self.stopped)?;
        // files are looked at as often as a state takes on its way
        let is_seen = self.world.borrow().now_s() >= since_s + self.look_s;
        let cause = match self.fault {
            Fault::Interrupted | Fault::Killed => Cause::Interrupted,
            Fault::DiskFull => Cause::Log("no space left on device".to_owned()),
            Fault::LogGone if is_seen => Cause::Log("its folder was deleted under way".to_owned()),
            Fault::PlanChanged if is_seen => Cause::PlanChanged("trajectory.csv".to_owned()),
            _ => return None,
        };
        self.stopped = true;
        Some(cause)
    }
}

/// A piece of a plan that trials are run on, and the bounds that are printed for it.
#[derive(Debug, Clone)]
pub struct TrialPiece {
    plan: StreamPlan,
    /// Of every fifth row.
    printed: Vec<Travel>,
    /// How far the arm may be behind its targets, in rows.
    backlog: f64,
    buffer: Option<Buffer>,
}

/// Rows that share a bound.
const BLOCK: usize = 5;
/// Seconds that approach and start take before a piece is run.
const BEFORE_S: f64 = 0.15;
/// Simulated seconds after which a trial counts as hung.
const MOST_S: f64 = 10.0;
/// Seconds that the world goes on after the run has ended.
const AFTER_S: f64 = 0.3;
/// Rows ahead of the arm among which it is looked for first.
const AHEAD_ROWS: f64 = 40.0;
/// The row of a piece that a run starts at.
const START_ROW: f64 = 1.0;

impl TrialPiece {
    /// So many rows of a plan, from a row on; fewer at its end.
    pub fn new(plan: &StreamPlan, from_row: usize, rows: usize) -> Self {
        let plan = plan.piece(from_row, rows);
        let printed = (0..plan.track.rows()).step_by(BLOCK).map(|row| plan.travel(row)).collect();
        let backlog = plan.settings().timing.backlog_s() / plan.period_s;
        Self { plan, printed, backlog, buffer: None }
    }

    /// The same piece, followed by a program on the controller that holds targets for `depth_s` beyond what a stop needs.
    #[must_use]
    pub fn buffered(mut self, depth_s: f64) -> Self {
        let plan = &mut self.plan;
        for (n, travel) in self.printed.iter_mut().enumerate() {
            let row = (BLOCK * n).min(plan.track.rows() - 1);
            travel.along_mm = bound::along_buffered_mm(plan, row, plan.rate[row], depth_s);
        }
        let buffer = Buffer::new(depth_s, plan.period_s, plan.ramp_per_s);
        // so far behind the newest target the arm is where it shall be
        plan.lag_by(buffer.whole_s());
        self.buffer = Some(buffer);
        self
    }

    /// The largest bound of the targets that an arm at a row may have.
    fn bound(&self, row: f64) -> Travel {
        let first = (row as usize / BLOCK).min(self.printed.len() - 1);
        let last = ((row + self.backlog) as usize / BLOCK + 1).min(self.printed.len() - 1);
        self.printed[first..=last].iter().fold(Travel::default(), |a, b| a.max(*b))
    }

    /// Runs it with a fault at a drawn moment; `resume`: also run the rest of it after a stop.
    pub fn run(&self, fault: Fault, seed: u64, resume: bool) -> TrialResult {
        let plan = &self.plan;
        let mut draws = SeededDraws::new(seed ^ 0x9e37_79b9_7f4a_7c15);
        let q = match fault {
            Fault::WrongStart(mm) => aside(plan, &plan.track.joints(START_ROW), mm, &mut draws),
            _ => plan.track.joints(START_ROW),
        };
        let held_s = self.buffer.as_ref().map_or(0.0, Buffer::whole_s);
        let drawn_s = BEFORE_S + held_s + draws.between(0.0, plan.duration_s());
        let onset_s = if fault.is_standing() { 0.0 } else { drawn_s };
        let world = World::new(plan, q, (fault, onset_s), seed);
        let world = world.traced().buffered(self.buffer.clone());
        let world = Rc::new(RefCell::new(world));
        let Ran { outcome, used_s, began_s } = once(plan, START_ROW, fault, &world);
        let end_s = world.borrow().now_s() + AFTER_S;
        world.borrow_mut().advance(end_s);
        let since_s = if fault.is_gradual() || fault.is_standing() { onset_s.max(used_s) } else { onset_s };
        let (travel, bound, end_row) =
            self.judge(&world.borrow(), began_s, outcome.cause.as_ref().map(|_| since_s));
        let resume_row = plan.resume_row(outcome.reached_row);
        let skipped_mm = plan.track.way_mm(end_row.min(resume_row), resume_row);
        let unfinished = outcome.cause.is_some() && !matches!(outcome.cause, Some(Cause::NotReady(_)));
        let (mut resumed, mut swept) = (None, None);
        if resume && unfinished && !fault.is_standing() {
            let (q, never) = (world.borrow().q(), (Fault::None, f64::INFINITY));
            let again = World::new(plan, q, never, seed.wrapping_add(1));
            let again = Rc::new(RefCell::new(again.traced().buffered(self.buffer.clone())));
            let rest = once(plan, resume_row, Fault::None, &again);
            if rest.outcome.cause.is_none() {
                let mut executed_mm = self.way_mm(&world.borrow(), began_s);
                executed_mm.extend(self.way_mm(&again.borrow(), rest.began_s));
                let planned_mm = &plan.track.burr_mm()[START_ROW as usize..];
                swept = swept::compare(planned_mm, &executed_mm);
            }
            resumed = Some(rest.outcome);
        }
        TrialResult { outcome, travel, bound, resumed, swept, skipped_mm }
    }

    /// Where the burr was from a time on, mm.
    fn way_mm(&self, world: &World, since_s: f64) -> Vec<Vector3<f64>> {
        let trace = world.trace().iter().filter(|(time_s, _)| *time_s >= since_s);
        trace.map(|(_, q)| self.plan.arm.tool_at(q).translation_mm).collect()
    }

    /// The least that the burr may be off its path by, mm.
    pub fn tolerance_mm(&self) -> f64 {
        (0..self.plan.track.rows()).map(|row| self.plan.tolerance_mm(row)).fold(f64::INFINITY, f64::min)
    }

    /// Where on the path an arm is that was at a row a moment ago.
    ///
    /// Where the path stands, that may be many rows on, and where it comes back the arm is near to two of its rows: of the ranges ahead the shortest whose
    /// nearest row is within its bound tells, and where there is none, the whole path.
    fn where_on_path(&self, row: f64, burr_mm: &Vector3<f64>) -> NearestOnTrack {
        let track = &self.plan.track;
        let ahead =
            |rows: f64| track.nearest((row - 5.0).max(0.0), (row + rows).min(track.last_row()), burr_mm);
        let is_on = |near: &NearestOnTrack| near.distance_mm <= self.bound(near.row).off_mm;
        let ranges = std::iter::successors(Some(AHEAD_ROWS), |rows| {
            (row + rows < track.last_row()).then_some(2.0 * rows)
        });
        ranges.map(ahead).find(is_on).unwrap_or_else(|| track.nearest(0.0, track.last_row(), burr_mm))
    }

    /// Travel along the path since a failure, farthest off it since the plan began, their bounds, and the farthest row that the arm was at.
    fn judge(&self, world: &World, began_s: f64, stopped_s: Option<f64>) -> (Travel, Travel, f64) {
        let track = &self.plan.track;
        let (mut travel, mut bound) = (Travel::default(), Travel::default());
        let (mut row, mut farthest, mut failed, mut worst) = (START_ROW, START_ROW, None, f64::NEG_INFINITY);
        // before it begins, the plan's tube says nothing
        for (time_s, q) in world.trace().iter().filter(|(time_s, _)| *time_s >= began_s) {
            let burr_mm = self.plan.arm.tool_at(q).translation_mm;
            let near = self.where_on_path(row, &burr_mm);
            row = near.row;
            farthest = farthest.max(row);
            if failed.is_none() && stopped_s.is_some_and(|since_s| *time_s >= since_s) {
                failed = Some(row);
            }
            let allowed = self.bound(row);
            if near.distance_mm - allowed.off_mm > worst {
                worst = near.distance_mm - allowed.off_mm;
                (travel.off_mm, bound.off_mm) = (near.distance_mm, allowed.off_mm);
            }
        }
        if let Some(failed) = failed {
            travel.along_mm = track.way_mm(failed, row);
            bound.along_mm = self.bound(failed).along_mm;
        }
        (travel, bound, farthest)
    }
}

/// A run, when the newest state that it used was made, and when its plan began, s.
struct Ran {
    outcome: RunEnd,
    used_s: f64,
    began_s: f64,
}

/// Runs a plan in a world.
fn once(plan: &StreamPlan, start_row: f64, fault: Fault, world: &Rc<RefCell<World>>) -> Ran {
    let (mut link, mut clock) = (WorldLink(world.clone()), WorldClock(world.clone()));
    let mut session = Session::new(plan, start_row, clock.now_s());
    let look_s = plan.settings().timing.transport_s;
    let mut operator =
        Yes { world: world.clone(), fault, asked: false, stopped: false, look_s, began_s: f64::INFINITY };
    let outcome = drive(&mut session, &mut link, &mut clock, &mut operator, None::<&mut LogWriter<Vec<u8>>>);
    let used_s = session.state().map_or(0.0, |state| world.borrow().made_s(state));
    Ran { outcome, used_s, began_s: operator.began_s }
}

/// Joints that have the burr beside where it is, across the shaft.
fn aside(plan: &StreamPlan, q: &Joints, mm: f64, draws: &mut SeededDraws) -> Joints {
    let mut tool = plan.arm.tool_at(q);
    let angle = draws.between(0.0, std::f64::consts::TAU);
    tool.translation_mm += tool.rotation * (mm * Vector3::new(angle.cos(), angle.sin(), 0.0));
    let found = dls::solve(&plan.arm, &ToolGoal::Pose(tool), &q[..plan.arm.dof()]);
    padded(&found.q).unwrap_or(*q)
}
