//! What is done in each phase of a run: from the first answer to the arm at rest.

use crate::stream::approach::Approach;
use crate::stream::cause::{Cause, Event, Question, RunEnd, SpindleEnd};
use crate::stream::check::{self, FULL_SPEED};
use crate::stream::follower::Follower;
use crate::stream::link::{ArmState, Identity, Joints, Order};
use crate::stream::plan::{StreamPlan, ramp_per_s};
use crate::stream::track::Track;
use crate::stream::watch::Watch;

use super::{Decision, Ending, HoldPart, Holding, Phase, Seen, Session};

/// How long the arm gets to reach its last target beyond its lag, s.
const SETTLE_S: f64 = 0.2;
/// How long an ending arm is watched until it rests, s.
const REST_PATIENCE_S: f64 = 0.3;
/// How long it must stand still to be at rest, s, and how still, rad.
const REST_S: f64 = 0.03;
const REST_RAD: f64 = 3e-5;
/// How far a joint may have moved since the user confirmed the way, rad: the noise of an arm that stands, 0.2 mm at the tool.
const MOVED_RAD: f64 = 2e-4;
/// How often the user is told how far it is, s.
const PROGRESS_S: f64 = 10.0;
/// New states in a row with too much force before it counts.
const FORCE_STATES: u32 = 25;

impl Session<'_> {
    pub(super) fn connect(&mut self, seen: &Seen, since_s: f64, step: &mut Decision) {
        self.phase = Phase::Connecting { since_s };
        let waited_s = seen.now_s - since_s;
        let is_known = self.watch.nonsense().is_some() || check::rate_is_known(self.plan, &self.watch);
        let (Some(state), Some(identity), true) = (self.watch.newest().copied(), &seen.identity, is_known)
        else {
            if waited_s > self.plan.settings().patience_s {
                let what = "the controller's state and identity";
                self.stop(Cause::NoAnswer { what, waited_s }, true, seen.now_s, step);
            }
            return;
        };
        match check::ready(self.plan, &self.watch, identity)
            .and_then(|()| Approach::new(self.plan, &state.q, self.follower.row()))
        {
            Err(why) => self.stop(Cause::NotReady(why), true, seen.now_s, step),
            Ok(approach) => {
                step.question = Some(question(self.plan, &approach, identity.clone()));
                self.phase = Phase::Confirming(Box::new(approach));
            }
        }
    }

    pub(super) fn confirm(&mut self, seen: &Seen, approach: Box<Approach>, step: &mut Decision) {
        let settings = self.plan.settings();
        let age_s = self.watch.age_s(seen.now_s);
        match self.answer {
            None => self.phase = Phase::Confirming(approach),
            Some(true) if !(age_s <= settings.patience_s) => {
                self.stop(Cause::Stale { age_s }, true, seen.now_s, step);
            }
            // until a state is as new as one that a target may be sent on
            Some(true) if !(age_s <= settings.timing.state_age_s) => self.phase = Phase::Confirming(approach),
            Some(false) => self.stop(Cause::Declined, true, seen.now_s, step),
            // what held when the user was asked may hold no more
            Some(true) => match self.ready_again(seen, check::ready) {
                Err(cause) => self.stop(cause, true, seen.now_s, step),
                Ok(()) => {
                    self.answer = None;
                    step.order = Some(Order::Start);
                    step.events.push(Event::Stage("start"));
                    self.phase = Phase::Starting { approach, since_s: seen.now_s };
                }
            },
        }
    }

    /// The start conditions once more.
    fn ready_again(
        &self,
        seen: &Seen,
        conditions: impl Fn(&StreamPlan, &Watch, &Identity) -> Result<(), String>,
    ) -> Result<(), Cause> {
        let identity = seen.identity.clone().unwrap_or_default();
        conditions(self.plan, &self.watch, &identity).map_err(Cause::NotReady)
    }

    pub(super) fn start(&mut self, seen: &Seen, approach: Box<Approach>, since_s: f64, step: &mut Decision) {
        let now_s = seen.now_s;
        let waited_s = now_s - since_s;
        let fresh = self.watch.age_s(now_s) <= self.plan.settings().timing.state_age_s;
        // the client's answer says that the watchdog was taken
        if seen.waiting == 0 && self.watch.stopped_itself().is_none() && fresh {
            return match self.ready_again(seen, check::still_ready) {
                Err(cause) => self.stop(cause, true, now_s, step),
                Ok(()) => self.enter(now_s, *approach, step),
            };
        }
        if waited_s > self.plan.settings().patience_s {
            let what = "that the program on the controller runs under its watchdog, with a fresh state";
            return self.stop(Cause::NoAnswer { what, waited_s }, true, now_s, step);
        }
        self.phase = Phase::Starting { approach, since_s };
    }

    /// The arm may have been moved while the user was asked: the way begins where it is now.
    fn enter(&mut self, now_s: f64, approach: Approach, step: &mut Decision) {
        let Some(&ArmState { q, force_n, .. }) = self.watch.newest() else { return };
        if let Some(cause) = self.watch.sensor_lost() {
            return self.stop(cause, true, now_s, step);
        }
        let moved_rad = q.iter().zip(&approach.track.q()[0]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        if !(moved_rad <= MOVED_RAD) {
            let why = "the arm was moved after the approach was confirmed: start again".to_owned();
            return self.stop(Cause::NotReady(why), true, now_s, step);
        }
        let approach = approach.begun_at(self.plan, &q);
        if force_n.is_none() {
            step.events.push(Event::Stage("no force sensor: forces toward structures are not watched"));
        }
        step.events.push(Event::Stage("approach"));
        let backlog_s = self.plan.settings().timing.backlog_s();
        let ramp = ramp_per_s(&approach.track, self.plan.period_s);
        let last = approach.track.last_row();
        self.follower = Follower::new(self.plan.period_s, ramp, backlog_s, last, 0.0);
        self.phase = Phase::Approaching(Box::new(approach));
    }

    pub(super) fn approach(&mut self, now_s: f64, approach: Box<Approach>, step: &mut Decision) {
        let last = approach.track.last_row();
        // slows down so that it rests at the end; crawls the last of it
        let brakes = last - self.follower.row() <= self.follower.rows_to_rest() + 1.0;
        let fraction = self.fraction(step);
        self.send_on(&approach.track, now_s, if brakes { fraction.min(0.02) } else { fraction }, step);
        if self.follower.backlog().0 < last {
            self.phase = Phase::Approaching(approach);
            return;
        }
        let (plan, backlog_s) = (self.plan, self.plan.settings().timing.backlog_s());
        let end = plan.track.last_row();
        self.follower = Follower::new(plan.period_s, plan.ramp_per_s, backlog_s, end, approach.row);
        self.switch_spindle(true, now_s);
        step.events.push(Event::Stage("spindle"));
        self.phase = Phase::RunUp;
    }

    pub(super) fn begin(&mut self, now_s: f64, step: &mut Decision) {
        step.events.push(Event::Stage("run"));
        self.began_s = Some(now_s);
        if self.follower.row() == 0.0 {
            // the plan rests at its first row, so it starts there at once
            self.follower.set_rate(self.plan.rate.first().copied().unwrap_or(0.0));
        }
        self.phase = Phase::Running;
    }

    pub(super) fn run(&mut self, now_s: f64, fresh: bool, step: &mut Decision) {
        self.phase = Phase::Running;
        let row = self.follower.row();
        if now_s >= self.told_s + PROGRESS_S {
            self.told_s = now_s;
            let gaps = std::mem::take(&mut self.gaps);
            step.events.push(Event::Progress { row, last_row: self.plan.track.last_row(), gaps });
        }
        if row >= self.plan.track.last_row() {
            let lag_s = self.plan.settings().timing.backlog_s();
            self.phase = Phase::Settling { until_s: now_s + lag_s + SETTLE_S };
            return self.send(now_s, 0.0, step);
        }
        let held = self.plan.holds.get(self.next_hold);
        let why = match held.filter(|h| row + self.follower.rows_to_rest() + 1.0 >= h.row as f64) {
            Some(hold) => {
                self.next_hold += 1;
                Some(hold.why.clone())
            }
            None => self.too_much_force(fresh),
        };
        if let Some(why) = why {
            step.events.push(Event::Hold(why.clone()));
            self.phase = Phase::Holding(Holding { why, from_row: row, part: HoldPart::Back });
        }
        let wanted = self.wanted_rate(step);
        self.send(now_s, wanted, step);
    }

    /// The share of full speed that the controller runs at; a change is told.
    fn fraction(&mut self, step: &mut Decision) -> f64 {
        let fraction = self.watch.newest().map_or(0.0, |state| state.speed_fraction);
        let fraction = if fraction >= FULL_SPEED { 1.0 } else { fraction };
        if (fraction - self.told_fraction).abs() > 0.02 || (fraction == 1.0) != (self.told_fraction == 1.0) {
            self.told_fraction = fraction;
            step.events.push(if fraction < 0.005 { Event::Paused } else { Event::SpeedFraction(fraction) });
        }
        fraction
    }

    /// The share of the planned speed that plan and controller allow here.
    fn wanted_rate(&mut self, step: &mut Decision) -> f64 {
        let fraction = self.fraction(step);
        let row = (self.follower.row() + 1.0) as usize;
        fraction.min(self.plan.rate.get(row).copied().unwrap_or(1.0))
    }

    /// Goes back along the path, which is free as the burr was just there, waits with the spindle off, and goes on.
    pub(super) fn hold(&mut self, seen: &Seen, holding: Holding, step: &mut Decision) {
        let now_s = seen.now_s;
        let Holding { why, from_row, mut part } = holding;
        let mut wanted = 0.0;
        match part {
            HoldPart::Back => {
                let back_mm = self.plan.track.way_mm(self.follower.row(), from_row);
                let goes = back_mm < self.plan.settings().retreat_mm && self.follower.row() > 0.0;
                if goes {
                    wanted = -0.5 * self.wanted_rate(step);
                } else if self.follower.rate() == 0.0 {
                    self.switch_spindle(false, now_s);
                    part = HoldPart::Waiting { asked: false };
                }
            }
            HoldPart::Waiting { asked: false } => {
                if self.spindle.agrees_s.is_some() {
                    step.question = Some(Question::GoOn(why.clone()));
                    part = HoldPart::Waiting { asked: true };
                }
            }
            HoldPart::Waiting { asked: true } => match self.answer.take() {
                Some(true) => {
                    self.switch_spindle(true, now_s);
                    part = HoldPart::RunUp;
                }
                Some(false) => {
                    self.send(now_s, 0.0, step);
                    return self.stop(Cause::Declined, false, now_s, step);
                }
                None => {}
            },
            HoldPart::RunUp => {
                if self.has_run_up(now_s) {
                    step.events.push(Event::Stage("run"));
                    self.excess_states = 0;
                    self.phase = Phase::Running;
                    return self.send(now_s, 0.0, step);
                }
            }
        }
        self.phase = Phase::Holding(Holding { why, from_row, part });
        self.send(now_s, wanted, step);
    }

    /// Force at rest with the spindle on, for the sensor's zero.
    pub(super) fn weigh(&mut self, fresh: bool) {
        if let Some(force_n) = self.watch.newest().and_then(|s| s.force_n).filter(|_| fresh) {
            self.tare = (self.tare.0 + force_n, self.tare.1 + 1);
        }
    }

    /// A force toward a structure that is larger than predicted, for several states in a row.
    fn too_much_force(&mut self, fresh: bool) -> Option<String> {
        let measured = self.watch.newest().and_then(|s| s.force_n).filter(|_| fresh)?;
        let zero = self.tare.0 / f64::from(self.tare.1.max(1));
        let row = self.deviation.map_or(self.follower.row(), |d| d.row);
        let excess = |n: &crate::stream::plan::Near| (measured - zero).dot(&n.toward) - n.force_n;
        let near = self.plan.near(row).iter();
        let (worst, excess_n) = near.map(|n| (n, excess(n))).max_by(|a, b| a.1.total_cmp(&b.1))?;
        let most_n = self.plan.settings().force_excess_n;
        self.excess_states = if excess_n > most_n { self.excess_states + 1 } else { 0 };
        if self.excess_states < FORCE_STATES {
            return None;
        }
        self.excess_states = 0;
        let name = self.plan.structures.get(worst.structure).map_or("a structure", |s| &s.name);
        Some(format!(
            "{:.1} N toward {name}, predicted {:.1} N, at most {most_n:.1} N more",
            excess_n + worst.force_n,
            worst.force_n
        ))
    }

    pub(super) fn send(&mut self, now_s: f64, wanted: f64, step: &mut Decision) {
        let plan = self.plan;
        self.send_on(&plan.track, now_s, wanted, step);
    }

    /// The next target, at its time; none while too many orders wait: the gap is then timed anew like any other.
    fn send_on(&mut self, track: &Track, now_s: f64, wanted: f64, step: &mut Decision) {
        if self.backlog.is_there {
            return;
        }
        let period_s = self.plan.period_s;
        let due_s = self.due_s.unwrap_or(now_s);
        let late_s = now_s - due_s;
        if self.began_s.is_some() {
            self.targets += 1;
            self.late.0 += u64::from(late_s > period_s);
            self.late.1 = self.late.1.max(late_s);
        }
        if let Some(gap_s) = self.follower.advance(now_s, wanted, self.told_fraction) {
            self.gaps = (self.gaps.0 + 1, self.gaps.1.max(gap_s));
            step.events.push(Event::Gap { gap_s });
        }
        let q = track.joints(self.follower.row());
        self.commanded = Some(q);
        step.order = Some(Order::Target(q));
        // absolute, but never two targets within half a period, nor later than one away
        step.wake_s = (due_s + period_s).clamp(now_s + 0.5 * period_s, now_s + period_s);
        self.due_s = Some(step.wake_s);
    }

    pub(super) fn finish(&mut self, seen: &Seen, ending: Ending, step: &mut Decision) {
        let now_s = seen.now_s;
        let Ending { since_s, since_rest_s, rest_q } = ending;
        let fresh = self.watch.age_s(now_s) <= self.plan.settings().timing.state_age_s;
        let q = self.watch.newest().map(|s| s.q).filter(|_| fresh);
        let still = |a: &Joints, b: &Joints| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= REST_RAD);
        let (since_rest_s, rest_q) = match (rest_q, q) {
            (Some(rest), Some(q)) if still(&rest, &q) => (since_rest_s, Some(rest)),
            // a late state says nothing of now: the next one that is in time does
            (Some(rest), None) => (since_rest_s, Some(rest)),
            (_, q) => (now_s, q),
        };
        let never_moved = self.commanded.is_none();
        let at_rest = never_moved || (q.is_some() && now_s - since_rest_s >= REST_S);
        let spindle = self.spindle_end(now_s);
        if (at_rest && spindle == SpindleEnd::Off) || now_s - since_s >= REST_PATIENCE_S {
            step.order = Some(Order::End);
            step.outcome = Some(self.outcome(now_s, at_rest, spindle));
        }
        self.phase = Phase::Ending(Ending { since_s, since_rest_s, rest_q });
    }

    /// What is known of the spindle's output.
    fn spindle_end(&self, now_s: f64) -> SpindleEnd {
        let age_s = self.watch.age_s(now_s);
        let is_fresh = age_s <= self.plan.settings().timing.state_age_s;
        match self.watch.newest().filter(|_| is_fresh).map(|state| state.spindle_on) {
            Some(true) => SpindleEnd::On,
            _ if self.spindle.may_turn => SpindleEnd::Unseen { age_s },
            _ => SpindleEnd::Off,
        }
    }

    fn outcome(&self, now_s: f64, at_rest: bool, spindle: SpindleEnd) -> RunEnd {
        RunEnd {
            cause: self.cause.clone(),
            at_rest,
            spindle,
            reached_row: self.reached_row,
            rows: self.plan.track.rows(),
            seconds: self.began_s.map_or(0.0, |began_s| now_s - began_s),
            targets: self.targets,
            late_targets: self.late.0,
            latest_s: self.late.1,
            farthest_off_mm: self.farthest_mm,
        }
    }
}

fn question(plan: &StreamPlan, approach: &Approach, arm: Identity) -> Question {
    let track = &approach.track;
    Question::Approach {
        arm,
        from_mm: track.burr_at(0.0).into(),
        to_mm: track.burr_at(track.last_row()).into(),
        length_mm: approach.length_mm,
        duration_s: track.last_row() * plan.period_s,
    }
}
