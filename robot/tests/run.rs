//! A run without and with what users do: every row, hold points, too much force, refusals before the start, the log and going on from it.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod common;
#[path = "common/obedient.rs"]
mod obedient;

use bonemill_arm::Arm;
use bonemill_robot::stream::approach::Approach;
use bonemill_robot::stream::simulated::rehearse::rehearse;
use bonemill_robot::stream::{
    ArmState, Cause, HoldPlace, Joints, LinkFault, Log, LogWriter, Order, Settings, SpindleEnd, Standing,
    StreamError, StreamPlan, StreamTiming,
};
use common::{PERIOD_S, settings, values};
use nalgebra::Vector3;
use obedient::{Obedient, User};

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
fn while_states_are_late_the_arm_keeps_its_last_target() {
    let plan = plan();
    // the last state before 2 s comes again and again, as `changes` is no closure: once for 60 ms, once for 90 ms
    let held: [fn(&mut ArmState, f64); 2] =
        [|said, now_s| late(said, now_s, 0.06), |said, now_s| late(said, now_s, 0.09)];
    for (changes, goes_on) in held.into_iter().zip([true, false]) {
        let mut arm = Obedient::at(&plan, plan.track.q()[0]);
        arm.changes = changes;
        let mut user = User::default();
        let outcome = arm.run(&plan, &mut user);
        let targets = |from_s: f64, to_s: f64| {
            let sent = arm.orders.iter().filter(move |(at_s, _)| (from_s..to_s).contains(at_s));
            sent.filter(|(_, order)| matches!(order, Order::Target(_))).count()
        };
        let age_s = plan.settings().timing.state_age_s;
        assert!(targets(LATE_S - 0.02, LATE_S) > 5 && targets(LATE_S, LATE_S + age_s) > 5);
        assert_eq!(targets(LATE_S + age_s + PERIOD_S, LATE_S + 0.06), 0, "none on a late state");
        if goes_on {
            assert_eq!((outcome.cause, outcome.rows), (None, plan.track.rows()));
            assert!(
                user.heard.iter().any(|said| said.starts_with("no target was sent for")),
                "{:?}",
                user.heard
            );
        } else {
            assert!(
                matches!(outcome.cause, Some(Cause::Stale { age_s }) if (0.06..0.08).contains(&age_s)),
                "{:?}",
                outcome.cause
            );
        }
    }
}

/// When states of [`Obedient`] begin to be late, s.
const LATE_S: f64 = 1.2;

fn late(said: &mut ArmState, now_s: f64, for_s: f64) {
    if (LATE_S..LATE_S + for_s).contains(&now_s) {
        said.controller_s = 50.0 + LATE_S;
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
fn a_hold_at_the_first_row_waits_there() {
    let mut values = values(2.0, 3.0, 8.0);
    values.holds = vec![HoldPlace { row: 0, why: "2 mm from nerve".into() }];
    let plan = values.plan(settings());
    let mut user = User::who_says(&[true, false]);
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    let outcome = arm.run(&plan, &mut user);
    assert_eq!((outcome.cause, outcome.reached_row), (Some(Cause::Declined), 0.0));
}

#[test]
fn a_hold_goes_back_along_the_path_waits_and_goes_on() {
    let mut values = values(2.0, 3.0, 8.0);
    values.holds = vec![HoldPlace { row: 600, why: "2 mm from nerve".into() }];
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
fn the_bound_is_of_the_given_lookahead_and_gain_and_what_cannot_run_is_refused() {
    let values = values(2.0, 6.0, 8.0);
    let with = |timing| values.plan(Settings { timing, ..settings() });
    let quick = with(StreamTiming::ASSUMED);
    let late = with(StreamTiming::of_servo(0.2, 100.0).unwrap());
    assert_eq!(StreamTiming::of_servo(0.03, 2000.0).unwrap(), StreamTiming::ASSUMED);
    for row in [300, 500, 700] {
        let (a, b) = (quick.travel(row), late.travel(row));
        assert!(b.along_mm > a.along_mm && b.off_mm > 2.0 * a.off_mm, "row {row}: {a:?}, {b:?}");
    }
    assert!(quick.ready().is_ok());
    assert!(late.ready().unwrap_err().contains("a smaller --lookahead-s or a larger --gain"));
    assert!((late.settings().timing.lag_s - 0.296).abs() < 1e-9);
    assert!(StreamTiming::of_servo(0.2, 99.0).is_err() && StreamTiming::of_servo(f64::NAN, 300.0).is_err());
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

#[test]
fn progress_and_gaps_are_told_together_now_and_then() {
    let plan = values(11.0, 1.0, 8.0).plan(settings());
    let mut arm = Obedient::at(&plan, plan.track.q()[0]);
    arm.stall = Some((900, 0.0095));
    let mut user = User::default();
    assert_eq!(arm.run(&plan, &mut user).cause, None);
    let told: Vec<_> = user.heard.iter().filter(|said| said.starts_with("row ")).collect();
    assert_eq!(told.len(), 1, "{:?}", user.heard);
    assert!(told[0].contains(" of 5500; 1 times no target was sent for up to 12 ms"), "{told:?}");
}
