//! Arm, controller, network and the PC's clock, in simulated time.
//!
//! Joints follow the newest target through two equal first-order lags, scaled by the speed fraction; so the arm is a weighted mean of
//! its targets, and never passes them. Any stop slows all joints together, straight in joint space. The controller stops its program
//! when no order came for the watchdog's time. Its clock runs from another zero at another speed. The assumptions are
//! [`StreamTiming`]'s: lag, transport and the least deceleration.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;

use nalgebra::UnitQuaternion;

use super::buffer::Buffer;
use super::fault::{Fault, SeededDraws};
use crate::stream::link::{
    ArmLink, ArmState, Clock, Identity, Joints, LinkFault, Order, PLAYING, ROBOT_RUNNING, SAFETY_NORMAL,
    STOPPED,
};
use crate::stream::plan::StreamPlan;
use crate::stream::settings::StreamTiming;

/// The controller's period, s.
const TICK_S: f64 = 0.002;
/// The controller stops its program when no order came for this long, s.
const WATCHDOG_S: f64 = 0.1;
/// How long a controller takes to start again, s.
const RESTART_S: f64 = 0.6;

/// How long a slider stays where it was moved to, s.
const SLIDER_S: f64 = 0.4;

/// How the arm moves.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Motion {
    Following,
    /// Slowing from a velocity since a time, for so long.
    Slowing {
        from: Joints,
        velocity: Joints,
        since_s: f64,
        for_s: f64,
    },
    Resting,
}

/// The client that gives orders to the controller, like `control.py` of the Python package.
#[derive(Debug, Default)]
struct Client {
    orders: VecDeque<Order>,
    /// What an order takes it, s.
    takes_s: f64,
    busy_until_s: f64,
}

/// The world outside of the run's decisions.
#[derive(Debug)]
pub struct World {
    draws: SeededDraws,
    identity: Identity,
    timing: StreamTiming,
    now_s: f64,
    ticks: u64,
    pc_ahead_s: f64,
    controller: (f64, f64),
    motion: Motion,
    first: Joints,
    q: Joints,
    target: Joints,
    buffer: Option<Buffer>,
    running: bool,
    spindle_on: bool,
    safety_mode: i32,
    fraction: f64,
    last_order_s: f64,
    /// Slowing of each joint in a stop, rad/s² or mm/s².
    stops: Joints,
    transport_s: (f64, f64),
    client: Client,
    /// On their way to the controller, with when they arrive, s.
    orders: VecDeque<(f64, Order)>,
    states: VecDeque<(f64, ArmState)>,
    newest: Option<ArmState>,
    tool_pose: ([f64; 3], [f64; 3]),
    payload_kg: f64,
    fault: Fault,
    onset_s: f64,
    struck: bool,
    frozen: Option<ArmState>,
    link_fault: Option<(f64, LinkFault)>,
    /// The arm at every tick, s and rad, where it is wanted.
    trace: Option<Vec<(f64, Joints)>>,
}

impl World {
    /// The arm of a plan, at rest at `q`, which fails at `onset_s`.
    pub fn new(plan: &StreamPlan, q: Joints, (fault, onset_s): (Fault, f64), seed: u64) -> Self {
        let (arm, timing) = (&plan.arm, plan.settings().timing);
        let mut draws = SeededDraws::new(seed);
        let tool = arm.tool_at(&q);
        let turn = UnitQuaternion::from_rotation_matrix(&tool.rotation).scaled_axis();
        let skew = 1.0 + draws.between(-0.5, 0.5) * timing.clock_drift;
        let controller = (draws.between(0.0, 1e5), skew);
        // both ways together stay within what is assumed
        let least_s = draws.between(2e-4, 0.2 * timing.transport_s);
        let harder = draws.between(1.0, 4.0);
        let stops = timing.stops(arm).map(|a| a * harder);
        let serial = plan.settings().serial.clone().unwrap_or_else(|| "simulated".to_owned());
        Self {
            draws,
            identity: Identity { model: plan.model.clone(), serial, is_local: false },
            timing,
            now_s: 0.0,
            ticks: 0,
            pc_ahead_s: 0.0,
            controller,
            motion: Motion::Resting,
            first: q,
            q,
            target: q,
            buffer: None,
            running: false,
            spindle_on: false,
            safety_mode: SAFETY_NORMAL,
            fraction: 1.0,
            last_order_s: 0.0,
            stops,
            transport_s: (least_s, 0.4 * timing.transport_s),
            client: Client::default(),
            orders: VecDeque::new(),
            states: VecDeque::new(),
            newest: None,
            tool_pose: (tool.translation_mm.into(), turn.into()),
            payload_kg: plan.settings().payload_kg.unwrap_or_default(),
            fault,
            onset_s,
            struck: false,
            frozen: None,
            link_fault: None,
            trace: None,
        }
    }

    /// True time, s.
    pub fn now_s(&self) -> f64 {
        self.now_s
    }

    /// Where the arm is.
    pub fn q(&self) -> Joints {
        self.q
    }

    /// When the fault struck, once it has, in true time, s.
    pub fn struck_s(&self) -> Option<f64> {
        self.struck.then_some(self.onset_s)
    }

    /// When a state was made, in true time, s.
    pub fn made_s(&self, state: &ArmState) -> f64 {
        (state.controller_s - self.controller.0) / self.controller.1
    }

    /// The same world, which keeps where the arm was.
    #[must_use]
    pub fn traced(mut self) -> Self {
        self.trace = Some(Vec::with_capacity(512));
        self
    }

    /// The same world, whose controller follows a buffer of targets.
    #[must_use]
    pub fn buffered(mut self, buffer: Option<Buffer>) -> Self {
        self.buffer = buffer;
        self
    }

    /// The arm at every tick so far, s and rad; empty unless it is kept.
    pub fn trace(&self) -> &[(f64, Joints)] {
        self.trace.as_deref().unwrap_or(&[])
    }

    /// Goes on to a time.
    pub fn advance(&mut self, to_s: f64) {
        while (self.ticks + 1) as f64 * TICK_S <= to_s {
            self.ticks += 1;
            self.now_s = self.ticks as f64 * TICK_S;
            self.tick();
        }
        self.now_s = self.now_s.max(to_s);
    }

    fn tick(&mut self) {
        if !self.struck && self.now_s >= self.onset_s {
            self.struck = true;
            self.strike();
        }
        if self.struck && self.fault == Fault::Restarted && self.now_s >= self.onset_s + RESTART_S {
            self.controller.0 = -self.now_s * self.controller.1;
        }
        if self.struck && self.now_s >= self.onset_s + SLIDER_S {
            self.fraction = 1.0;
        }
        self.hand_on();
        while self.orders.front().is_some_and(|(at_s, _)| *at_s <= self.now_s) {
            if let Some((_, order)) = self.orders.pop_front() {
                self.obey(order);
            }
        }
        // with a buffer a run ends when none is left, not when none comes
        let ends = match &self.buffer {
            Some(buffer) => buffer.ran_out(),
            None => self.now_s - self.last_order_s > WATCHDOG_S,
        };
        if self.running && ends {
            self.halt();
        }
        self.move_joints();
        if let Some(trace) = &mut self.trace {
            trace.push((self.now_s, self.q));
        }
        self.report();
    }

    fn strike(&mut self) {
        match self.fault {
            Fault::ReceiveCut | Fault::ControlCut | Fault::BothCut => {
                // a client may notice at once, late, or never
                let notices_s = self.now_s + self.draws.between(0.001, 0.3);
                self.link_fault = Some((notices_s, LinkFault::Closed("connection reset".to_owned())));
            }
            Fault::Frozen => self.frozen = self.newest,
            Fault::Dead | Fault::Restarted | Fault::PendantStop => self.halt(),
            Fault::SafetyStop(mode) => {
                self.safety_mode = mode;
                self.halt();
            }
            Fault::Slider(fraction) => self.fraction = fraction,
            Fault::SpindleDrops => self.spindle_on = false,
            Fault::ClockJump(by_s) => self.pc_ahead_s += by_s,
            Fault::Held(for_s) => self.client.busy_until_s = self.now_s + for_s,
            Fault::Slow(takes_s) => self.client.takes_s = takes_s,
            _ => {}
        }
    }

    /// The program ends and the arm slows down.
    fn halt(&mut self) {
        self.running = false;
        self.slow();
    }

    fn slow(&mut self) {
        if self.motion != Motion::Following {
            return;
        }
        let velocity: Joints = std::array::from_fn(|j| self.speed() * (self.first[j] - self.q[j]));
        let for_s = velocity.iter().zip(&self.stops).fold(0.0f64, |longest, (v, a)| longest.max(v.abs() / a));
        self.motion = Motion::Slowing { from: self.q, velocity, since_s: self.now_s, for_s };
    }

    /// Rate of the last lag, 1/s.
    fn speed(&self) -> f64 {
        self.fraction / self.timing.follow_s
    }

    fn obey(&mut self, order: Order) {
        self.last_order_s = self.now_s;
        match order {
            Order::Start if self.safety_mode == SAFETY_NORMAL => {
                self.running = true;
                (self.first, self.target) = (self.q, self.q);
                self.motion = Motion::Following;
                if let Some(buffer) = &mut self.buffer {
                    buffer.start(self.q);
                }
            }
            Order::Target(q) if self.running && self.motion == Motion::Following => match &mut self.buffer {
                Some(buffer) => buffer.push(q),
                None => self.target = q,
            },
            Order::Stop => match &mut self.buffer {
                Some(buffer) => buffer.stop(),
                None => self.slow(),
            },
            Order::End => self.halt(),
            Order::Spindle(_) if self.fault == Fault::SpindleStays => {}
            Order::Spindle(on) => self.spindle_on = on,
            _ => {}
        }
    }

    fn move_joints(&mut self) {
        match self.motion {
            Motion::Resting => {}
            Motion::Slowing { from, velocity, since_s, for_s } => {
                let t = (self.now_s - since_s).min(for_s);
                let share = if for_s > 0.0 { t - t * t / (2.0 * for_s) } else { 0.0 };
                self.q = std::array::from_fn(|j| from[j] + velocity[j] * share);
                if t >= for_s {
                    self.motion = Motion::Resting;
                }
            }
            Motion::Following => {
                if let Some(target) =
                    self.buffer.as_mut().and_then(|buffer| buffer.target(TICK_S, self.fraction))
                {
                    self.target = target;
                }
                if matches!(self.fault, Fault::Ignores(for_s) if self.struck && self.now_s < self.onset_s + for_s)
                {
                    return;
                }
                let offset = if let Fault::Offset(rad) = self.fault { rad } else { 0.0 };
                let share = 1.0 - (-TICK_S * self.speed()).exp();
                for j in 0..6 {
                    self.first[j] += share * (self.target[j] + offset - self.first[j]);
                    self.q[j] += share * (self.first[j] - self.q[j]);
                }
            }
        }
    }

    fn way_s(&mut self) -> f64 {
        let (least_s, more_s) = self.transport_s;
        let usual_s = least_s + self.draws.between(0.0, more_s - least_s);
        match self.fault {
            Fault::Delay(by_s) if self.struck => usual_s + by_s,
            Fault::Jitter(by_s) if self.struck => usual_s + self.draws.between(0.0, by_s),
            _ => usual_s,
        }
    }

    /// The client gives its orders to the network, one after the other; of targets that wait, the newest alone.
    fn hand_on(&mut self) {
        while self.now_s >= self.client.busy_until_s
            && let Some(order) = self.client.orders.pop_front()
        {
            let is_target = |order: &Order| matches!(order, Order::Target(_));
            if is_target(&order) && self.client.orders.front().is_some_and(is_target) {
                continue;
            }
            self.client.busy_until_s = self.now_s + self.client.takes_s;
            let arrives_s = self.now_s + self.way_s();
            let arrives_s = self.orders.back().map_or(arrives_s, |(before_s, _)| arrives_s.max(*before_s));
            self.orders.push_back((arrives_s, order));
            if self.struck && self.fault == Fault::Duplicated {
                self.orders.push_back((arrives_s + 0.001, order));
            }
        }
    }

    /// Whether states still come, and orders still arrive.
    fn open(&self) -> (bool, bool) {
        if !self.struck {
            return (true, true);
        }
        match self.fault {
            Fault::ReceiveCut => (false, true),
            Fault::ControlCut => (true, false),
            Fault::BothCut | Fault::HalfOpen | Fault::Killed => (false, false),
            Fault::Dead => (false, false),
            Fault::Restarted => (self.now_s >= self.onset_s + RESTART_S, false),
            _ => (true, true),
        }
    }

    fn report(&mut self) {
        if !self.open().0 {
            return;
        }
        let controller_s = self.controller.0 + self.controller.1 * self.now_s;
        let state = self.frozen.unwrap_or(ArmState {
            received_s: 0.0,
            controller_s,
            q: self.q,
            tool_pose: self.tool_pose,
            force_n: None,
            safety_mode: self.safety_mode,
            robot_mode: ROBOT_RUNNING,
            freedrive: false,
            spindle_on: self.spindle_on,
            runtime_state: if self.running { PLAYING } else { STOPPED },
            speed_fraction: self.fraction,
            payload_kg: self.payload_kg,
        });
        let mut arrives_s = self.now_s + self.way_s();
        if let Fault::StatesHeld(for_s) = self.fault
            && self.struck
        {
            arrives_s = arrives_s.max(self.onset_s + for_s);
        }
        if self.struck && self.fault == Fault::Reordered {
            arrives_s += self.draws.between(0.0, 0.008);
        } else if let Some((before_s, _)) = self.states.back() {
            // a connection keeps the order
            arrives_s = arrives_s.max(*before_s);
        }
        self.states.push_back((arrives_s, state));
        if self.struck && self.fault == Fault::Duplicated {
            self.states.push_back((arrives_s + 0.001, state));
        }
    }

    fn receive(&mut self) {
        let now_s = self.now_s;
        let mut k = 0;
        while k < self.states.len() {
            if self.states[k].0 > now_s {
                k += 1;
                continue;
            }
            if let Some((at_s, mut state)) = self.states.remove(k) {
                state.received_s = at_s + self.pc_ahead_s;
                self.newest = Some(state);
            }
        }
    }
}

/// A handle on a world: its link.
#[derive(Debug, Clone)]
pub struct WorldLink(pub Rc<RefCell<World>>);

impl ArmLink for WorldLink {
    fn state(&mut self) -> Option<ArmState> {
        let mut world = self.0.borrow_mut();
        world.receive();
        world.newest
    }

    fn fault(&mut self) -> Option<LinkFault> {
        let world = self.0.borrow();
        let (from_s, fault) = world.link_fault.as_ref()?;
        (world.now_s >= *from_s).then(|| fault.clone())
    }

    fn order(&mut self, order: &Order) {
        let mut world = self.0.borrow_mut();
        if !world.open().1 {
            return;
        }
        world.client.orders.push_back(*order);
        world.hand_on();
    }

    fn identity(&self) -> Option<Identity> {
        Some(self.0.borrow().identity.clone())
    }

    fn waiting(&self) -> usize {
        let world = self.0.borrow();
        world.client.orders.len() + usize::from(world.now_s < world.client.busy_until_s)
    }
}

/// A handle on a world: the PC's clock in it.
#[derive(Debug, Clone)]
pub struct WorldClock(pub Rc<RefCell<World>>);

impl Clock for WorldClock {
    fn now_s(&mut self) -> f64 {
        let world = self.0.borrow();
        world.now_s + world.pc_ahead_s
    }

    fn sleep_until_s(&mut self, wake_s: f64) {
        let mut world = self.0.borrow_mut();
        let late_s = world.draws.between(0.0, 3e-4);
        let mut to_s = (wake_s - world.pc_ahead_s).max(world.now_s) + late_s;
        if let Fault::Stall(for_s) = world.fault {
            let onset_s = world.onset_s;
            if world.now_s <= onset_s && to_s >= onset_s {
                to_s += for_s;
            }
        }
        world.advance(to_s);
    }
}
