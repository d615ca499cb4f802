//! The loop that carries out what a [`Session`] decides: the only place where link, clock, user and log meet.

use std::io::Write;

use crate::stream::cause::{Cause, Event, Question, RunEnd};
use crate::stream::link::{ArmLink, Clock};
use crate::stream::log::LogWriter;
use crate::stream::session::{Seen, Session};

/// Who is told and asked.
pub trait Operator {
    /// Hears what happens.
    fn tell(&mut self, event: &Event);
    /// Is asked; the answer comes later.
    fn ask(&mut self, question: &Question);
    /// The answer to the last question, once.
    fn answer(&mut self) -> Option<bool>;
    /// Why the run must be stopped, as soon as there is a reason.
    fn stop(&mut self) -> Option<Cause>;
}

/// Runs a session to its end.
pub fn drive<W: Write>(
    session: &mut Session<'_>,
    link: &mut impl ArmLink,
    clock: &mut impl Clock,
    operator: &mut impl Operator,
    mut log: Option<&mut LogWriter<W>>,
) -> RunEnd {
    let mut broken_log = None;
    loop {
        let (state, fault) = (link.state(), link.fault());
        let stop = operator.stop().or_else(|| broken_log.clone());
        let identity = link.identity();
        let (waiting, answer) = (link.waiting(), operator.answer());
        let now_s = clock.now_s();
        let seen = Seen { now_s, state, identity, fault, waiting, answer, stop };
        let step = session.step(&seen);
        if let Some(order) = &step.order {
            link.order(order);
        }
        for event in &step.events {
            operator.tell(event);
        }
        if let Some(question) = &step.question {
            operator.ask(question);
        }
        if let Some(log) = log.as_deref_mut().filter(|_| broken_log.is_none())
            && let Err(error) = log.step(session, &seen, &step)
        {
            broken_log = Some(Cause::Log(error.to_string()));
        }
        if let Some(outcome) = step.outcome {
            return outcome;
        }
        clock.sleep_until_s(step.wake_s);
    }
}
