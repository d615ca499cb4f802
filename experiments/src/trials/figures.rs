//! D's figures of the forces of one trial: toward the nerve while the burr is near it, and overall.
//!
//! A trial is a path with a force and a speed per move. Each move is a sample weighted with its duration, which corresponds to
//! D's sensor samples at equal times.

use bonemill_planner::toward::{TowardFigures, TowardSpan};

/// One cut.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CutSample {
    /// Duration, s.
    pub seconds: f64,
    /// Whole force, N.
    pub force_n: f64,
    /// Force toward the nerve, N, if it is within [`bonemill_planner::toward::NEAR_MM`]; 0 if it points away.
    pub toward_n: Option<f64>,
}

/// D's figures of a trial, N.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TrialFigures {
    /// Mean force toward the nerve, over the time in which the force points toward it.
    pub mean_toward_n: f64,
    /// Mean force toward the nerve over the whole time near it, zeros included.
    pub mean_toward_with_zeros_n: f64,
    /// 75th percentile over the time in which the force points toward the nerve.
    pub p75_toward_n: f64,
    /// 75th percentile over the whole time near the nerve, zeros included.
    pub p75_toward_with_zeros_n: f64,
    /// Largest force toward the nerve.
    pub peak_toward_n: f64,
    /// Mean of the whole force.
    pub mean_n: f64,
    /// Largest whole force.
    pub peak_n: f64,
}

impl TrialFigures {
    /// The figures of a trial's samples.
    pub fn of(samples: &[CutSample]) -> Self {
        let figures = |force_n: fn(&CutSample) -> Option<f64>| {
            let span = |(row, s): (usize, &CutSample)| {
                let force_n = force_n(s)?;
                Some(TowardSpan { seconds: s.seconds, force_n, peak_n: force_n, row })
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

    /// All seven figures, in the order of the fields.
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
        let sample = |seconds, force_n, toward_n| CutSample { seconds, force_n, toward_n };
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
