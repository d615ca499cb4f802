//! An arm that is where it was told to be, and a user who answers as told.

use bonemill_robot::stream::{
    ArmLink, ArmState, Cause, Clock, Event, Identity, Joints, LinkFault, LogWriter, Operator, Order, PLAYING,
    Question, ROBOT_RUNNING, RunEnd, SAFETY_NORMAL, STOPPED, Session, StreamPlan, drive,
};
use nalgebra::{UnitQuaternion, Vector3};

/// Answers as told, and remembers what it heard.
#[derive(Default)]
pub struct User {
    pub says: Vec<bool>,
    pub asked: usize,
    pub heard: Vec<String>,
    pub pending: bool,
}

impl User {
    pub fn who_says(says: &[bool]) -> Self {
        Self { says: says.to_vec(), ..Self::default() }
    }
}

impl Operator for User {
    fn tell(&mut self, event: &Event) {
        self.heard.push(event.to_string());
    }

    fn ask(&mut self, question: &Question) {
        self.heard.push(question.to_string());
        self.pending = true;
    }

    fn answer(&mut self) -> Option<bool> {
        if !std::mem::take(&mut self.pending) {
            return None;
        }
        self.asked += 1;
        Some(self.says.get(self.asked - 1).copied().unwrap_or(true))
    }

    fn stop(&mut self) -> Option<Cause> {
        None
    }
}

/// An arm that is where it was told to be, with a clock of its own; it keeps every order.
pub struct Obedient {
    pub now_s: f64,
    pub state: ArmState,
    pub orders: Vec<(f64, Order)>,
    /// Rows after which the loop is held up for so many s, once.
    pub stall: Option<(usize, f64)>,
    /// What its sensor says after so many orders.
    pub force_n: fn(usize) -> Option<Vector3<f64>>,
    /// From so many orders on, its client takes no more.
    pub deaf_after: usize,
    /// What else changes in its state, by the time, s.
    pub changes: fn(&mut ArmState, f64),
    pub is_local: bool,
}

impl Obedient {
    pub fn at(plan: &StreamPlan, q: Joints) -> Self {
        let tool = plan.arm.tool_at(&q);
        let turn = UnitQuaternion::from_rotation_matrix(&tool.rotation).scaled_axis();
        let state = ArmState {
            received_s: 0.0,
            controller_s: 50.0,
            q,
            tool_pose: (tool.translation_mm.into(), turn.into()),
            force_n: None,
            safety_mode: SAFETY_NORMAL,
            robot_mode: ROBOT_RUNNING,
            freedrive: false,
            spindle_on: false,
            runtime_state: STOPPED,
            speed_fraction: 1.0,
            payload_kg: 1.0,
        };
        Self {
            now_s: 0.0,
            state,
            orders: vec![],
            stall: None,
            force_n: |_| None,
            deaf_after: usize::MAX,
            changes: |_, _| (),
            is_local: false,
        }
    }

    pub fn targets(&self) -> Vec<Joints> {
        let target = |(_, order): &(f64, Order)| match order {
            Order::Target(q) => Some(*q),
            _ => None,
        };
        self.orders.iter().filter_map(target).collect()
    }

    pub fn run(&mut self, plan: &StreamPlan, user: &mut User) -> RunEnd {
        let mut session = Session::new(plan, 0.0, 0.0);
        let shared = std::cell::RefCell::new(self);
        drive(&mut session, &mut End(&shared), &mut End(&shared), user, None::<&mut LogWriter<Vec<u8>>>)
    }
}

/// Both ends of an obedient arm.
pub struct End<'a, 'b>(&'a std::cell::RefCell<&'b mut Obedient>);

impl ArmLink for End<'_, '_> {
    fn state(&mut self) -> Option<ArmState> {
        let mut arm = self.0.borrow_mut();
        let (now_s, sent) = (arm.now_s, arm.orders.len());
        let force_n = (arm.force_n)(sent);
        arm.state = ArmState { received_s: now_s, controller_s: 50.0 + now_s, force_n, ..arm.state };
        let (mut said, change) = (arm.state, arm.changes);
        change(&mut said, now_s);
        Some(said)
    }

    fn fault(&mut self) -> Option<LinkFault> {
        None
    }

    fn order(&mut self, order: &Order) {
        let mut arm = self.0.borrow_mut();
        let now_s = arm.now_s;
        arm.orders.push((now_s, *order));
        match order {
            Order::Start => arm.state.runtime_state = PLAYING,
            Order::Target(q) => arm.state.q = *q,
            Order::Spindle(on) if arm.orders.len() <= arm.deaf_after => arm.state.spindle_on = *on,
            _ => {}
        }
    }

    fn identity(&self) -> Option<Identity> {
        Some(Identity { model: "UR5".into(), serial: "1".into(), is_local: self.0.borrow().is_local })
    }

    fn waiting(&self) -> usize {
        let arm = self.0.borrow();
        arm.orders.len().saturating_sub(arm.deaf_after)
    }
}

impl Clock for End<'_, '_> {
    fn now_s(&mut self) -> f64 {
        self.0.borrow().now_s
    }

    fn sleep_until_s(&mut self, wake_s: f64) {
        let mut arm = self.0.borrow_mut();
        let sent = arm.orders.len();
        arm.now_s = wake_s.max(arm.now_s);
        if let Some((_, for_s)) = arm.stall.filter(|(after, _)| sent == *after) {
            arm.now_s += for_s;
            arm.stall = None;
        }
    }
}
