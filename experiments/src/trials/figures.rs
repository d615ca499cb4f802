//! Forces of one trial in D's figures: toward the nerve while the burr is near it, and overall.
//!
//! A trial is a path with a force and a speed per move, so its samples have a weight: the time that the move takes. D samples a
//! sensor at equal times; here the weights stand for that.

/// D's radius of interest: the burr's surface within this of the nerve, mm.
pub const NEAR_MM: f64 = 2.0;

/// One move that cuts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// How long it takes, s.
    pub seconds: f64,
    /// Whole force, N.
    pub force_n: f64,
    /// Toward the nerve, N, if it is within [`NEAR_MM`]; 0 if it points away.
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
        let near: Vec<[f64; 2]> = samples.iter().filter_map(|s| Some([s.toward_n?, s.seconds])).collect();
        let toward: Vec<[f64; 2]> = near.iter().copied().filter(|[n, _]| *n > 0.0).collect();
        let all: Vec<[f64; 2]> = samples.iter().map(|s| [s.force_n, s.seconds]).collect();
        let peak = |of: &[[f64; 2]]| of.iter().map(|s| s[0]).fold(0.0, f64::max);
        Self {
            mean_toward_n: mean(&toward),
            mean_toward_with_zeros_n: mean(&near),
            p75_toward_n: quantile(toward.clone(), 0.75),
            p75_toward_with_zeros_n: quantile(near, 0.75),
            peak_toward_n: peak(&toward),
            mean_n: mean(&all),
            peak_n: peak(&all),
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

/// Mean of values by weight; 0 without weight.
fn mean(samples: &[[f64; 2]]) -> f64 {
    let (sum, weight) = samples.iter().fold((0.0, 0.0), |(s, w), [v, t]| (s + v * t, w + t));
    if weight > 0.0 { sum / weight } else { 0.0 }
}

/// The value below which the share `q` of the weight lies; 0 without weight.
fn quantile(mut samples: Vec<[f64; 2]>, q: f64) -> f64 {
    samples.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let wanted = q * samples.iter().map(|s| s[1]).sum::<f64>();
    let mut below = 0.0;
    for [value, weight] in &samples {
        below += weight;
        if below >= wanted {
            return *value;
        }
    }
    0.0
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
