//! Rolls of a path: traced back through the dynamic program, interpolated between its poses, then smoothed.

use bonemill_arm::ur::ik::wrapped;

use super::grid::{BRANCHES, ROLLS, SHORTEST_MM, STEP_RAD};

/// Number of sweeps that smooth the rolls.
const SWEEPS: usize = 64;

/// Rolls as the dynamic program chose them.
pub(super) struct ChosenRolls {
    pub branch: u8,
    pub roll_rad: Vec<f64>,
}

/// Traces the chosen rolls back from the best end.
pub(super) fn traced(from: &[u8], best: usize, count: usize) -> ChosenRolls {
    let (branch, mut roll) = (best / ROLLS, best % ROLLS);
    let mut turns = vec![0i64; count];
    let mut place = roll as i64;
    for i in (0..count).rev() {
        turns[i] = place;
        match from[i * BRANCHES * ROLLS + branch * ROLLS + roll] {
            0 if i > 0 => (roll, place) = ((roll + ROLLS - 1) % ROLLS, place - 1),
            2 if i > 0 => (roll, place) = ((roll + 1) % ROLLS, place + 1),
            _ => {}
        }
    }
    let roll_rad = turns.iter().map(|turn| *turn as f64 * STEP_RAD).collect();
    ChosenRolls { branch: branch as u8, roll_rad }
}

/// Rolls of every pose, interpolated linearly along the path between the poses `at`.
pub(super) fn between(roll_rad: &[f64], at: &[usize], length_mm: &[f64]) -> Vec<f64> {
    let mut all = roll_rad[..roll_rad.len().min(1)].to_vec();
    for (rolls, ends) in roll_rad.windows(2).zip(at.windows(2)) {
        let lengths = length_mm[ends[0] + 1..=ends[1]].iter().map(|mm| mm.max(SHORTEST_MM));
        let whole_mm: f64 = lengths.clone().sum();
        let mut along_mm = 0.0;
        for (i, length_mm) in (ends[0] + 1..).zip(lengths) {
            along_mm += length_mm;
            // at a sampled pose the chosen roll is kept exactly
            let share = if i == ends[1] { 1.0 } else { along_mm / whole_mm };
            all.push(rolls[0] + (rolls[1] - rolls[0]) * share);
        }
    }
    all
}

/// Smooths the sampled rolls, weighted by the moves' lengths. No roll moves more than one step from its sample.
pub(super) fn even_out(roll_rad: &mut [f64], length_mm: &[f64], step_rad: f64) {
    let sampled = roll_rad.to_vec();
    for sweep in 0..SWEEPS {
        // sweeps alternate in direction, so that a change spreads both ways
        let inner = 1..roll_rad.len().saturating_sub(1);
        let visit = |i: usize, rolls: &mut [f64]| {
            let [before, after] = [i, i + 1].map(|k| length_mm[k].max(SHORTEST_MM));
            let even = (rolls[i - 1] * after + rolls[i + 1] * before) / (before + after);
            rolls[i] = even.clamp(sampled[i] - step_rad, sampled[i] + step_rad);
        };
        if sweep % 2 == 0 {
            inner.for_each(|i| visit(i, roll_rad));
        } else {
            inner.rev().for_each(|i| visit(i, roll_rad));
        }
    }
    // a roll that has not moved keeps its exact value
    for (roll, sampled) in roll_rad.iter_mut().zip(&sampled) {
        if wrapped(*roll - sampled).abs() < 1e-12 {
            *roll = *sampled;
        }
    }
}
