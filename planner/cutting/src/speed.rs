//! How fast the burr goes: Dillon's equation (13), its range, its smoothing, and its scaling to a given time.
//!
//! ```text
//! v_i = k_vel (1 − C_i)/m_i, clamped to [v_min, v_max]; v_max where m_i ≤ m_min
//! ```
//!
//! k_vel puts the mean of the unclamped values at the middle of the range, or makes the whole take a given time. The range
//! holds after smoothing, which only mixes values within it.

mod caps;
mod crossing;
mod curve;
mod cut_moves;
mod levels;
mod limited;

pub use caps::{Cap, CappedBurr, ForceCaps};
pub use crossing::last_within;
pub use curve::DistanceCurve;
pub use cut_moves::{CutMoves, SLOWEST_SKIN};
pub use levels::{CutPushes, Levels, TimeLimit, least_along, least_levels};
pub use limited::{LimitedProfile, fastest_profile};

use crate::burr::ModelError;
use crate::burr::checked;

/// The moving average's weights: two points either side.
const WINDOW: [f64; 5] = [1.0, 2.0, 3.0, 2.0, 1.0];
/// Points either side.
const HALF: usize = WINDOW.len() / 2;

/// How commanded speeds are calmed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Smoothing {
    /// A weighted moving average, 1 2 3 2 1, truncated and renormalised at the ends: as the paper says. It raises the speed
    /// where the burr enters bone.
    Average,
    /// The minimum over the same window, then the average: never above what (13) allows at a point, so that the burr has
    /// slowed down before it enters bone.
    MinimumThenAverage,
}

/// The speed law of (13).
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedModel {
    min_mm_s: f64,
    max_mm_s: f64,
    air_mass_mg: f64,
    smoothing: Smoothing,
}

/// Speeds of the points of a path.
#[derive(Debug, Clone, PartialEq)]
pub struct SpeedProfile {
    /// k_vel, mg mm/s; `None` where nothing is cut and it has no meaning.
    pub k_vel: Option<f64>,
    /// What (13) gives within the range, mm/s.
    pub clamped_mm_s: Vec<f64>,
    /// The same, smoothed: what is commanded, mm/s.
    pub speed_mm_s: Vec<f64>,
}

impl SpeedProfile {
    /// Time for the lengths of the moves that end at the points: Σ Δs/v, s.
    pub fn time_s(&self, lengths_mm: &[f64]) -> f64 {
        lengths_mm.iter().zip(&self.speed_mm_s).map(|(ds, v)| ds / v).sum()
    }
}

impl SpeedModel {
    /// A range and what counts as air: at or below `air_mass_mg` the burr goes at the upper end.
    ///
    /// # Errors
    /// [`ModelError::OutOfRange`] unless 0 < min ≤ max and the mass is ≥ 0.
    pub fn new(
        min_mm_s: f64,
        max_mm_s: f64,
        air_mass_mg: f64,
        smoothing: Smoothing,
    ) -> Result<Self, ModelError> {
        checked("least speed, mm/s", min_mm_s, |v| v > 0.0, "positive")?;
        checked("greatest speed, mm/s", max_mm_s, |v| v >= min_mm_s, "at least the least speed")?;
        checked("mass of air, mg", air_mass_mg, |m| m >= 0.0, "0 or more")?;
        Ok(Self { min_mm_s, max_mm_s, air_mass_mg, smoothing })
    }

    /// Speeds whose mean, before clamping and over the points that cut, is the middle of the range.
    ///
    /// `mass_mg` is m_i (of equally spaced points; else give m_i/Δs_i), `cost` is C_i in [0, 1].
    ///
    /// # Errors
    /// [`ModelError`] when the lists differ in length, or a value is not finite or out of range.
    ///
    /// **Source:** Dillon et al. 2016, equation (13); resolutions 14–16 of docs/force-model.md 8.
    pub fn centred(&self, mass_mg: &[f64], cost: &[f64]) -> Result<SpeedProfile, ModelError> {
        let ratios = self.ratios(mass_mg, cost)?;
        let (count, sum) = ratios.iter().flatten().fold((0, 0.0), |(n, s), ratio| (n + 1, s + ratio));
        if count == 0 {
            return Ok(self.profile(None, &ratios));
        }
        let mean = sum / f64::from(count);
        // with C = 1 everywhere no factor lifts any speed off the least one
        let k_vel = if mean > 0.0 { 0.5 * (self.min_mm_s + self.max_mm_s) / mean } else { 0.0 };
        Ok(self.profile(Some(k_vel), &ratios))
    }

    /// The shortest and the longest time that the moves can take within the range, s.
    ///
    /// # Errors
    /// As [`Self::centred`], and for lengths that are negative or not one per waypoint.
    pub fn time_range_s(
        &self,
        mass_mg: &[f64],
        cost: &[f64],
        lengths_mm: &[f64],
    ) -> Result<[f64; 2], ModelError> {
        let ratios = self.ratios(mass_mg, cost)?;
        same_length("move lengths", mass_mg.len(), lengths_mm.len())?;
        for &ds in lengths_mm {
            checked("length of a move, mm", ds, |ds| ds >= 0.0, "0 or more")?;
        }
        let time_s = |k: f64| self.profile(Some(k), &ratios).time_s(lengths_mm);
        Ok([time_s(self.fastest_factor(&ratios)), time_s(0.0)])
    }

    /// A factor that lifts everything to the upper end; 1 where nothing can be lifted.
    fn fastest_factor(&self, ratios: &[Option<f64>]) -> f64 {
        let least = ratios.iter().flatten().copied().filter(|&r| r > 0.0).fold(f64::INFINITY, f64::min);
        if least.is_finite() { self.max_mm_s / least } else { 1.0 }
    }

    /// Speeds that take `total_s` in all for the lengths `lengths_mm` of the moves that end at the points, after clamping
    /// and smoothing.
    ///
    /// # Errors
    /// As [`Self::centred`], and [`ModelError::TimeOutOfReach`] with the times that can be met.
    ///
    /// **Source:** Dillon et al. 2016, section III; resolution 14 of docs/force-model.md 8.
    pub fn in_time(
        &self,
        mass_mg: &[f64],
        cost: &[f64],
        lengths_mm: &[f64],
        total_s: f64,
    ) -> Result<SpeedProfile, ModelError> {
        let ratios = self.ratios(mass_mg, cost)?;
        checked("total time, s", total_s, |t| t > 0.0, "positive")?;
        let [shortest_s, longest_s] = self.time_range_s(mass_mg, cost, lengths_mm)?;
        let at = |k: f64| self.profile(Some(k), &ratios);
        let (mut low, mut high) = (0.0, self.fastest_factor(&ratios));
        let slack = 1e-9 * total_s;
        if total_s < shortest_s - slack || total_s > longest_s + slack {
            return Err(ModelError::TimeOutOfReach { requested_s: total_s, shortest_s, longest_s });
        }
        // time falls with k; until the last bit
        for _ in 0..1100 {
            let middle = 0.5 * (low + high);
            if middle <= low || middle >= high {
                break;
            }
            if at(middle).time_s(lengths_mm) > total_s {
                low = middle;
            } else {
                high = middle;
            }
        }
        let k_vel = ratios.iter().any(Option::is_some).then_some(high);
        Ok(SpeedProfile { k_vel, ..at(high) })
    }

    /// (1 − C)/m of the points that cut, `None` in air.
    fn ratios(&self, mass_mg: &[f64], cost: &[f64]) -> Result<Vec<Option<f64>>, ModelError> {
        same_length("cost", mass_mg.len(), cost.len())?;
        let ratio = |(&m, &c): (&f64, &f64)| {
            checked("mass, mg", m, |m| m >= 0.0, "0 or more")?;
            // a cost may miss its range by rounding
            let c = checked("cost", c, |c| (-1e-9..=1.0 + 1e-9).contains(&c), "0 to 1")?.clamp(0.0, 1.0);
            Ok((m > self.air_mass_mg).then(|| (1.0 - c) / m))
        };
        mass_mg.iter().zip(cost).map(ratio).collect()
    }

    fn profile(&self, k_vel: Option<f64>, ratios: &[Option<f64>]) -> SpeedProfile {
        let speed = |ratio: &Option<f64>| match (ratio, k_vel) {
            (Some(ratio), Some(k)) => (k * ratio).clamp(self.min_mm_s, self.max_mm_s),
            _ => self.max_mm_s,
        };
        let clamped_mm_s: Vec<f64> = ratios.iter().map(speed).collect();
        let speed_mm_s = self.smoothing.apply(&clamped_mm_s);
        SpeedProfile { k_vel, clamped_mm_s, speed_mm_s }
    }
}

impl Smoothing {
    /// The smoothed speeds; every one lies between the least and the greatest of its window.
    pub fn apply(self, speeds: &[f64]) -> Vec<f64> {
        match self {
            Self::Average => averaged(speeds),
            Self::MinimumThenAverage => averaged(&minima(speeds)),
        }
    }
}

/// The part of `values` within [`HALF`] of `i`, and where it begins in the window.
fn around(values: &[f64], i: usize) -> (&[f64], usize) {
    let (low, high) = (i.saturating_sub(HALF), (i + HALF + 1).min(values.len()));
    (&values[low..high], low + HALF - i)
}

fn minima(values: &[f64]) -> Vec<f64> {
    let least = |i| around(values, i).0.iter().copied().fold(f64::INFINITY, f64::min);
    (0..values.len()).map(least).collect()
}

fn averaged(values: &[f64]) -> Vec<f64> {
    let average = |i| {
        let (near, skip) = around(values, i);
        let (sum, weight) =
            near.iter().zip(&WINDOW[skip..]).fold((0.0, 0.0), |(s, total), (v, w)| (s + w * v, total + w));
        // a mean of rounded products may miss its range by an ulp; the range is a promise
        let (least, most) = near.iter().fold((f64::INFINITY, 0f64), |(a, b), &v| (a.min(v), b.max(v)));
        (sum / weight).clamp(least, most)
    };
    (0..values.len()).map(average).collect()
}

fn same_length(name: &'static str, expected: usize, found: usize) -> Result<(), ModelError> {
    if expected == found { Ok(()) } else { Err(ModelError::Length { name, expected, found }) }
}

#[cfg(test)]
mod tests;
