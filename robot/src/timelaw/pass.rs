//! The greatest speed profile within the constraints, and the motion between its nodes.
//!
//! Nodes are the ends of the intervals; σ = ṡ² at them, linear (parabolas) or a trapezoid (straight pieces) between.
//! Both constraints of an interval have the form σ₁ ≤ f(σ₀) and σ₀ ≤ f(σ₁) with f increasing and f(0) > 0. So one sweep
//! back and one forth give the greatest σ at every node at once, and σ = 0 is always allowed.

use super::geometry::Element;
use super::prepared::{Interval, PreparedPath, part_ends};

/// The greatest σ at every node under `sigma_max` of every interval, mm²/s², shape (intervals + 1).
///
/// After the sweep back σ₀ ≤ f(σ₁) holds everywhere. The sweep forth lowers σ₁ to f(σ₀) only where σ₁ > f(σ₀) ≥ σ₀, and
/// there σ₀ ≤ f(f(σ₀)) still holds, f being increasing and at least its argument below the curvature's cap.
pub(super) fn greatest_sigma(path: &PreparedPath, sigma_max: &[f64]) -> Vec<f64> {
    let intervals = &path.intervals;
    let mut sigma = vec![f64::INFINITY; intervals.len() + 1];
    for (k, &max) in sigma_max.iter().enumerate() {
        sigma[k] = sigma[k].min(max);
        sigma[k + 1] = max;
    }
    for (k, interval) in intervals.iter().enumerate() {
        if starts_at_rest(path, interval) {
            sigma[k] = 0.0;
        }
    }
    sigma[intervals.len()] = 0.0;
    for (k, interval) in intervals.iter().enumerate().rev() {
        sigma[k] = reached(path, interval, sigma[k + 1], sigma[k]);
    }
    for (k, interval) in intervals.iter().enumerate() {
        sigma[k + 1] = reached(path, interval, sigma[k], sigma[k + 1]);
    }
    sigma
}

/// Stops lie between straight pieces: a stop has no parabola.
fn starts_at_rest(path: &PreparedPath, interval: &Interval) -> bool {
    matches!(interval.element, Element::Straight(i) if path.geometry.stop[i as usize])
}

/// min(f(σ), wanted): what σ at one end of an interval allows at the other.
///
/// Straight: f = σ + slope h. Parabola: |c| σ₁ + P (σ₁ − σ₀)/(2h) ≤ a, so f = min_j (a + g σ₀)/(|c| + g), g = P/(2h),
/// P = max|q'|. For σ₁ > σ₀ this bounds |c σ + q' σ'/2| all over the interval.
fn reached(path: &PreparedPath, interval: &Interval, sigma: f64, wanted: f64) -> f64 {
    // curvature alone was bounded before: what does not rise needs no look at accelerations
    if wanted <= sigma {
        return wanted;
    }
    let corner = match interval.element {
        Element::Straight(_) => return wanted.min(sigma + interval.slope * interval.length_mm),
        Element::Blend(i) => path.geometry.corner(i as usize),
    };
    let [from, to] = part_ends(interval.part);
    let per_mm = 0.5 / interval.length_mm;
    let mut reached = wanted;
    for ((steepest, curvature), a) in corner.bounds(from, to).zip(&path.limits.acceleration) {
        let g = steepest * per_mm;
        // a joint that stands still is 0 ≤ a
        if curvature + g > 0.0 {
            reached = reached.min((a + g * sigma) / (curvature + g));
        }
    }
    // rounding must not end below where it began
    reached.max(sigma.min(wanted))
}

/// A stretch of constant s̈ on one element.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Phase {
    /// Its start on the element, mm of s.
    pub start_mm: f64,
    /// Its length, mm of s; above 0.
    pub length_mm: f64,
    /// ṡ at its start and end, mm/s; not both 0.
    pub speed_mm_s: [f64; 2],
    /// s̈, mm/s²; given, since a difference of speeds over a very short phase is all rounding.
    pub acceleration_mm_s2: f64,
}

impl Phase {
    /// 2h/(ṡ₀ + ṡ₁), s.
    pub fn duration_s(&self) -> f64 {
        2.0 * self.length_mm / (self.speed_mm_s[0] + self.speed_mm_s[1])
    }
}

/// Every phase of the motion in order, with the index of its interval.
pub(super) fn for_each_phase(
    path: &PreparedPath,
    sigma_max: &[f64],
    sigma: &[f64],
    mut visit: impl FnMut(usize, Phase),
) {
    for (k, (interval, &max)) in path.intervals.iter().zip(sigma_max).enumerate() {
        let (from, to) = (sigma[k], sigma[k + 1]);
        let Interval { start_mm, length_mm, slope, .. } = *interval;
        if let Element::Blend(_) = interval.element {
            let speed_mm_s = [from.sqrt(), to.sqrt()];
            let acceleration_mm_s2 = 0.5 * (to - from) / length_mm;
            visit(k, Phase { start_mm, length_mm, speed_mm_s, acceleration_mm_s2 });
            continue;
        }
        let peak = max.min(0.5 * (from + to + slope * length_mm)).max(from).max(to);
        let rise = ((peak - from) / slope).min(length_mm);
        let fall = ((peak - to) / slope).min(length_mm - rise);
        let cruise = length_mm - rise - fall;
        let [a, b, c] = [from, peak, to].map(f64::sqrt);
        let mut start_mm = start_mm;
        let s_dd = 0.5 * slope;
        for (length_mm, speed_mm_s, acceleration_mm_s2) in
            [(rise, [a, b], s_dd), (cruise, [b, b], 0.0), (fall, [b, c], -s_dd)]
        {
            if length_mm > 0.0 {
                visit(k, Phase { start_mm, length_mm, speed_mm_s, acceleration_mm_s2 });
            }
            start_mm += length_mm;
        }
    }
}
