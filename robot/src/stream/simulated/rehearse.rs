//! A rehearsal: the whole run on a simulated arm, faster than real time, with the log of a real one.

use std::cell::RefCell;
use std::io::Write;
use std::rc::Rc;

use super::fault::Fault;
use super::world::{World, WorldClock, WorldLink};
use crate::stream::cause::RunEnd;
use crate::stream::drive::{Operator, drive};
use crate::stream::link::Clock;
use crate::stream::log::LogWriter;
use crate::stream::plan::StreamPlan;
use crate::stream::session::Session;

/// Runs a plan from a row to its end; the arm stands there to begin with.
pub fn rehearse<W: Write>(
    plan: &StreamPlan,
    start_row: f64,
    seed: u64,
    operator: &mut impl Operator,
    log: Option<&mut LogWriter<W>>,
) -> RunEnd {
    let q = plan.track.joints(start_row);
    let world = World::new(plan, q, (Fault::None, f64::INFINITY), seed);
    let world = Rc::new(RefCell::new(world));
    let (mut link, mut clock) = (WorldLink(world.clone()), WorldClock(world));
    let mut session = Session::new(plan, start_row, clock.now_s());
    drive(&mut session, &mut link, &mut clock, operator, log)
}
