//! Seeded schedules of faults in simulated time: the burr stays within what was printed, nothing hangs, nothing is silent, and a run
//! goes on where it was stopped.

#![allow(clippy::unwrap_used, reason = "a test's helper fails by panicking")]

mod common;

use bonemill_robot::stream::Cause;
use bonemill_robot::stream::simulated::fault::Fault;
use bonemill_robot::stream::simulated::trial::TrialPiece;

const COUNT: u64 = 10_000;

fn pieces() -> Vec<TrialPiece> {
    let mut all = Vec::new();
    for (most_mm_s, gap_mm) in [(4.0, 0.6), (10.0, 2.0), (1.5, 8.0)] {
        let plan = common::values(3.0, most_mm_s, gap_mm).plan(common::settings());
        all.extend((0..7).map(|n| TrialPiece::new(&plan, 200 * n, 120)));
    }
    all
}

#[test]
fn ten_thousand_schedules_stay_within_the_printed_bound() {
    let pieces = pieces();
    let mut stopped = vec![0; Fault::ALL.len()];
    for seed in 0..COUNT {
        let n = seed as usize % Fault::ALL.len();
        let (name, fault) = Fault::ALL[n];
        let resume = seed % 8 == 0;
        let piece = &pieces[(seed as usize / Fault::ALL.len()) % pieces.len()];
        let result = piece.run(fault, seed, resume);
        assert!(result.is_within(), "{name}, seed {seed}: {result:#?}");
        assert!(!result.hung(), "{name}, seed {seed}: hung");
        assert!(result.outcome.at_rest || result.outcome.cause.is_some(), "{name}, seed {seed}: silent");
        assert!(result.skipped_mm < 1e-6, "{name}, seed {seed}: {result:#?}");
        if let Some(resumed) = &result.resumed {
            assert_eq!(resumed.cause, None, "{name}, seed {seed}: {result:#?}");
            // nothing was left out, and nothing else was cut, than what is told from the plan within its tolerance
            let swept = result.swept.unwrap();
            assert!(swept.left_mm <= piece.tolerance_mm(), "{name}, seed {seed}: {swept:?}");
            assert!(swept.beside_mm <= piece.tolerance_mm(), "{name}, seed {seed}: {swept:?}");
            assert!(swept.different_mm3 < 0.02 * swept.planned_mm3, "{name}, seed {seed}: {swept:?}");
        }
        stopped[n] += usize::from(result.outcome.cause.is_some());
    }
    for ((name, fault), stopped) in Fault::ALL.iter().zip(stopped) {
        // a state that is late for less than the arm keeps its last target for stops nothing
        let is_bridged = *fault == Fault::StatesHeld(0.05);
        let goes_on = is_bridged
            || matches!(fault, Fault::None | Fault::DashboardCut | Fault::Duplicated | Fault::Slider(_));
        let must_stop = matches!(
            fault,
            Fault::ReceiveCut
                | Fault::BothCut
                | Fault::HalfOpen
                | Fault::Frozen
                | Fault::Dead
                | Fault::SafetyStop(_)
        ) || *fault == Fault::StatesHeld(0.2);
        assert!(!goes_on || stopped == 0, "{name}: {stopped} stopped");
        assert!(!must_stop || stopped > 150, "{name}: only {stopped} stopped");
    }
}

#[test]
fn the_same_seed_is_the_same_run() {
    let piece = &pieces()[1];
    let (a, b) = (piece.run(Fault::Jitter(0.02), 7, true), piece.run(Fault::Jitter(0.02), 7, true));
    assert_eq!(a, b);
}

#[test]
fn the_cause_comes_first() {
    let piece = &pieces()[0];
    let cause = |fault| piece.run(fault, 11, false).outcome.cause;
    assert_eq!(cause(Fault::SafetyStop(3)), Some(Cause::SafetyMode(3)));
    assert!(matches!(cause(Fault::Frozen), Some(Cause::Stale { age_s }) if age_s < 0.08));
    assert_eq!(cause(Fault::PendantStop), Some(Cause::ProgramStopped));
    assert_eq!(cause(Fault::Interrupted), Some(Cause::Interrupted));
    assert!(matches!(cause(Fault::WrongStart(5.0)), Some(Cause::NotReady(why)) if why.contains("5.00 mm")));
    let offset = cause(Fault::Offset(9.5e-3));
    assert!(offset.is_some_and(|c| c.to_string().contains(" mm ")), "judged in mm");
}

#[test]
fn targets_held_on_the_controller_bridge_stalls_and_go_farther_after_a_loss() {
    let plan = common::values(3.0, 4.0, 0.6).plan(common::settings());
    let servo: Vec<TrialPiece> = (0..4).map(|n| TrialPiece::new(&plan, 200 * n, 500)).collect();
    let worst_mm = |pieces: &[TrialPiece], fault: Fault| {
        let results = (0..120).map(|seed| pieces[seed as usize % pieces.len()].run(fault, seed, false));
        results.fold((0, 0.0f64), |(stopped, worst_mm), result| {
            assert!(result.is_within() && !result.hung(), "{fault:?}: {result:#?}");
            (stopped + usize::from(result.outcome.cause.is_some()), worst_mm.max(result.travel.along_mm))
        })
    };
    let held = [0.02, 0.2]
        .map(|depth_s| servo.iter().map(|piece| piece.clone().buffered(depth_s)).collect::<Vec<_>>());
    for fault in [Fault::ControlCut, Fault::HalfOpen, Fault::Killed] {
        let [(stopped, at_once_mm), (_, short_mm), (_, long_mm)] =
            [&servo, &held[0], &held[1]].map(|pieces| worst_mm(pieces, fault));
        assert_eq!(stopped, 120, "{fault:?}");
        assert!(
            at_once_mm < short_mm && short_mm + 0.1 < long_mm,
            "{fault:?}: {at_once_mm} {short_mm} {long_mm}"
        );
    }
    let stall = Fault::Stall(0.15);
    let stopped = [&servo, &held[0], &held[1]].map(|pieces| worst_mm(pieces, stall).0);
    assert!(stopped[0] > 60 && stopped[2] == 0, "{stopped:?}");
}
