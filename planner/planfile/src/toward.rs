//! Force toward a structure over time: mean, 75th percentile, peak and its place.
//!
//! Plans, simulations, reports and comparisons use this one definition. Only the time of moves that remove material counts. A
//! force that points away from the structure counts as 0. Dillon et al. 2016 give means over the time in which the force
//! points toward the structure (F_v > 0) while the burr's surface is within 2 mm of it; here each figure is also given over
//! the whole time, zeros included.

use crate::Value;

/// A burr whose surface is within this distance of a structure is near it, mm.
///
/// **Source:** Dillon et al. 2016, the radius of interest of its trials.
pub const NEAR_MM: f64 = 2.0;

/// A structure is within its influence where the burr's surface is nearer to it than its clearance and this, mm. Beyond, α_1 is below
/// 0.004 with the default κ.
pub const INFLUENCE_MM: f64 = 8.0;

/// One move that removes material within the influence of a structure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TowardSpan {
    /// Duration of the move, s.
    pub seconds: f64,
    /// Force toward the structure in the mean over the move, N; 0 if it points away.
    pub force_n: f64,
    /// Largest force toward the structure within the move, N.
    pub peak_n: f64,
    /// The row of the move: a waypoint, or a pose of a simulation.
    pub row: usize,
}

/// Statistics of the force toward a structure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TowardFigures {
    /// Duration of the moves that count, s.
    pub seconds: f64,
    /// Mean over the time in which it points toward the structure (F_v > 0), N.
    pub mean_n: f64,
    /// Mean over all of this time, N.
    pub mean_with_zeros_n: f64,
    /// 75th percentile over the time in which it points toward the structure, N.
    pub p75_n: f64,
    /// 75th percentile over all of this time, N.
    pub p75_with_zeros_n: f64,
    /// The largest force, N.
    pub peak_n: f64,
    /// The row of the largest force, the first of equals; `None` where no force points toward the structure.
    pub peak_row: Option<usize>,
}

impl TowardFigures {
    /// The statistics of moves, in the order of their rows.
    pub fn of(spans: &[TowardSpan]) -> Self {
        let toward: Vec<TowardSpan> = spans.iter().copied().filter(|s| s.force_n > 0.0).collect();
        let higher = |a: TowardSpan, b: &TowardSpan| if b.peak_n > a.peak_n { *b } else { a };
        let pushing = spans.iter().filter(|s| s.peak_n > 0.0);
        let peak = pushing.fold(None, |peak, s| Some(peak.map_or(*s, |peak| higher(peak, s))));
        Self {
            seconds: spans.iter().map(|s| s.seconds).sum(),
            mean_n: mean_n(&toward),
            mean_with_zeros_n: mean_n(spans),
            p75_n: quantile_n(toward, 0.75),
            p75_with_zeros_n: quantile_n(spans.to_vec(), 0.75),
            peak_n: peak.map_or(0.0, |s: TowardSpan| s.peak_n),
            peak_row: peak.map(|s| s.row),
        }
    }

    /// Names and values for files; `row` is the word for a row, e.g. `waypoint`.
    pub fn entries(&self, row: &str) -> Vec<(String, Value)> {
        let mut entries: Vec<(String, Value)> = [
            ("mean_force_toward_n", self.mean_n),
            ("mean_force_toward_with_zeros_n", self.mean_with_zeros_n),
            ("p75_force_toward_n", self.p75_n),
            ("p75_force_toward_with_zeros_n", self.p75_with_zeros_n),
            ("peak_force_toward_n", self.peak_n),
        ]
        .map(|(name, value)| (name.to_owned(), value.into()))
        .into();
        entries.extend(self.peak_row.map(|n| (format!("peak_force_toward_{row}"), n.into())));
        entries.push(("cutting_s".into(), self.seconds.into()));
        entries
    }
}

/// Mean weighted by time, N; 0 if the total time is 0.
fn mean_n(spans: &[TowardSpan]) -> f64 {
    let (sum, seconds) =
        spans.iter().fold((0.0, 0.0), |(sum, time), s| (sum + s.force_n * s.seconds, time + s.seconds));
    if seconds > 0.0 { sum / seconds } else { 0.0 }
}

/// The force that is not exceeded during the share `q` of the time, N; 0 if the total time is 0.
fn quantile_n(mut spans: Vec<TowardSpan>, q: f64) -> f64 {
    spans.sort_by(|a, b| a.force_n.total_cmp(&b.force_n));
    let wanted = q * spans.iter().map(|s| s.seconds).sum::<f64>();
    let mut below = 0.0;
    for span in &spans {
        below += span.seconds;
        if below >= wanted {
            return span.force_n;
        }
    }
    0.0
}

/// One structure's figures over a plan or a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StructureFigures {
    /// Least distance of the burr's surface over all rows, mm, and its row; `None` where the structure is far from all of them.
    pub least: Option<(f64, usize)>,
    /// Force toward the structure while the burr is within its influence.
    pub force: TowardFigures,
    /// Force toward the structure while the burr's surface is within [`NEAR_MM`] of it.
    pub near: TowardFigures,
}

impl StructureFigures {
    /// The figures of moves, each with the distance of the burr's centre, mm, and of their least one, for a burr of this radius and the
    /// structure's clearance.
    pub fn of(
        least: Option<(f64, usize)>,
        spans: &[(TowardSpan, f64)],
        [radius_mm, clearance_mm]: [f64; 2],
    ) -> Self {
        let within = |most_mm: f64| -> Vec<TowardSpan> {
            spans.iter().filter(|(_, mm)| mm - radius_mm <= most_mm).map(|(span, _)| *span).collect()
        };
        Self {
            least: least.map(|(center_mm, row)| (center_mm - radius_mm, row)),
            force: TowardFigures::of(&within(clearance_mm + INFLUENCE_MM)),
            near: TowardFigures::of(&within(NEAR_MM)),
        }
    }

    /// Names and values for files; `row` is the word for a row.
    pub fn value(&self, row: &str) -> Value {
        let mut entries: Vec<(String, Value)> = Vec::new();
        if let Some((surface_mm, at)) = self.least {
            entries.push(("least_surface_distance_mm".into(), surface_mm.into()));
            entries.push((format!("least_surface_distance_{row}"), at.into()));
        }
        entries.extend(self.force.entries(row));
        entries.push(("near".into(), Value::Table(self.near.entries(row))));
        Value::Table(entries)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(seconds: f64, force_n: f64, row: usize) -> TowardSpan {
        TowardSpan { seconds, force_n, peak_n: force_n, row }
    }

    #[test]
    fn time_is_the_weight_and_zeros_are_told_apart() {
        let spans = [span(1.0, 0.4, 3), span(3.0, 0.8, 4), span(4.0, 0.0, 5), span(0.0, 0.8, 6)];
        let found = TowardFigures::of(&spans);
        assert!((found.mean_n - 0.7).abs() < 1e-12 && (found.mean_with_zeros_n - 0.35).abs() < 1e-12);
        assert_eq!((found.p75_n, found.p75_with_zeros_n), (0.8, 0.8));
        assert_eq!((found.seconds, found.peak_n, found.peak_row), (8.0, 0.8, Some(4)));
        assert_eq!(TowardFigures::of(&[]), TowardFigures::default());
        let away = TowardFigures::of(&[span(2.0, 0.0, 0)]);
        assert_eq!((away.seconds, away.peak_n, away.peak_row), (2.0, 0.0, None));
    }

    #[test]
    fn near_is_judged_by_the_burrs_surface() {
        let mut moves = vec![(span(1.0, 0.2, 0), 4.5), (span(1.0, 0.5, 1), 4.51), (span(1.0, 0.1, 2), 3.0)];
        // beyond its influence
        moves.push((span(1.0, 0.9, 3), 11.51));
        let found = StructureFigures::of(Some((3.0, 2)), &moves, [2.5, 1.0]);
        assert_eq!((found.force.peak_n, found.force.peak_row, found.force.seconds), (0.5, Some(1), 3.0));
        assert_eq!((found.near.peak_n, found.near.peak_row, found.near.seconds), (0.2, Some(0), 2.0));
        let Value::Table(entries) = found.value("waypoint") else { panic!() };
        let names: Vec<&str> = entries.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names[..2], ["least_surface_distance_mm", "least_surface_distance_waypoint"]);
        assert_eq!(entries[0].1, Value::Number(0.5));
        assert!(names.contains(&"peak_force_toward_waypoint") && names.last() == Some(&"near"));
    }
}
