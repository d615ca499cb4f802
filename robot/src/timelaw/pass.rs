//! The base: the fastest motion s₀(t) within the boxes.
//!
//! Nodes are the ends of the stretches. ṡ² rises and falls by at most 2A per mm, so one backward and one forward sweep give
//! the greatest ṡ² at every node. On a stretch ṡ₀ rises, stays constant and falls, which is the exact optimum.

use super::stretch::Stretch;

/// A part of the base with constant s̈₀.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Phase {
    /// s at its start, mm.
    pub s_mm: f64,
    /// ṡ at its start, mm/s.
    pub speed_mm_s: f64,
    /// s̈, mm/s².
    pub acceleration_mm_s2: f64,
    /// Its duration, s; above 0.
    pub duration_s: f64,
}

/// The greatest ṡ² at every node, mm²/s², shape (stretches + 1).
fn greatest_sigma(stretches: &[Stretch]) -> Vec<f64> {
    let mut sigma = vec![0.0; stretches.len() + 1];
    for (k, stretch) in stretches.iter().enumerate() {
        let most = stretch.speed_mm_s * stretch.speed_mm_s;
        let before = k.checked_sub(1).map_or(0.0, |k| stretches[k].speed_mm_s.powi(2));
        sigma[k] = if stretch.starts_at_rest { 0.0 } else { most.min(before) };
    }
    for (k, stretch) in stretches.iter().enumerate().rev() {
        sigma[k] = sigma[k].min(sigma[k + 1] + 2.0 * stretch.acceleration_mm_s2 * stretch.length_mm);
    }
    for (k, stretch) in stretches.iter().enumerate() {
        sigma[k + 1] = sigma[k + 1].min(sigma[k] + 2.0 * stretch.acceleration_mm_s2 * stretch.length_mm);
    }
    sigma
}

/// Every phase of the base in order; a rest inside the path lasts `rest_s`.
pub(super) fn for_each_phase(stretches: &[Stretch], rest_s: f64, mut visit: impl FnMut(Phase)) {
    let sigma = greatest_sigma(stretches);
    let mut start_mm = 0.0;
    for (k, stretch) in stretches.iter().enumerate() {
        if stretch.starts_at_rest && k > 0 {
            visit(Phase { s_mm: start_mm, speed_mm_s: 0.0, acceleration_mm_s2: 0.0, duration_s: rest_s });
        }
        let (from, to, length) = (sigma[k], sigma[k + 1], stretch.length_mm);
        let acceleration = stretch.acceleration_mm_s2;
        let slope = 2.0 * acceleration;
        let most = stretch.speed_mm_s * stretch.speed_mm_s;
        let peak = most.min(0.5 * (from + to + slope * length)).max(from).max(to);
        let rise = ((peak - from) / slope).min(length);
        let fall = ((peak - to) / slope).min(length - rise);
        let [a, b, c] = [from, peak, to].map(f64::sqrt);
        let mut s_mm = start_mm;
        for (part_mm, [from, to], acceleration_mm_s2) in
            [(rise, [a, b], acceleration), (length - rise - fall, [b, b], 0.0), (fall, [b, c], -acceleration)]
        {
            if part_mm > 0.0 {
                let duration_s = 2.0 * part_mm / (from + to);
                visit(Phase { s_mm, speed_mm_s: from, acceleration_mm_s2, duration_s });
            }
            s_mm += part_mm;
        }
        start_mm += length;
    }
}

/// The duration of the base, s.
pub(super) fn duration_s(stretches: &[Stretch], rest_s: f64) -> f64 {
    let mut total_s = 0.0;
    for_each_phase(stretches, rest_s, |phase| total_s += phase.duration_s);
    total_s
}
