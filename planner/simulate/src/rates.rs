//! The mean removal rate of every step, such that rates times durations add up to the removed volume.
//!
//! A step's own rate is computed from the burr's surface at its end. Where the engagement changes within a step, this is not
//! the step's mean, and the sum over a plan is some per cent too large. The lattice's loss is exact, but the lattice is
//! updated some distance behind the burr. So the loss between two updates of the lattice is divided among the steps in that
//! part of the path, in proportion to their own rates.

/// Steps, and the volumes that are known for them.
#[derive(Debug, Default)]
pub struct StepVolumes {
    /// Path length at the end of each step, mm.
    ends_mm: Vec<f64>,
    /// Volume by each step's own rate, mm³.
    by_rate_mm3: Vec<f64>,
    /// Volume that each step removes, mm³.
    removed_mm3: Vec<f64>,
    /// Path length up to which the lattice is updated, mm, and the volume removed from it so far, mm³.
    lost: (f64, f64),
    /// The first step whose end the lattice has not reached.
    next: usize,
}

impl StepVolumes {
    /// Adds a step.
    pub fn push(&mut self, length_mm: f64, by_rate_mm3: f64) {
        self.ends_mm.push(self.way_mm() + length_mm);
        self.by_rate_mm3.push(by_rate_mm3);
        self.removed_mm3.push(0.0);
    }

    /// Length of the path so far, mm.
    fn way_mm(&self) -> f64 {
        self.ends_mm.last().copied().unwrap_or(0.0)
    }

    /// Records that the lattice has lost `lost_mm3` in total, and that the last `pending_mm` of the path are not removed yet.
    pub fn look(&mut self, lost_mm3: f64, pending_mm: f64) {
        let (from_mm, before_mm3) = self.lost;
        let (to_mm, new_mm3) = (self.way_mm() - pending_mm, lost_mm3 - before_mm3);
        if to_mm <= from_mm || new_mm3 <= 0.0 {
            return;
        }
        let first = self.next;
        let parts: Vec<f64> = (first..self.ends_mm.len())
            .take_while(|n| *n == first || self.ends_mm[n - 1] < to_mm)
            .map(|n| {
                let begin_mm = n.checked_sub(1).map_or(0.0, |before| self.ends_mm[before]);
                let length_mm = self.ends_mm[n] - begin_mm;
                let covered_mm = self.ends_mm[n].min(to_mm) - begin_mm.max(from_mm);
                if length_mm > 0.0 { self.by_rate_mm3[n] * covered_mm.max(0.0) / length_mm } else { 0.0 }
            })
            .collect();
        let Some(last) = parts.len().checked_sub(1) else { return };
        let sum: f64 = parts.iter().sum();
        for (n, part) in parts.iter().enumerate() {
            // where all rates are 0, the last step gets the volume
            let share = if sum > 0.0 { part / sum } else { f64::from(u8::from(n == last)) };
            self.removed_mm3[first + n] += new_mm3 * share;
        }
        self.next = first + last;
        self.lost = (to_mm, lost_mm3);
    }

    /// Volume that each step removes, mm³. Volume removed after the last update is not included.
    pub fn removed_mm3(self) -> Vec<f64> {
        self.removed_mm3
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sum_is_what_was_lost_and_air_stays_air() {
        let mut steps = StepVolumes::default();
        for by_rate_mm3 in [0.0, 1.1, 2.2, 0.0] {
            steps.push(0.1, by_rate_mm3);
        }
        steps.look(1.0, 0.2);
        for by_rate_mm3 in [0.0, 3.3] {
            steps.push(0.1, by_rate_mm3);
        }
        steps.look(3.0, 0.25);
        steps.push(0.0, 0.0);
        steps.look(6.0, 0.0);
        let found = steps.removed_mm3();
        assert!((found.iter().sum::<f64>() - 6.0).abs() < 1e-12, "{found:?}");
        assert_eq!([found[0], found[1], found[3], found[6]], [0.0, 1.0, 0.0, 0.0]);
        assert!((found[2] - 2.0).abs() < 1e-12 && (found[5] - 3.0).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn a_loss_without_any_rate_goes_to_the_last_step() {
        let mut steps = StepVolumes::default();
        steps.push(0.1, 0.0);
        steps.push(0.1, 0.0);
        steps.look(0.5, 0.0);
        assert_eq!(steps.removed_mm3(), [0.0, 0.5]);
    }
}
