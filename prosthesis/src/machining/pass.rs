//! A pass: a line of places of the tip, from an outline and heights; its runs; and the fewest places that keep it.
//!
//! Invariant: where a pass was [`refined`], straight lines between its places stay within 0.003 mm above the lowest allowed heights; where it was
//! [`simplified`], within [`CHORD_MM`] of its places.

use rayon::prelude::*;

use crate::machining::stock::TipPoint;

/// How far a chord may leave its pass: across, below and above, mm.
const CHORD_MM: f64 = 0.004;
/// Lowest height of the tip at a place, mm; +∞ where it must not be.
pub type Height<'a> = &'a (dyn Fn([f64; 2]) -> f64 + Sync);

/// A line of places of the tip, seen from one side.
#[derive(Debug, Clone, PartialEq)]
pub struct TipPass {
    /// Places, mm, about `Passes::step_mm` apart.
    pub places: Vec<TipPoint>,
    /// Whether the last is followed by the first.
    pub closed: bool,
}

impl TipPass {
    /// Places along a loop, at heights that `height` gives; +∞ where the tip must not be.
    pub fn along(outline: &[[f64; 2]], step_mm: f64, height: impl Fn([f64; 2]) -> f64 + Sync) -> Self {
        let points = crate::machining::silhouette::sampled(outline, step_mm);
        Self { places: points.into_par_iter().map(|p| [p[0], p[1], height(p)]).collect(), closed: true }
    }

    /// The pass the other way round.
    pub fn reversed(mut self) -> Self {
        self.places.reverse();
        self
    }

    /// The pass where it is above a height, else at that height.
    pub(crate) fn above(&self, w_mm: f64) -> Self {
        Self {
            places: self.places.iter().map(|p| [p[0], p[1], p[2].max(w_mm)]).collect(),
            closed: self.closed,
        }
    }

    pub(crate) fn next(&self, n: usize) -> TipPoint {
        self.places[(n + 1) % self.places.len()]
    }

    pub(crate) fn before(&self, n: usize) -> Option<&TipPoint> {
        if n == 0 { self.places.last().filter(|_| self.closed) } else { self.places.get(n - 1) }
    }

    /// Mean distance of neighbours, mm.
    pub(crate) fn step_mm(&self) -> f64 {
        let across = self.places.windows(2).map(|p| across_mm(&p[1], &p[0]));
        (across.sum::<f64>() / self.places.len().max(1) as f64).max(1e-3)
    }

    pub(crate) fn nearest(&self, to: TipPoint) -> usize {
        let places = self.places.iter().enumerate();
        places.min_by(|a, b| across_mm(a.1, &to).total_cmp(&across_mm(b.1, &to))).map_or(0, |(n, _)| n)
    }

    /// Where it ends that begins at its first place.
    pub(crate) fn end(&self) -> Option<TipPoint> {
        if self.closed { self.places.first() } else { self.places.last() }.copied()
    }

    /// To where it begins, across, mm: a closed pass begins anywhere.
    pub(crate) fn distance_mm(&self, at: TipPoint) -> f64 {
        let start = if self.closed { self.nearest(at) } else { 0 };
        self.places.get(start).map_or(0.0, |p| across_mm(p, &at))
    }

    /// Those of its places that are more than a distance apart, across.
    pub(crate) fn sparse(&self, distance_mm: f64) -> Vec<TipPoint> {
        let mut kept: Vec<TipPoint> = self.places.iter().take(1).copied().collect();
        for p in &self.places {
            if kept.last().is_some_and(|last| across_mm(p, last) > distance_mm) {
                kept.push(*p);
            }
        }
        kept
    }

    /// The closed pass from another of its places on.
    pub(crate) fn from(&self, start: usize) -> Vec<TipPoint> {
        let (head, tail) = self.places.split_at(start.min(self.places.len()));
        [tail, head].concat()
    }

    /// What is driven to cut where it is `needed`: up to `lead` places more at each end, and gaps of up to `bridge` places.
    pub(crate) fn driven(&self, needed: &[bool], lead: usize, bridge: usize) -> Vec<bool> {
        let count = self.places.len();
        // places before or after one, as far as the tip may be there
        let from = |n: usize, most: usize, forward: bool| {
            let step = move |k: usize| if forward { n + count + k } else { n + count - k };
            let inside = |m: &usize| self.closed || (count..2 * count).contains(m);
            let free = |m: &usize| self.places[m % count][2].is_finite();
            let all = (1..=most.min(count - 1)).map(step).take_while(inside).take_while(free);
            all.map(|m| m % count).collect::<Vec<usize>>()
        };
        let mut driven = needed.to_vec();
        for n in (0..count).filter(|n| needed[*n]) {
            let ahead = from(n, bridge + 1, true);
            let gap = ahead.iter().position(|m| needed[*m]).unwrap_or(0);
            let leads = [from(n, lead, true), from(n, lead, false), ahead[..gap].to_vec()];
            leads.iter().flatten().for_each(|m| driven[*m] = true);
        }
        driven
    }

    /// The stretches that are driven.
    pub(crate) fn runs(&self, driven: &[bool]) -> Vec<Vec<TipPoint>> {
        // begin in a gap, so that no run goes around the end
        let start = if self.closed { driven.iter().position(|d| !d).unwrap_or(0) } else { 0 };
        let places: Vec<(bool, TipPoint)> = driven.iter().copied().zip(self.places.iter().copied()).collect();
        let (head, tail) = places.split_at(start);
        let around = [tail, head].concat();
        let runs = around.chunk_by(|a, b| a.0 == b.0).filter(|run| run[0].0);
        runs.map(|run| run.iter().map(|(_, place)| *place).collect()).collect()
    }
}

/// Distance of two places across the cutter's axis, mm.
pub(crate) fn across_mm(a: &TipPoint, b: &TipPoint) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The fewest of the places whose chords stay within `CHORD_MM` of those left out.
pub(crate) fn simplified(places: &[TipPoint]) -> Vec<TipPoint> {
    let mut kept: Vec<TipPoint> = places.first().copied().into_iter().collect();
    let mut start = 0;
    while start + 1 < places.len() {
        let (mut end, mut step) = (start + 1, 1);
        // farther and farther while the chord holds, then back by halves
        while end + step < places.len() && holds(&places[start..=end + step]) {
            end += step;
            step *= 2;
        }
        while step > 0 {
            if end + step < places.len() && holds(&places[start..=end + step]) {
                end += step;
            }
            step /= 2;
        }
        kept.push(places[end]);
        start = end;
    }
    kept
}

fn holds(places: &[TipPoint]) -> bool {
    let [a, between @ .., b] = places else { return true };
    let (du, dv) = (b[0] - a[0], b[1] - a[1]);
    let length2 = du * du + dv * dv;
    let near = |p: &TipPoint| {
        let part = if length2 > 0.0 { ((p[0] - a[0]) * du + (p[1] - a[1]) * dv) / length2 } else { 0.0 };
        let off2 = (p[0] - a[0] - part * du).powi(2) + (p[1] - a[1] - part * dv).powi(2);
        let w = a[2] + part * (b[2] - a[2]);
        (0.0..=1.0).contains(&part) && off2 <= CHORD_MM * CHORD_MM && (w - p[2]).abs() <= CHORD_MM
    };
    between.iter().all(near)
}

/// Whole micrometres; heights up.
pub(crate) fn rounded([u, v, w]: TipPoint) -> TipPoint {
    let up = (w * 1000.0 - 1e-6).ceil() / 1000.0;
    [(u * 1000.0).round() / 1000.0, (v * 1000.0).round() / 1000.0, up]
}

/// Keeps places at which a straight line between neighbours would leave `height` by more than 0.003 mm, by halving.
pub(crate) fn refined(pass: TipPass, height: impl Fn([f64; 2]) -> f64 + Sync) -> TipPass {
    let count = pass.places.len();
    let from = |n: usize| {
        let mut places = vec![pass.places[n]];
        if n + 1 < count || pass.closed {
            halve(pass.places[n], pass.next(n), &height, 6, &mut places);
        }
        places
    };
    TipPass {
        places: (0..count).into_par_iter().with_min_len(16).flat_map_iter(from).collect(),
        closed: pass.closed,
    }
}

fn halve(
    a: TipPoint,
    b: TipPoint,
    height: &impl Fn([f64; 2]) -> f64,
    depth: usize,
    into: &mut Vec<TipPoint>,
) {
    let middle = [0.5 * (a[0] + b[0]), 0.5 * (a[1] + b[1])];
    let w = height(middle);
    let off = w - 0.5 * (a[2] + b[2]);
    if depth == 0 || !off.is_finite() || (-0.01..=0.003).contains(&off) {
        return;
    }
    let middle = [middle[0], middle[1], w];
    halve(a, middle, height, depth - 1, into);
    into.push(middle);
    halve(middle, b, height, depth - 1, into);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pass(heights: &[f64], closed: bool) -> TipPass {
        let places = heights.iter().enumerate().map(|(n, w)| [n as f64, 0.0, *w]);
        TipPass { places: places.collect(), closed }
    }

    #[test]
    fn leads_and_short_gaps_are_driven_but_not_where_the_tip_must_not_be() {
        let [o, x] = [0.0, f64::INFINITY];
        let needed = [true, false, false, true, false, false, false, false, true, false];
        let driven = |heights: &[f64], closed| {
            let pass = pass(heights, closed);
            let driven = pass.driven(&needed, 1, 2);
            let text = driven.iter().map(|d| if *d { '#' } else { '.' }).collect::<String>();
            (text, pass.runs(&driven).iter().map(Vec::len).collect::<Vec<_>>())
        };
        assert_eq!(driven(&[o; 10], false), ("#####..###".into(), vec![5, 3]));
        assert_eq!(driven(&[o; 10], true), ("#####..###".into(), vec![8]));
        let walled = [o, o, x, o, o, o, o, x, o, o];
        assert_eq!(driven(&walled, true), ("##.##...##".into(), vec![2, 4]));
    }
}
