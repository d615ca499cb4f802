//! A program on the controller that follows a buffer of targets, as an alternative to servoJ: to measure how far the burr goes with it.
//!
//! It holds `depth_s` and what it needs to come to rest, plays at the controller's share of full speed, and is never faster than it can come to rest at its
//! last target: without supply it slows down by the ramp, along its path, and then ends. A stop does the same at once.

use std::collections::VecDeque;

use crate::stream::link::Joints;

/// Targets that are not reached yet, and how fast they are played.
#[derive(Debug, Clone)]
pub struct Buffer {
    /// How long its targets last beyond what a stop needs, s.
    depth_s: f64,
    period_s: f64,
    ramp_per_s: f64,
    /// The first is the one behind the place.
    targets: VecDeque<Joints>,
    /// Time since the first target, s.
    place_s: f64,
    rate: f64,
    plays: bool,
    stops: bool,
}

impl Buffer {
    /// Of targets a period apart; the share of full speed changes by the ramp at most.
    pub fn new(depth_s: f64, period_s: f64, ramp_per_s: f64) -> Self {
        let (targets, place_s, rate) = (VecDeque::new(), 0.0, 0.0);
        Self { depth_s, period_s, ramp_per_s, targets, place_s, rate, plays: false, stops: false }
    }

    /// How long its targets last at full speed, s.
    pub fn whole_s(&self) -> f64 {
        self.depth_s + 1.0 / (2.0 * self.ramp_per_s)
    }

    /// Empty, at rest at `q`.
    pub(super) fn start(&mut self, q: Joints) {
        *self = Self::new(self.depth_s, self.period_s, self.ramp_per_s);
        self.targets.push_back(q);
    }

    pub(super) fn push(&mut self, q: Joints) {
        if !self.stops {
            self.targets.push_back(q);
        }
    }

    pub(super) fn stop(&mut self) {
        self.stops = true;
    }

    /// Whether it has come to rest by itself or by a stop.
    pub(super) fn ran_out(&self) -> bool {
        self.plays && self.rate == 0.0 && (self.stops || self.left_s() <= 0.0)
    }

    fn left_s(&self) -> f64 {
        self.period_s * self.targets.len().saturating_sub(1) as f64 - self.place_s
    }

    /// The target a tick later, at a share of full speed.
    pub(super) fn target(&mut self, tick_s: f64, fraction: f64) -> Option<Joints> {
        // what a stop needs comes in while it speeds up
        self.plays |= self.left_s() >= self.depth_s || self.stops;
        let wanted = if self.plays && !self.stops { fraction } else { 0.0 };
        let ramp = self.ramp_per_s * tick_s;
        let to_rest = (2.0 * self.ramp_per_s * self.left_s().max(0.0)).sqrt();
        self.rate = (self.rate + (wanted - self.rate).clamp(-ramp, ramp)).min(to_rest);
        // the last step of a stop, which the root would only come near to
        let step_s = (self.rate * tick_s).min(self.left_s().max(0.0));
        if self.left_s() <= self.rate * tick_s {
            self.rate = 0.0;
        }
        self.place_s += step_s;
        while self.place_s >= self.period_s && self.targets.len() > 1 {
            self.targets.pop_front();
            self.place_s -= self.period_s;
        }
        let (from, to) = (self.targets.front()?, self.targets.get(1).or(self.targets.front())?);
        let share = self.place_s / self.period_s;
        Some(std::array::from_fn(|j| from[j] + share * (to[j] - from[j])))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICK_S: f64 = 0.002;
    const PERIOD_S: f64 = 0.008;
    const RAMP_PER_S: f64 = 4.0;

    /// Steps of a buffer of even targets, in targets a period, at the slider's share of each tick.
    fn played(fractions: &[f64]) -> (Buffer, Vec<f64>) {
        let mut buffer = Buffer::new(0.05, PERIOD_S, RAMP_PER_S);
        buffer.start([0.0; 6]);
        (1..=1000).for_each(|n| buffer.push([f64::from(n); 6]));
        let mut at = 0.0;
        let step = |fraction: &f64| {
            let q = buffer.target(TICK_S, *fraction).unwrap()[0];
            let rate = (q - at) * PERIOD_S / TICK_S;
            at = q;
            rate
        };
        let rates = fractions.iter().map(step).collect();
        (buffer, rates)
    }

    #[test]
    fn a_buffer_follows_the_slider_along_its_targets_by_the_ramp() {
        let slider = [1.0, 0.5, 0.0, 1.0];
        let fractions: Vec<f64> = slider.iter().flat_map(|fraction| [*fraction; 250]).collect();
        let (buffer, rates) = played(&fractions);
        for (n, fraction) in slider.iter().enumerate() {
            assert!((rates[250 * n + 249] - fraction).abs() < 1e-9, "{fraction}: {}", rates[250 * n + 249]);
        }
        let most = RAMP_PER_S * TICK_S + 1e-9;
        assert!(rates.windows(2).all(|pair| (pair[1] - pair[0]).abs() <= most && pair[1] >= 0.0));
        // a slider at 0 is no end
        assert!(!buffer.ran_out());
    }

    #[test]
    fn a_stopped_buffer_rests_and_takes_no_more() {
        let (mut buffer, _) = played(&[1.0; 250]);
        buffer.stop();
        let before = buffer.target(TICK_S, 1.0).unwrap()[0];
        let ticks = (1.0 / (RAMP_PER_S * TICK_S)) as usize + 1;
        let rest = (0..ticks).filter_map(|_| buffer.target(TICK_S, 1.0)).last().unwrap()[0];
        // from full speed at an even ramp: half of what the time of the ramp is long
        let way = 0.5 / RAMP_PER_S / PERIOD_S;
        assert!((rest - before - way).abs() < 0.5, "{before} to {rest}, not {way}");
        assert!(buffer.ran_out());
        let count = buffer.targets.len();
        buffer.push([2000.0; 6]);
        assert_eq!(buffer.targets.len(), count);
    }
}
