//! Forces of one trial in D's figures: toward the nerve while the burr is near it, and overall.
//!
//! A trial is a path with a force and a speed per move, so its samples have a weight: the time that the move takes. D samples a
//! sensor at equal times; here the weights stand for that.

use bonemill_planner::toward::{TowardFigures, TowardSpan};

/// One move that cuts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// How long it takes, s.
    pub seconds: f64,
    /// Whole force, N.
    pub force_n: f64,
    /// Toward the nerve, N, if it is within [`bonemill_planner::toward::NEAR_MM`]; 0 if it points away.
    pub toward_n: Option<f64>,
}

/// D's figures of a trial, N.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrialFigures {
    /// Mean toward the nerve, over the time in which it points there.
    pub mean_toward_n: f64,
    /// The same over all of the time near the nerve, zeros included.
    pub mean_toward_with_zeros_n: f64,
    /// 75th percentile of the former.
    pub p75_toward_n: f64,
    /// 75th percentile of the latter.
    pub p75_toward_with_zeros_n: f64,
    /// Largest toward the nerve.
    pub peak_toward_n: f64,
    /// Mean of the whole force.
    pub mean_n: f64,
    /// Largest whole force.
    pub peak_n: f64,
}

impl TrialFigures {
    /// Of a trial's samples.
    pub fn of(samples: &[Sample]) -> Self {
        let figures = |force_n: fn(&Sample) -> Option<f64>| {
            let span = |(row, s): (usize, &Sample)| {
                Some(TowardSpan { seconds: s.seconds, force_n: force_n(s)?, row })
            };
            TowardFigures::of(&samples.iter().enumerate().filter_map(span).collect::<Vec<_>>())
        };
        let (toward, whole) = (figures(|s| s.toward_n), figures(|s| Some(s.force_n)));
        Self {
            mean_toward_n: toward.mean_n,
            mean_toward_with_zeros_n: toward.mean_with_zeros_n,
            p75_toward_n: toward.p75_n,
            p75_toward_with_zeros_n: toward.p75_with_zeros_n,
            peak_toward_n: toward.peak_n,
            mean_n: whole.mean_with_zeros_n,
            peak_n: whole.peak_n,
        }
    }

    /// All seven, in the order of the fields.
    pub fn values(&self) -> [f64; 7] {
        [
            self.mean_toward_n,
            self.mean_toward_with_zeros_n,
            self.p75_toward_n,
            self.p75_toward_with_zeros_n,
            self.peak_toward_n,
            self.mean_n,
            self.peak_n,
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn time_is_the_weight_and_zeros_are_told_apart() {
        let sample = |seconds, force_n, toward_n| Sample { seconds, force_n, toward_n };
        let figures = TrialFigures::of(&[
            sample(1.0, 1.0, Some(0.4)),
            sample(3.0, 0.5, Some(0.8)),
            sample(4.0, 2.0, Some(0.0)),
            sample(2.0, 3.0, None),
        ]);
        assert!((figures.mean_toward_n - 0.7).abs() < 1e-12);
        assert!((figures.mean_toward_with_zeros_n - 0.35).abs() < 1e-12);
        assert_eq!((figures.p75_toward_n, figures.p75_toward_with_zeros_n), (0.8, 0.8));
        assert_eq!((figures.peak_toward_n, figures.peak_n), (0.8, 3.0));
        assert!((figures.mean_n - 1.65).abs() < 1e-12);
        assert_eq!(TrialFigures::of(&[]), TrialFigures::default());
    }
}
