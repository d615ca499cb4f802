//! A share of samples with its confidence interval.

use statrs::distribution::{Beta, ContinuousCDF};

/// The share of samples in which something happened, and the confidence interval of its probability.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Share {
    /// Samples in which it happened.
    pub hits: usize,
    /// Number of all samples.
    pub samples: usize,
    /// hits / samples.
    pub estimate: f64,
    /// Lower end of the 95 % interval.
    pub low: f64,
    /// Upper end of the 95 % interval.
    pub high: f64,
}

impl Share {
    /// The share with its exact interval, which contains the true probability in at least 95 % of experiments.
    ///
    /// low is the p for which `hits` or more have probability 2.5 %, high the p for which `hits` or fewer have it.
    ///
    /// **Source:** Clopper & Pearson 1934.
    pub fn of(hits: usize, samples: usize) -> Self {
        let (k, n) = (hits as f64, samples as f64);
        let quantile = |a: f64, b: f64, p: f64| Beta::new(a, b).ok().map(|beta| beta.inverse_cdf(p));
        let low = quantile(k, n - k + 1.0, 0.025).filter(|_| hits > 0).unwrap_or(0.0);
        let high = quantile(k + 1.0, n - k, 0.975).filter(|_| hits < samples).unwrap_or(1.0);
        let estimate = if samples > 0 { k / n } else { 0.0 };
        Self { hits, samples, estimate, low, high }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_is_that_of_the_tables() {
        // Clopper & Pearson's chart and closed forms for 0 hits: 1 − 0.025^(1/n)
        let none = Share::of(0, 1000);
        assert!((none.high - (1.0 - 0.025f64.powf(1e-3))).abs() < 1e-9 && none.low == 0.0);
        let all = Share::of(50, 50);
        assert!((all.low - 0.025f64.powf(0.02)).abs() < 1e-9 && all.high == 1.0);
        let some = Share::of(10, 100);
        assert!((some.low - 0.049_005).abs() < 1e-5 && (some.high - 0.176_223).abs() < 1e-5, "{some:?}");
        assert_eq!(Share::of(0, 0).high, 1.0);
    }
}
