//! Convex hull in the plane (Andrew's monotone chain), and the smallest rectangle around it.

/// Corners of the hull, counter-clockwise, without repeats; collinear points are left out.
pub(super) fn convex_hull(mut points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    points.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
    points.dedup();
    if points.len() < 3 {
        return points;
    }
    let mut lower = half_hull(points.iter().copied());
    let mut upper = half_hull(points.iter().rev().copied());
    lower.pop();
    upper.pop();
    lower.append(&mut upper);
    lower
}

/// One side of the hull of points sorted along x.
fn half_hull(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for p in points {
        while let [.., a, b] = chain.as_slice() {
            let left = (b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]);
            if left > 0.0 {
                break;
            }
            chain.pop();
        }
        chain.push(p);
    }
    chain
}

/// A rectangle in the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rectangle {
    /// Unit direction of one side.
    pub side: [f64; 2],
    /// Length of that side.
    pub along: f64,
    /// Length of the other.
    pub across: f64,
}

/// The rectangle of least area around a convex hull (corners counter-clockwise); it shares a side with one of the hull's.
/// `None` for a hull without extent.
pub fn smallest_rectangle(hull: &[[f64; 2]]) -> Option<Rectangle> {
    let mut best: Option<Rectangle> = None;
    for n in 0..hull.len() {
        let (a, b) = (hull[n], hull[(n + 1) % hull.len()]);
        let length = (b[0] - a[0]).hypot(b[1] - a[1]);
        if length < 1e-9 {
            continue;
        }
        let side = [(b[0] - a[0]) / length, (b[1] - a[1]) / length];
        let found = Rectangle { side, along: extent(hull, side), across: extent(hull, [-side[1], side[0]]) };
        // a later side must be better by more than rounding, so that the first of equal sides wins
        if best.is_none_or(|best| found.along * found.across < best.along * best.across * (1.0 - 1e-9)) {
            best = Some(found);
        }
    }
    best
}

fn extent(hull: &[[f64; 2]], axis: [f64; 2]) -> f64 {
    let (lo, hi) = hull
        .iter()
        .map(|p| p[0] * axis[0] + p[1] * axis[1])
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), d| (lo.min(d), hi.max(d)));
    hi - lo
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holds_every_point_and_turns_left_only() {
        let points: Vec<[f64; 2]> = (0..500)
            .map(|n| [f64::from(n * 37 % 101), f64::from(n * 53 % 89) + 0.25 * f64::from(n % 7)])
            .collect();
        let hull = convex_hull(points.clone());
        assert!(hull.len() >= 4);
        for n in 0..hull.len() {
            let (a, b) = (hull[n], hull[(n + 1) % hull.len()]);
            for p in &points {
                assert!((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) >= -1e-9);
            }
        }
    }

    #[test]
    fn a_square_with_points_inside_and_on_its_sides_has_four_corners() {
        let points = (0..25).map(|n| [f64::from(n % 5), f64::from(n / 5)]).collect();
        assert_eq!(convex_hull(points), vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]]);
    }

    #[test]
    fn fewer_than_three_points_stay() {
        assert_eq!(convex_hull(vec![[1.0, 2.0], [1.0, 2.0]]), vec![[1.0, 2.0]]);
    }

    #[test]
    fn the_smallest_rectangle_lies_along_a_turned_bar() {
        let (s, c) = 0.4f64.sin_cos();
        let bar =
            [[0.0, 0.0], [8.0, 0.0], [8.0, 2.0], [0.0, 2.0]].map(|[x, y]| [c * x - s * y, s * x + c * y]);
        let found = smallest_rectangle(&bar).unwrap();
        let (long, short) = (found.along.max(found.across), found.along.min(found.across));
        assert!((long - 8.0).abs() < 1e-12 && (short - 2.0).abs() < 1e-12, "{found:?}");
        assert_eq!(smallest_rectangle(&[[1.0, 1.0]]), None);
    }
}
