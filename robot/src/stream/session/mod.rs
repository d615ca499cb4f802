//! All decisions of a run, one step at a time: what is seen goes in, what is to be done comes out.
//!
//! connect → check → (user) → start → approach → spindle → run ⇄ hold → end. A [`Session`] touches no arm, clock or file, so the same
//! code decides on hardware, in a rehearsal and in simulated time. No target is ever sent on a state that is too old, after a fault, or
//! a second time within half a period, or while more orders wait for the arm's client than are sent in an order's assumed time on its way;
//! every wait has a deadline. While a state is late the arm keeps its last target, which is within the bound of a lost state: the run goes
//! on where a new one comes in time.

mod phases;

use std::collections::VecDeque;

use nalgebra::Vector3;

use crate::stream::approach::Approach;
use crate::stream::cause::{Cause, Event, Question, RunEnd};
use crate::stream::follower::Follower;
use crate::stream::link::{ArmState, Identity, Joints, LinkFault, Order};
use crate::stream::plan::StreamPlan;
use crate::stream::watch::{Deviation, Watch};

/// How long too many orders may wait in all, s: the controller's watchdog stops the arm after as long. A tenth of the time in which
/// they do not is taken off again, so that a client that is always slow is stopped like one that hangs.
const MOST_WAITING_S: f64 = 0.1;
const FORGIVEN_SHARE: f64 = 0.1;
/// How long the arm keeps its last target while states are late, s in all, forgiven like the above: half of the controller's watchdog, so
/// that the stop that follows comes first.
const MOST_LATE_S: f64 = 0.05;
/// Age of a state from which on nothing is waited for, s: the controller's watchdog has stopped the arm by then.
const MOST_AGE_S: f64 = 0.1;

/// What a step is told.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    /// Now, on the PC's clock, s.
    pub now_s: f64,
    /// The link's newest state.
    pub state: Option<ArmState>,
    /// Which arm it is, once known.
    pub identity: Option<Identity>,
    /// What is wrong with the link.
    pub fault: Option<LinkFault>,
    /// Orders that its client has not taken yet.
    pub waiting: usize,
    /// The user's answer to the last question, once given.
    pub answer: Option<bool>,
    /// Why somebody outside wants it to stop: the user, the log, a changed plan.
    pub stop: Option<Cause>,
}

/// What is to be done after a step.
#[derive(Debug, Clone, Default)]
pub struct Decision {
    /// What the arm is told.
    pub order: Option<Order>,
    /// What the user is told.
    pub events: Vec<Event>,
    /// What the user is asked; not waited for.
    pub question: Option<Question>,
    /// When to step again, s.
    pub wake_s: f64,
    /// How it ended; no step after it.
    pub outcome: Option<RunEnd>,
}

/// What a run does.
#[derive(Debug)]
enum Phase {
    Connecting {
        since_s: f64,
    },
    Confirming(Box<Approach>),
    Starting {
        approach: Box<Approach>,
        since_s: f64,
    },
    Approaching(Box<Approach>),
    RunUp,
    Running,
    Holding(Holding),
    /// Slowing down along the path.
    Braking,
    /// The plan's end is reached: the arm gets there.
    Settling {
        until_s: f64,
    },
    Ending(Ending),
}

/// A hold: why, where it began, in rows, and what is done now.
#[derive(Debug)]
struct Holding {
    why: String,
    from_row: f64,
    part: HoldPart,
}

/// The end: since when, s, and where the arm has stood still since when.
#[derive(Debug)]
struct Ending {
    since_s: f64,
    since_rest_s: f64,
    rest_q: Option<Joints>,
}

/// A trouble that may pass: whether it is there, how long it was in all, less what is forgiven, and when it was looked at, s.
#[derive(Debug)]
struct Passing {
    is_there: bool,
    in_all_s: f64,
    seen_s: f64,
}

impl Passing {
    fn none(now_s: f64) -> Self {
        Self { is_there: false, in_all_s: 0.0, seen_s: now_s }
    }

    fn observe(&mut self, is_there: bool, now_s: f64) {
        let passed_s = (now_s - self.seen_s).max(0.0);
        let change_s = if self.is_there { passed_s } else { -FORGIVEN_SHARE * passed_s };
        *self = Self { is_there, in_all_s: (self.in_all_s + change_s).max(0.0), seen_s: now_s };
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum HoldPart {
    Back,
    /// With the spindle off; asked once that is seen.
    Waiting {
        asked: bool,
    },
    RunUp,
}

/// The spindle's output: what was ordered last and when, s; since when the controller's states agree, s; whether it may be on.
#[derive(Debug)]
struct Spindle {
    ordered: bool,
    ordered_s: f64,
    agrees_s: Option<f64>,
    may_turn: bool,
}

/// How long the controller's states may take to agree with an order to the spindle, s.
const SPINDLE_S: f64 = 1.0;

impl Spindle {
    /// Takes a new state.
    fn observe(&mut self, on: bool, now_s: f64) {
        if on == self.ordered {
            self.agrees_s.get_or_insert(now_s);
        }
        self.may_turn = on || self.ordered;
    }

    /// What is wrong where the newest state has it on or off.
    fn trouble(&self, on: bool, now_s: f64) -> Option<Cause> {
        let wrong = match (self.ordered, self.agrees_s.is_some()) {
            _ if on == self.ordered => return None,
            (_, false) if now_s - self.ordered_s <= SPINDLE_S => return None,
            (true, true) => {
                "the spindle's output went off, not by this program: a burr that stands still is not fed"
            }
            (false, true) => "the spindle's output went on, not by this program",
            (true, false) => "the spindle's output was switched on and is not seen on: nothing is fed",
            (false, false) => "the spindle's output was switched off and is still seen on",
        };
        Some(Cause::Spindle(wrong))
    }
}

/// A run of a plan.
#[derive(Debug)]
pub struct Session<'a> {
    plan: &'a StreamPlan,
    phase: Phase,
    watch: Watch,
    follower: Follower,
    queue: VecDeque<Order>,
    due_s: Option<f64>,
    cause: Option<Cause>,
    deviation: Option<Deviation>,
    reached_row: f64,
    next_hold: usize,
    told_fraction: f64,
    tare: (Vector3<f64>, u32),
    excess_states: u32,
    began_s: Option<f64>,
    targets: u64,
    late: (u64, f64),
    farthest_mm: f64,
    spindle: Spindle,
    /// Gaps since the user was told of them, and the longest, s; and when, s.
    gaps: (u32, f64),
    told_s: f64,
    commanded: Option<Joints>,
    /// More orders wait for the arm's client than may.
    backlog: Passing,
    /// The newest state is too old for a target.
    late_state: Passing,
    /// The user's answer until it is used: it may come with an order before it.
    answer: Option<bool>,
}

impl<'a> Session<'a> {
    /// A run from a row of the plan: 0, or where an earlier run was stopped.
    pub fn new(plan: &'a StreamPlan, start_row: f64, now_s: f64) -> Self {
        let last = plan.track.last_row();
        let start_row = start_row.clamp(0.0, last);
        let backlog_s = plan.settings().timing.backlog_s();
        let follower = Follower::new(plan.period_s, plan.ramp_per_s, backlog_s, last, start_row);
        Self {
            plan,
            phase: Phase::Connecting { since_s: now_s },
            watch: Watch::default(),
            follower,
            queue: VecDeque::new(),
            due_s: None,
            cause: None,
            deviation: None,
            reached_row: start_row,
            next_hold: plan.holds.partition_point(|h| (h.row as f64) < start_row),
            told_fraction: 1.0,
            tare: (Vector3::zeros(), 0),
            excess_states: 0,
            began_s: None,
            targets: 0,
            late: (0, 0.0),
            farthest_mm: 0.0,
            spindle: Spindle { ordered: false, ordered_s: now_s, agrees_s: None, may_turn: false },
            gaps: (0, 0.0),
            told_s: now_s,
            commanded: None,
            backlog: Passing::none(now_s),
            late_state: Passing::none(now_s),
            answer: None,
        }
    }

    /// The newest target, once there is one.
    pub fn commanded(&self) -> Option<&Joints> {
        self.commanded.as_ref()
    }

    /// The newest state.
    pub fn state(&self) -> Option<&ArmState> {
        self.watch.newest()
    }

    /// Age of the newest state, s.
    pub fn age_s(&self, now_s: f64) -> f64 {
        self.watch.age_s(now_s)
    }

    /// Where the arm is beside its track.
    pub fn deviation(&self) -> Option<Deviation> {
        self.deviation
    }

    /// The arm's place on the plan, in rows: where an interrupted run goes on.
    pub fn reached_row(&self) -> f64 {
        self.reached_row
    }

    /// The newest target's place in the plan, in rows, and the share of the planned speed.
    pub fn place(&self) -> (f64, f64) {
        (self.follower.row(), self.follower.rate())
    }

    /// What it does, in a word, as logs have it.
    pub fn phase(&self) -> &'static str {
        match self.phase {
            Phase::Connecting { .. } => "connect",
            Phase::Confirming(_) => "confirm",
            Phase::Starting { .. } => "start",
            Phase::Approaching(_) => "approach",
            Phase::RunUp => "run_up",
            Phase::Running => "run",
            Phase::Holding(_) => "hold",
            Phase::Braking => "brake",
            Phase::Settling { .. } => "settle",
            Phase::Ending(_) => "end",
        }
    }

    /// Decides what is done now.
    pub fn step(&mut self, seen: &Seen) -> Decision {
        let now_s = seen.now_s;
        let mut step = Decision { wake_s: now_s + self.plan.period_s, ..Decision::default() };
        let fresh = match &seen.state {
            Some(state) => self.watch.observe(state, self.plan.settings().timing.clock_drift),
            None => false,
        };
        if let Some(state) = seen.state.filter(|_| fresh) {
            self.spindle.observe(state.spindle_on, now_s);
        }
        self.answer = seen.answer.or(self.answer);
        self.backlog.observe(seen.waiting > self.most_waiting(), now_s);
        let is_late = !(self.watch.age_s(now_s) <= self.plan.settings().timing.state_age_s);
        self.late_state.observe(is_late && self.moves(), now_s);
        if let Some((cause, at_once)) = self.trouble(seen) {
            self.stop(cause, at_once, now_s, &mut step);
        }
        if self.late_state.is_there && self.moves() {
            // the arm keeps its last target
            return step;
        }
        if let Some(order) = self.queue.pop_front() {
            step.order = Some(order);
            return step;
        }
        self.proceed(seen, fresh, &mut step);
        step
    }

    /// What is wrong, and whether the arm must be stopped at once instead of along its path.
    fn trouble(&mut self, seen: &Seen) -> Option<(Cause, bool)> {
        if matches!(self.phase, Phase::Ending(_)) {
            self.find_the_reason();
            return None;
        }
        let moving = self.moves();
        if moving && let Some(cause) = self.watch.stopped_itself().or_else(|| self.watch.nonsense()) {
            return Some((cause, true));
        }
        if let Some(fault) = &seen.fault {
            return Some((Cause::Link(fault.clone()), true));
        }
        if moving && self.backlog.in_all_s > MOST_WAITING_S {
            return Some((Cause::Link(LinkFault::NotTaken("its orders in time")), true));
        }
        if moving && self.late_state.is_there {
            let age_s = self.watch.age_s(seen.now_s);
            if !(age_s <= MOST_AGE_S && self.late_state.in_all_s <= MOST_LATE_S) {
                return Some((Cause::Stale { age_s }, true));
            }
        } else if moving {
            // a late state was judged when it was none
            if let Some(cause) = self.off_track() {
                return Some((cause, true));
            }
            let on = self.watch.newest().is_some_and(|state| state.spindle_on);
            if let Some(cause) = self.spindle.trouble(on, seen.now_s) {
                return Some((cause, true));
            }
        }
        let lost = || self.watch.sensor_lost().filter(|_| moving);
        let stop = seen.stop.clone().or_else(lost).filter(|_| self.cause.is_none());
        stop.map(|cause| (cause, !moving))
    }

    /// An arm that stopped itself is the reason for what was seen before it said so.
    fn find_the_reason(&mut self) {
        let follows = matches!(
            self.cause,
            Some(
                Cause::Link(_)
                    | Cause::SensorLost
                    | Cause::OffPath { .. }
                    | Cause::AxisOff { .. }
                    | Cause::JointOff { .. }
            )
        );
        let reason = self.watch.stopped_itself();
        if follows && matches!(reason, Some(Cause::SafetyMode(_) | Cause::Restarted)) {
            self.cause = reason;
        }
    }

    /// Whether targets are being sent.
    fn moves(&self) -> bool {
        use Phase::{Approaching, Braking, Holding, RunUp, Running, Settling};
        matches!(self.phase, Approaching(_) | RunUp | Running | Holding(_) | Braking | Settling { .. })
            && self.commanded.is_some()
    }

    /// Orders that may wait for the arm's client before the next target: as many as the assumed transport holds. What piles up beyond it
    /// would reach the arm at once.
    fn most_waiting(&self) -> usize {
        let periods = self.plan.settings().timing.transport_s / self.plan.period_s;
        (periods.round() as usize).max(1)
    }

    fn off_track(&mut self) -> Option<Cause> {
        let plan = self.plan;
        let backlog = self.follower.backlog();
        let judged = match &self.phase {
            Phase::Approaching(approach) => {
                let most_mm = plan.tolerance_mm(approach.row as usize);
                self.watch.judge(plan, &approach.track, backlog, |_| most_mm)
            }
            _ => self.watch.judge(plan, &plan.track, backlog, |row| plan.tolerance_mm(row)),
        };
        let (deviation, cause) = judged?;
        self.deviation = Some(deviation);
        self.farthest_mm = self.farthest_mm.max(deviation.off_mm);
        // an arm beside its path may be behind all that it was told lately
        if self.began_s.is_some() && cause.is_none() {
            self.reached_row = deviation.row;
        }
        cause
    }

    fn stop(&mut self, cause: Cause, at_once: bool, now_s: f64, step: &mut Decision) {
        step.events.push(Event::Stopping(cause.clone()));
        self.cause.get_or_insert(cause);
        if at_once || matches!(self.phase, Phase::Approaching(_)) || self.commanded.is_none() {
            self.end(now_s);
        } else {
            // no spindle goes on any more
            self.queue.clear();
            self.phase = Phase::Braking;
        }
    }

    /// Stops the arm and lets go of it.
    fn end(&mut self, now_s: f64) {
        self.queue.clear();
        if self.commanded.is_some() {
            self.queue.push_back(Order::Stop);
            self.switch_spindle(false, now_s);
        }
        self.phase = Phase::Ending(Ending { since_s: now_s, since_rest_s: now_s, rest_q: None });
    }

    fn switch_spindle(&mut self, on: bool, now_s: f64) {
        self.queue.push_back(Order::Spindle(on));
        if on != self.spindle.ordered {
            let may_turn = on || self.spindle.may_turn;
            self.spindle = Spindle { ordered: on, ordered_s: now_s, agrees_s: None, may_turn };
        }
    }

    /// Whether the spindle was seen on for as long as it needs to run up.
    fn has_run_up(&self, now_s: f64) -> bool {
        self.spindle.agrees_s.is_some_and(|since_s| now_s >= since_s + self.plan.settings().run_up_s)
    }

    fn proceed(&mut self, seen: &Seen, fresh: bool, step: &mut Decision) {
        let now_s = seen.now_s;
        match std::mem::replace(&mut self.phase, Phase::Braking) {
            Phase::Connecting { since_s } => self.connect(seen, since_s, step),
            Phase::Confirming(approach) => self.confirm(seen, approach, step),
            Phase::Starting { approach, since_s } => self.start(seen, approach, since_s, step),
            Phase::Approaching(approach) => self.approach(now_s, approach, step),
            Phase::RunUp => {
                self.phase = Phase::RunUp;
                self.weigh(fresh && self.spindle.agrees_s.is_some());
                self.send(now_s, 0.0, step);
                if self.has_run_up(now_s) {
                    self.begin(now_s, step);
                }
            }
            Phase::Running => self.run(now_s, fresh, step),
            Phase::Holding(holding) => self.hold(seen, holding, step),
            Phase::Braking => {
                self.send(now_s, 0.0, step);
                let back_s = self.plan.settings().timing.backlog_s();
                self.phase = Phase::Braking;
                if self.follower.rate() == 0.0 {
                    self.phase = Phase::Settling { until_s: now_s + back_s };
                }
            }
            Phase::Settling { until_s } => {
                self.phase = Phase::Settling { until_s };
                self.send(now_s, 0.0, step);
                if now_s >= until_s {
                    self.end(now_s);
                }
            }
            Phase::Ending(ending) => self.finish(seen, ending, step),
        }
    }
}
