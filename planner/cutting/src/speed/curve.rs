//! A cap that depends on distance.

/// What is allowed by distance: piecewise linear, constant beyond its ends.
#[derive(Debug, Clone, PartialEq)]
pub struct DistanceCurve(Vec<[f64; 2]>);

impl DistanceCurve {
    /// Points [x, y]; x ascending, y ≥ 0 and not falling with x: farther away more is allowed.
    ///
    /// None without points, for x that does not ascend, and for y below 0 or below the one before.
    pub fn new(points: &[[f64; 2]]) -> Option<Self> {
        let mut before = [f64::NEG_INFINITY, 0.0];
        for &[x, y] in points {
            let is_next = x.is_finite() && y.is_finite() && x > before[0] && y >= before[1];
            before = is_next.then_some([x, y])?;
        }
        (!points.is_empty()).then(|| Self(points.to_vec()))
    }

    /// The points.
    pub fn points(&self) -> &[[f64; 2]] {
        &self.0
    }

    /// The value at x.
    pub fn at(&self, x: f64) -> f64 {
        let after = self.0.partition_point(|p| p[0] <= x);
        match (after.checked_sub(1).and_then(|n| self.0.get(n)), self.0.get(after)) {
            (Some([x0, y0]), Some([x1, y1])) => y0 + (y1 - y0) * (x - x0) / (x1 - x0),
            (Some([_, y]), None) | (None, Some([_, y])) => *y,
            (None, None) => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_is_constant_beyond_its_ends() {
        let curve = DistanceCurve::new(&[[1.0, 0.2], [3.0, 1.0]]).unwrap();
        assert_eq!([0.0, 1.0, 3.0, 9.0].map(|x| curve.at(x)), [0.2, 0.2, 1.0, 1.0]);
        assert!((curve.at(2.0) - 0.6).abs() < 1e-15);
        assert!(DistanceCurve::new(&[]).is_none() && DistanceCurve::new(&[[1.0, -0.1]]).is_none());
        assert!(
            DistanceCurve::new(&[[1.0, 0.5], [1.0, 0.6]]).is_none()
                && DistanceCurve::new(&[[1.0, 0.5], [2.0, 0.4]]).is_none()
        );
    }
}
