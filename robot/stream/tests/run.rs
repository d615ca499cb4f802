//! A run without and with what users do: every row, hold points, too much force, refusals before the start, the log and going on from it.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod common;

use bonemill_arm::Arm;
use bonemill_stream::approach::Approach;
use bonemill_stream::simulated::rehearse::rehearse;
use bonemill_stream::{
    ArmLink, ArmState, Cause, Clock, Event, Hold, Identity, Joints, LinkFault, Log, LogWriter, Operator,
    Order, Outcome, PLAYING, Question, ROBOT_RUNNING, SAFETY_NORMAL, STOPPED, Session, Settings, SpindleEnd,
    Standing, StreamError, StreamPlan, Timing, drive,
};
use common::{PERIOD_S, settings, values};
use nalgebra::{UnitQuaternion, Vector3};

/// Answers as told, and remembers what it heard.
#[derive(Default)]
struct User {
    says: Vec<bool>,
    asked: usize,
    heard: Vec<String>,
    pending: bool,
}

impl User {
    fn who_says(says: &[bool]) -> Self {
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
struct Obedient {
    now_s: f64,
    state: ArmState,
    orders: Vec<(f64, Order)>,
    /// Rows after which the loop is held up for so many s, once.
    stall: Option<(usize, f64)>,
    /// What its sensor says after so many orders.
    force_n: fn(usize) -> Option<Vector3<f64>>,
    /// From so many orders on, its client takes no more.
    deaf_after: usize,
    /// What else changes in its state, by the time, s.
    changes: fn(&mut ArmState, f64),
    is_local: bool,
}

impl Obedient {
    fn at(plan: &StreamPlan, q: Joints) -> Self {
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

    fn targets(&self) -> Vec<Joints> {
        let target = |(_, order): &(f64, Order)| match order {
            Order::Target(q) => Some(*q),
            _ => None,
        };
        self.orders.iter().filter_map(target).collect()
    }

    fn run(&mut self, plan: &StreamPlan, user: &mut User) -> Outcome {
        let mut session = Session::new(plan, 0.0, 0.0);
        let shared = std::cell::RefCell::new(self);
        drive(&mut session, &mut End(&shared), &mut End(&shared), user, None::<&mut LogWriter<Vec<u8>>>)
    }
}

/// Both ends of an obedient arm.
struct End<'a, 'b>(&'a std::cell::RefCell<&'b mut Obedient>);

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

fn plan() -> StreamPlan {
    values(1.0, 3.0, 8.0).plan(settings())
}

#[test]
fn every_row_is_sent_in_order_and_unchanged() {
    let plan = plan();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    let outcome = arm.run(&plan, &mut User::default());
    assert_eq!((outcome.cause, outcome.at_rest), (None, true));
    let targets = arm.targets();
    let first = targets.iter().rposition(|q| q == &plan.track.q()[0]).unwrap();
    assert_eq!(&targets[first..first + plan.track.rows()], plan.track.q());
    let last: Vec<&Order> = arm.orders.iter().rev().take(3).map(|(_, order)| order).collect();
    assert_eq!(last, [&Order::End, &Order::Spindle(false), &Order::Stop]);
    let at = |wanted: Order| arm.orders.iter().position(|(_, order)| *order == wanted).unwrap();
    assert!(
        at(Order::Start) < at(Order::Spindle(true)) && at(Order::Spindle(true)) < at(Order::Spindle(false))
    );
}

#[test]
fn what_was_missed_is_never_sent_at_once() {
    let plan = plan();
    for stall_s in [0.02, 0.095, 0.25] {
        let mut arm = Obedient::at(&plan, plan.track.q()[0]);
        arm.stall = Some((400, stall_s));
        let outcome = arm.run(&plan, &mut User::default());
        assert_eq!(outcome.cause, None, "{stall_s}");
        let sent = arm.orders.iter().filter_map(|(at_s, order)| match order {
            Order::Target(q) => Some((*at_s, *q)),
            _ => None,
        });
        let sent: Vec<(f64, Joints)> = sent.collect();
        for pair in sent.windows(2) {
            let ((t0, a), (t1, b)) = (&pair[0], &pair[1]);
            assert!(t1 - t0 >= 0.5 * PERIOD_S - 1e-9);
            let most = a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let stop_s = plan.track.fastest(0..=plan.track.rows(), PERIOD_S).stop_s;
            let fastest = stop_s * plan.settings().timing.stop_rad_s2 * PERIOD_S;
            assert!(most <= fastest * 1.001, "{stall_s}: a step of {most} rad, the plan's are {fastest}");
        }
    }
}

#[test]
fn orders_do_not_pile_up_before_a_client_that_takes_none() {
    let plan = plan();
    // the start is never answered, though the controller says that the program runs: nothing is known of its watchdog
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    arm.deaf_after = 0;
    let outcome = arm.run(&plan, &mut User::default());
    assert!(matches!(outcome.cause, Some(Cause::NoAnswer { .. })), "{:?}", outcome.cause);
    assert!(arm.targets().is_empty() && arm.now_s < 2.0 * plan.settings().patience_s);

    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    arm.deaf_after = 400;
    let outcome = arm.run(&plan, &mut User::default());
    let expected = Cause::Link(LinkFault::NotTaken("its orders in time"));
    assert_eq!((&outcome.cause, outcome.spindle), (&Some(expected), SpindleEnd::On));
    assert!(outcome.to_string().contains("output is seen ON: it turns"), "{outcome}");
    let after: Vec<_> = arm.orders[400..].iter().map(|(_, order)| *order).collect();
    assert!(
        matches!(after[..], [.., Order::Target(_), Order::Stop, Order::Spindle(false), Order::End]),
        "{after:?}"
    );
    assert!(after.len() <= 7, "{} orders wait", after.len());
}

#[test]
fn an_arm_that_another_program_moves_is_left_alone() {
    let plan = plan();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    arm.state.runtime_state = PLAYING;
    let outcome = arm.run(&plan, &mut User::default());
    assert!(outcome.to_string().contains("a program already runs on the controller"), "{outcome}");
    assert!(arm.orders.iter().all(|(_, order)| *order == Order::End), "{:?}", arm.orders);
}

#[test]
fn a_hold_at_the_first_row_waits_there() {
    let mut values = values(2.0, 3.0, 8.0);
    values.holds = vec![Hold { row: 0, why: "2 mm from nerve".into() }];
    let plan = values.plan(settings());
    let mut user = User::who_says(&[true, false]);
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    let outcome = arm.run(&plan, &mut user);
    assert_eq!((outcome.cause, outcome.reached_row), (Some(Cause::Declined), 0.0));
}

#[test]
fn a_hold_goes_back_along_the_path_waits_and_goes_on() {
    let mut values = values(2.0, 3.0, 8.0);
    values.holds = vec![Hold { row: 600, why: "2 mm from nerve".into() }];
    let plan = values.plan(settings());
    let mut user = User::default();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    let outcome = arm.run(&plan, &mut user);
    assert_eq!((outcome.cause, user.asked), (None, 2));
    assert!(user.heard.contains(&"hold: 2 mm from nerve".to_owned()), "{:?}", user.heard);
    let off = arm.orders.iter().position(|(_, order)| *order == Order::Spindle(false)).unwrap();
    let row = |n: usize| match arm.orders[n].1 {
        Order::Target(q) => plan.track.nearest(0.0, 700.0, &plan.arm.tool_at(&q).translation_mm).row,
        _ => f64::NAN,
    };
    let waits = row(off - 1);
    let back_mm = plan.track.way_mm(waits, 600.0);
    assert!((1.9..2.6).contains(&back_mm), "waits {back_mm} mm before the hold");
    let farthest = (0..off).map(row).filter(|row| row.is_finite()).fold(0.0, f64::max);
    assert!(farthest <= 601.0, "passed the hold: {farthest}");

    let mut user = User::who_says(&[true, false]);
    let outcome = Obedient::at(&plan, plan.track.q()[0]).run(&plan, &mut user);
    assert_eq!(outcome.cause, Some(Cause::Declined));
}

#[test]
fn more_force_toward_a_structure_than_predicted_holds() {
    let plan = plan();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    // 3 N of the sensor's own from the start, 8 N more for a while
    arm.force_n = |sent| Some(Vector3::new(if (300..340).contains(&sent) { 11.0 } else { 3.0 }, 0.0, 0.0));
    let mut user = User::default();
    assert_eq!(arm.run(&plan, &mut user).cause, None);
    let held = user.heard.iter().any(|said| said.starts_with("hold: 8.0 N toward nerve, predicted 0.5 N"));
    assert!(held, "{:?}", user.heard);
    arm = Obedient::at(&plan, plan.track.q()[0]);
    arm.force_n = |_| Some(Vector3::new(3.0, 0.0, 0.0));
    let mut user = User::default();
    arm.run(&plan, &mut user);
    assert!(!user.heard.iter().any(|said| said.starts_with("hold")), "the sensor's zero is no force");
}

#[test]
fn a_force_sensor_that_falls_silent_stops_the_arm_along_its_path() {
    let plan = plan();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    arm.force_n = |sent| (sent < 300).then(|| Vector3::new(3.0, 0.0, 0.0));
    let outcome = arm.run(&plan, &mut User::default());
    assert_eq!(outcome.cause, Some(Cause::SensorLost));
    assert!(
        outcome.at_rest && outcome.spindle == SpindleEnd::Off && outcome.farthest_off_mm < 0.01,
        "{outcome}"
    );
    let targets = arm.targets().len();
    assert!((300..500).contains(&targets), "slowed down over targets, not stopped between two: {targets}");
}

#[test]
fn the_way_begins_where_the_arm_is_and_not_where_the_user_was_asked() {
    let plan = plan();
    let mut from = plan.track.q()[0];
    from[1] -= 5e-3;
    let asked = Approach::new(&plan, &from, 0.0).unwrap();
    let now = from.map(|q| q + 1e-4);
    let begun = asked.clone().begun_at(&plan, &now);
    let (before, after) = (asked.track.q(), begun.track.q());
    assert!(after.len() > 10 && after.len() == before.len());
    assert_eq!((after[0], after[after.len() - 1]), (now, plan.track.q()[0]));
    for (n, pair) in after.windows(2).enumerate() {
        for joint in 0..6 {
            let (step, planned) = (pair[1][joint] - pair[0][joint], before[n + 1][joint] - before[n][joint]);
            assert!((step - planned).abs() <= 1.001e-4 / (after.len() - 1) as f64, "row {n}, joint {joint}");
        }
    }
    assert_eq!(begun.track.burr_at(0.0), plan.arm.tool_at(&now).translation_mm);
}

#[test]
fn an_arm_that_is_not_ready_is_not_moved() {
    let plan = plan();
    type Change = (fn(&mut ArmState), &'static str);
    let changes: [Change; 11] = [
        (|s| s.runtime_state = 4, "a program is paused on the controller"),
        (|s| s.robot_mode = 3, "robot mode is 3 (power off): expected 7"),
        (|s| s.robot_mode = 5, "brakes are closed"),
        (|s| s.freedrive = true, "freedrive"),
        (|s| s.spindle_on = true, "the spindle's output is on"),
        (|s| s.safety_mode = 3, "protective stop"),
        (|s| s.speed_fraction = 0.5, "slider is at 50 %"),
        (|s| s.payload_kg = 0.0, "0.00 kg on its flange, expected 1.00 kg"),
        (|s| s.tool_pose.0[2] += 1.5, "1.50 mm"),
        (|s| s.tool_pose.1[0] += 0.05, "mrad apart"),
        (|s| s.q[0] = f64::NAN, "joints"),
    ];
    for (change, says) in changes {
        let mut arm = Obedient::at(&plan, plan.track.q()[0]);
        change(&mut arm.state);
        let outcome = arm.run(&plan, &mut User::default());
        let said = outcome.cause.unwrap().to_string();
        assert!(said.contains(says), "{said}");
        assert_eq!(arm.orders.iter().map(|(_, o)| *o).collect::<Vec<_>>(), [Order::End], "{says}");
    }
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    assert_eq!(arm.run(&plan, &mut User::who_says(&[false])).cause, Some(Cause::Declined));
    assert!(arm.targets().is_empty());
}

#[test]
fn a_plan_that_is_not_verified_needs_the_user_to_say_so() {
    let mut values = values(0.5, 2.0, 8.0);
    values.standing = Standing::Unverified("trajectory.csv was changed".into());
    let plan = values.plan(settings());
    let said = Obedient::at(&plan, plan.track.q()[0]).run(&plan, &mut User::default()).cause.unwrap();
    assert!(said.to_string().contains("trajectory.csv was changed"), "{said}");
    let plan = values.plan(Settings { unverified: true, ..settings() });
    assert_eq!(Obedient::at(&plan, plan.track.q()[0]).run(&plan, &mut User::default()).cause, None);
}

#[test]
fn a_plan_too_fast_for_its_clearance_is_slowed_or_refused() {
    let values = values(2.0, 12.0, 0.5);
    let plan = values.plan(Settings { slow: false, ..settings() });
    let said = Obedient::at(&plan, plan.track.q()[0]).run(&plan, &mut User::default()).cause.unwrap();
    assert!(said.to_string().contains("--slow"), "{said}");
    let plan = values.plan(settings());
    let outcome = Obedient::at(&plan, plan.track.q()[0]).run(&plan, &mut User::default());
    assert_eq!(outcome.cause, None);
    assert!(outcome.seconds > 2.5, "{}", outcome.seconds);
    for row in (0..plan.track.rows()).step_by(10) {
        let travel = plan.travel(row);
        assert!(travel.off_mm <= plan.gap_mm[row] + 1e-9, "row {row}: {travel:?}, {} mm", plan.gap_mm[row]);
        assert!(plan.tolerance_mm(row) <= 0.25 * plan.gap_mm[row]);
    }
}

#[test]
fn plans_that_no_ur_arm_can_follow_are_refused() {
    let refused = |change: &dyn Fn(&mut common::Values)| {
        let mut changed = values(0.4, 2.0, 8.0);
        change(&mut changed);
        StreamPlan::new(changed.input(), settings()).unwrap_err()
    };
    assert!(matches!(refused(&|v| v.registration_assumed = true), StreamError::RegistrationAssumed));
    assert!(matches!(refused(&|v| v.time_s[7] += 1e-4), StreamError::Uneven { row: 7, .. }));
    assert!(matches!(refused(&|v| v.q[6 * 50 + 1] += 0.02), StreamError::TooFast { row: 50, .. }));
    assert!(matches!(refused(&|v| v.q[6 * 50] = f64::NAN), StreamError::BeyondLimit { row: 50, .. }));
    assert!(matches!(refused(&|v| v.waypoints[3].time_s = 0.0), StreamError::Waypoint { waypoint: 3, .. }));
    let wrong = Settings { tolerance_mm: f64::NAN, ..settings() };
    let found = StreamPlan::new(values(0.4, 2.0, 8.0).input(), wrong);
    assert!(matches!(found, Err(StreamError::Setting { name: "tolerance_mm", .. })));
}

#[test]
fn a_rehearsal_writes_a_log_that_survives_a_kill_and_says_where_to_go_on() {
    let plan = plan();
    let mut bytes = Vec::new();
    let mut log = LogWriter::new(&mut bytes, "d1", plan.track.rows(), plan.period_s).unwrap();
    let outcome = rehearse(&plan, 0.0, 3, &mut User::default(), Some(&mut log));
    assert_eq!(outcome.cause, None);
    assert!(outcome.farthest_off_mm < 0.05, "{outcome:?}");
    let text = String::from_utf8(bytes).unwrap();
    let read = Log::read(&text).unwrap().of_plan("d1").unwrap();
    assert_eq!(
        (read.rows, read.period_s, read.last_row().unwrap()),
        (plan.track.rows(), plan.period_s, plan.track.last_row())
    );
    assert!(read.events.iter().any(|(_, said)| said.starts_with("ended: done")));
    // rows are of every fifth step, the farthest of all
    let farthest_mm = read.farthest_off_mm().unwrap();
    assert!((farthest_mm - outcome.farthest_off_mm).abs() <= 5e-6, "{farthest_mm} mm, {outcome:?}");
    assert!(read.clone().of_plan("d2").is_err());
    // killed at any byte: all whole lines are there
    let head = text.find('\n').unwrap();
    for cut in (head + 1..text.len()).step_by(997) {
        let part = Log::read(&text[..cut]).unwrap();
        assert!(part.steps.len() <= read.steps.len() && part.steps[..] == read.steps[..part.steps.len()]);
    }
    // damage in the middle is told with its line
    let at = text.len() / 2;
    let damaged = format!("{}#{}", &text[..at], &text[at + 1..]);
    assert!(matches!(Log::read(&damaged), Err(StreamError::Log { line, .. }) if line > 3));
    let middle = read.steps[read.steps.len() / 2].reached_row;
    let row = plan.resume_row(middle);
    assert!(row <= middle && plan.track.way_mm(row, middle) <= 0.6);
    assert_eq!(rehearse(&plan, row, 4, &mut User::default(), None::<&mut LogWriter<Vec<u8>>>).cause, None);
}

#[test]
fn an_arm_that_slides_is_rehearsed_within_its_bound_and_not_streamed_to() {
    let mut values = values(3.0, 2.0, 3.0);
    values.arm = Arm::bone_attached().unwrap();
    let last = (values.time_s.len() - 1) as f64;
    let place = |n: usize| {
        let share = n as f64 / last;
        // once round, at rest in the beginning and in the end
        let angle = std::f64::consts::TAU * share * share * (3.0 - 2.0 * share);
        [3.0 * angle.sin(), 3.0 * (1.0 - angle.cos()), 0.5 * angle.sin(), 0.2 * (1.0 - angle.cos())]
    };
    values.q = (0..values.time_s.len()).flat_map(place).collect();
    let plan = values.plan(settings());
    let mut log = LogWriter::new(Vec::new(), "d1", plan.track.rows(), plan.period_s).unwrap();
    let outcome = rehearse(&plan, 0.0, 5, &mut User::default(), Some(&mut log));
    assert_eq!(outcome.cause, None);
    let most_mm = plan.off_mm.iter().copied().fold(0.0, f64::max);
    assert!(
        outcome.farthest_off_mm > 1e-3 && outcome.farthest_off_mm < most_mm,
        "{outcome:?}, bound {most_mm} mm"
    );
    let refused = plan.for_a_ur().unwrap_err().to_string();
    assert!(refused.contains("prismatic, prismatic, prismatic, revolute"), "{refused}");
}

#[test]
fn what_no_longer_holds_when_the_user_says_yes_starts_nothing() {
    let plan = plan();
    type Change = (fn(&mut ArmState), &'static str);
    let changes: [Change; 5] = [
        (|s| s.runtime_state = PLAYING, "a program already runs"),
        (|s| s.payload_kg = 2.0, "2.00 kg on its flange, expected 1.00 kg"),
        (|s| s.tool_pose.0[2] += 1.5, "Set the tool centre point"),
        (|s| s.robot_mode = 3, "power off"),
        (|s| s.spindle_on = true, "the spindle's output is on"),
    ];
    for (change, says) in changes {
        let mut arm = Obedient::at(&plan, plan.track.q()[0]);
        let mut session = Session::new(&plan, 0.0, 0.0);
        let mut orders = Vec::new();
        let outcome = (0..2000).find_map(|n| {
            let now_s = f64::from(n) * PERIOD_S;
            arm.state.received_s = now_s;
            arm.state.controller_s = 50.0 + now_s;
            if n == 1000 {
                change(&mut arm.state);
            }
            let identity = Some(Identity { model: "UR5".into(), serial: "1".into(), is_local: false });
            // the answer comes a second after the question, and after the change
            let answer = (n == 1001).then_some(true);
            let state = Some(arm.state);
            let step =
                session.step(&bonemill_stream::Seen { now_s, state, identity, answer, ..Default::default() });
            orders.extend(step.order);
            step.outcome
        });
        let said = outcome.unwrap().to_string();
        assert!(said.contains(says), "{said}");
        assert_eq!(orders, [Order::End], "{says}");
    }
}

#[test]
fn a_controller_in_local_control_or_at_another_rate_is_told_in_its_own_words() {
    let plan = plan();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    arm.is_local = true;
    let said = arm.run(&plan, &mut User::default()).to_string();
    assert!(said.contains("local control"), "{said}");
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    // a new state every 8 ms
    arm.changes = |state, now_s| state.controller_s = 50.0 + (now_s / 0.008).floor() * 0.008;
    let said = arm.run(&plan, &mut User::default()).to_string();
    assert!(said.contains("every 8.0 ms (125 Hz)") && said.contains("robot.rate_hz = 125"), "{said}");
    assert!(arm.targets().is_empty());
}

#[test]
fn nothing_is_fed_before_the_spindle_is_seen_on_nor_after_it_is_seen_off() {
    let plan = plan();
    let run = |changes: fn(&mut ArmState, f64)| {
        let mut arm = Obedient::at(&plan, plan.track.q()[0]);
        arm.changes = changes;
        let outcome = arm.run(&plan, &mut User::default());
        (outcome, arm)
    };
    // it does not switch
    let (outcome, arm) = run(|state, _| state.spindle_on = false);
    assert!(outcome.to_string().contains("was switched on and is not seen on"), "{outcome}");
    assert_eq!((outcome.spindle, outcome.targets), (SpindleEnd::Off, 0));
    let first = plan.track.q()[0];
    assert!(arm.targets().iter().all(|q| *q == first), "no row was sent");
    // it goes off by itself
    let (outcome, _) = run(|state, now_s| state.spindle_on &= now_s < 1.0);
    assert!(outcome.to_string().contains("went off, not by this program"), "{outcome}");
    assert!(outcome.targets > 100 && outcome.seconds < 1.0, "{outcome:?}");
    // it switches late: the run-up counts from then
    let (outcome, arm) = run(|state, now_s| state.spindle_on &= now_s > 0.5);
    assert_eq!(outcome.cause, None);
    let fed = arm.orders.iter().find(|(_, order)| matches!(order, Order::Target(q) if *q != first)).unwrap();
    assert!(fed.0 >= 0.5 + plan.settings().run_up_s, "fed at {} s", fed.0);
    // it stays on
    let (outcome, _) = run(|state, now_s| state.spindle_on |= now_s > 1.5);
    assert_eq!((outcome.cause.is_none(), outcome.spindle), (true, SpindleEnd::On), "{outcome}");
}

#[test]
fn a_spindle_that_was_never_on_is_not_said_to_turn_and_one_that_nobody_sees_is() {
    let plan = plan();
    let said = Obedient::at(&plan, plan.track.q()[0]).run(&plan, &mut User::who_says(&[false])).to_string();
    assert!(!said.contains("spindle"), "{said}");
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    // no new state after a while
    arm.changes = |state, now_s| state.controller_s = 50.0 + now_s.min(1.0);
    let outcome = arm.run(&plan, &mut User::default());
    assert!(matches!(outcome.spindle, SpindleEnd::Unseen { age_s } if age_s > 0.2), "{outcome:?}");
    assert!(outcome.to_string().contains("output was not seen off"), "{outcome}");
}

#[test]
fn the_question_of_a_hold_comes_once_the_spindle_is_seen_off() {
    let mut values = values(2.0, 3.0, 8.0);
    values.holds = vec![Hold { row: 600, why: "2 mm from nerve".into() }];
    let plan = values.plan(settings());
    let mut user = User::default();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    // the output does not go off
    arm.changes = |state, now_s| state.spindle_on |= now_s > 1.0;
    let outcome = arm.run(&plan, &mut user);
    assert!(outcome.to_string().contains("was switched off and is still seen on"), "{outcome}");
    assert_eq!((user.asked, outcome.spindle), (1, SpindleEnd::On));
}

#[test]
fn the_bound_is_of_the_given_lookahead_and_gain_and_what_cannot_run_is_refused() {
    let values = values(2.0, 6.0, 8.0);
    let with = |timing| values.plan(Settings { timing, ..settings() });
    let quick = with(Timing::ASSUMED);
    let late = with(Timing::of_servo(0.2, 100.0).unwrap());
    assert_eq!(Timing::of_servo(0.03, 2000.0).unwrap(), Timing::ASSUMED);
    for row in [300, 500, 700] {
        let (a, b) = (quick.travel(row), late.travel(row));
        assert!(b.along_mm > a.along_mm && b.off_mm > 2.0 * a.off_mm, "row {row}: {a:?}, {b:?}");
    }
    assert!(quick.ready().is_ok());
    assert!(late.ready().unwrap_err().contains("a smaller --lookahead-s or a larger --gain"));
    assert!((late.settings().timing.lag_s - 0.296).abs() < 1e-9);
    assert!(Timing::of_servo(0.2, 99.0).is_err() && Timing::of_servo(f64::NAN, 300.0).is_err());
}

#[test]
fn a_log_with_its_head_only_says_that_nothing_was_begun() {
    let mut bytes = Vec::new();
    LogWriter::new(&mut bytes, "d1", 10, 0.002).unwrap();
    let read = Log::read(std::str::from_utf8(&bytes).unwrap()).unwrap();
    assert!(matches!(read.last_row(), Err(StreamError::NoStep)));
}

#[test]
fn a_run_goes_on_from_as_far_as_a_failure_may_have_left_the_burr() {
    // back along the path, and beside the shaft's way out
    let plan = values(2.0, 6.0, 8.0).plan(settings());
    for seen in [300.0, 500.0, 700.0] {
        let row = plan.resume_row(seen);
        let (start_mm, most_mm) = (plan.track.burr_at(seen), plan.travel(seen as usize).along_mm);
        let rests = (seen as usize..plan.track.rows())
            .take_while(|n| (plan.track.burr_at(*n as f64) - start_mm).norm() <= 0.99 * most_mm)
            .last()
            .unwrap();
        let away_mm = (plan.track.burr_at(rests as f64) - plan.track.burr_at(row)).norm();
        assert!(away_mm > plan.travel(row as usize).along_mm, "{away_mm} mm");
        let way = Approach::new(&plan, &plan.track.joints(rests as f64), row);
        assert!(way.is_ok(), "{away_mm} mm: {way:?}");
    }
}
