//! What must hold before the first motion, when the controller has answered and when the user has agreed; and the spindle, as it is seen.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod common;
#[path = "common/obedient.rs"]
mod obedient;

use bonemill_robot::stream::{
    ArmState, Cause, HoldPlace, Identity, Order, PLAYING, Session, SpindleEnd, StreamPlan,
};
use common::{PERIOD_S, settings, values};
use obedient::{Obedient, User};

fn plan() -> StreamPlan {
    values(1.0, 3.0, 8.0).plan(settings())
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
            let step = session.step(&bonemill_robot::stream::Seen {
                now_s,
                state,
                identity,
                answer,
                ..Default::default()
            });
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
    values.holds = vec![HoldPlace { row: 600, why: "2 mm from nerve".into() }];
    let plan = values.plan(settings());
    let mut user = User::default();
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    // the output does not go off
    arm.changes = |state, now_s| state.spindle_on |= now_s > 1.0;
    let outcome = arm.run(&plan, &mut user);
    assert!(outcome.to_string().contains("was switched off and is still seen on"), "{outcome}");
    assert_eq!((user.asked, outcome.spindle), (1, SpindleEnd::On));
}
