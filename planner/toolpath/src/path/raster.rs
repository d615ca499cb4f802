//! Direction and order of the lines in a layer, and the sense in which each is cut.

use crate::scene::{Rectangle, smallest_rectangle};
use bonemill_geometry::{Point, Work};

use super::Builder;

/// Rectangles whose sides differ by less than this share count as squares.
const SQUARE: f64 = 0.02;

/// Below this cosine two directions count as perpendicular.
const ACROSS: f64 = 0.05;

/// Decides for the next pass whether it is cut from its last point; `None` if both senses are equally good.
pub type SenseRule<'a> = &'a (dyn Fn(&Builder, &[Point<Work>]) -> Option<bool> + Sync);

/// The lines of a path.
#[derive(Clone, Copy)]
pub struct Lines<'a> {
    /// Direction and order of the lines.
    pub frame: RasterFrame,
    /// The sense in which they are cut.
    pub sense: SenseRule<'a>,
}

impl Lines<'_> {
    /// Lines that are cut from the nearer end.
    pub fn to_and_fro(frame: RasterFrame) -> Self {
        Self { frame, sense: &|_, _| None }
    }
}

/// A target whose centre of mass is this near to the middle of its outline, mm, is symmetric.
const SYMMETRIC: f64 = 1e-4;

/// In-plane axes of the lawnmower: lines run along u and follow each other along v.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RasterFrame {
    u: [f64; 2],
    v: [f64; 2],
}

impl RasterFrame {
    /// Lines at `angle_rad` from work x towards work y.
    pub fn at_angle(angle_rad: f64) -> Self {
        let (s, c) = angle_rad.sin_cos();
        Self { u: [c, s], v: [-s, c] }
    }

    /// Lines along the long side of the smallest rectangle around the target's outline (fewest turns).
    ///
    /// `hull`: the outline's convex hull, counter-clockwise. `towards`: direction from the target's centre to the nearest
    /// structure; lines follow each other towards it, and in a square outline they run across it. `mass_center`: centre of mass
    /// of the target; it decides where the structure does not. All inputs come from the anatomy, so a mirrored or turned patient
    /// gets the mirrored or turned path.
    pub fn chosen(hull: &[[f64; 2]], towards: Option<[f64; 2]>, mass_center: [f64; 2]) -> Self {
        let Some(Rectangle { side, along, across }) = smallest_rectangle(hull) else {
            return Self::at_angle(0.0);
        };
        let other = [-side[1], side[0]];
        let middle = [side, other].map(|axis| middle(hull, axis));
        let lean = [0, 1].map(|a| mass_center[a] - middle[0] * side[a] - middle[1] * other[a]);
        let towards = towards.unwrap_or(lean);
        let is_square = (along - across).abs() <= SQUARE * along.max(across);
        let u = if is_square {
            if dot(side, towards).abs() <= dot(other, towards).abs() { side } else { other }
        } else if along > across {
            side
        } else {
            other
        };
        let v = [-u[1], u[0]];
        // a direction perpendicular to an axis does not decide the axis' sign; then it points to where more bone is
        let length = towards[0].hypot(towards[1]);
        let sign = |axis| if dot(axis, towards).abs() > ACROSS * length { towards } else { lean };
        Self { u: pointing(u, sign(u)), v: pointing(v, sign(v)) }
    }

    /// Lines along v that follow each other along u.
    #[must_use]
    pub fn across(&self) -> Self {
        Self { u: self.v, v: self.u }
    }

    /// (u, v) of a point, mm.
    pub fn uv(&self, p: Point<Work>) -> [f64; 2] {
        [dot(self.u, [p.x(), p.y()]), dot(self.v, [p.x(), p.y()])]
    }

    /// The point at (u, v) and height z, mm.
    pub fn point(&self, u: f64, v: f64, z: f64) -> Point<Work> {
        Point::new(self.u[0] * u + self.v[0] * v, self.u[1] * u + self.v[1] * v, z)
    }

    /// Angle of the lines from work x, rad in (−π/2, π/2].
    pub fn angle_rad(&self) -> f64 {
        let [x, y] = if self.u[0] < 0.0 || (self.u[0] == 0.0 && self.u[1] < 0.0) {
            [-self.u[0], -self.u[1]]
        } else {
            self.u
        };
        y.atan2(x)
    }
}

fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// The axis with the sign of `towards`; as it is where that decides nothing, in a symmetric target.
fn pointing(axis: [f64; 2], towards: [f64; 2]) -> [f64; 2] {
    if dot(axis, towards) < -SYMMETRIC { [-axis[0], -axis[1]] } else { axis }
}

/// The middle of an outline's extent along an axis.
fn middle(hull: &[[f64; 2]], axis: [f64; 2]) -> f64 {
    let along = hull.iter().map(|p| dot(*p, axis));
    0.5 * (along.clone().fold(f64::INFINITY, f64::min) + along.fold(f64::NEG_INFINITY, f64::max))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BAR: [[f64; 2]; 4] = [[0.0, 0.0], [8.0, 6.0], [6.5, 8.0], [-1.5, 2.0]];

    #[test]
    fn lines_run_along_the_long_side() {
        let f = RasterFrame::chosen(&BAR, Some([1.0, 0.0]), [3.0, 4.0]);
        assert!((f.angle_rad() - 0.6f64.asin()).abs() < 1e-12);
    }

    #[test]
    fn in_a_square_lines_run_across_the_way_to_the_structure_and_end_there() {
        let square = [[0.0, 0.0], [15.0, 0.0], [15.0, 15.0], [0.0, 15.0]];
        let f = RasterFrame::chosen(&square, Some([-1.0, 0.2]), [7.0, 7.0]);
        assert!((f.angle_rad().abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
        let at = |x, y| f.uv(Point::new(x, y, 0.0));
        assert!(at(0.0, 7.0)[1] > at(15.0, 7.0)[1], "the line nearest to the structure comes last");
    }

    #[test]
    fn a_mirrored_outline_gives_the_mirrored_frame() {
        let mirrored: Vec<[f64; 2]> = BAR.iter().rev().map(|p| [-p[0], p[1]]).collect();
        // the bar's long side is (0.8, 0.6); the second structure lies across it; without a structure the mass decides
        for towards in [Some([0.3, 0.7]), Some([-0.6, 0.8]), None] {
            let other = towards.map(|[x, y]: [f64; 2]| [-x, y]);
            let f = RasterFrame::chosen(&BAR, towards, [3.5, 4.4]);
            let m = RasterFrame::chosen(&mirrored, other, [-3.5, 4.4]);
            for (x, y) in [(1.0, 2.0), (-3.0, 0.5)] {
                let (a, b) = (f.uv(Point::new(x, y, 0.0)), m.uv(Point::new(-x, y, 0.0)));
                assert!((a[0] - b[0]).abs() < 1e-12 && (a[1] - b[1]).abs() < 1e-12);
            }
        }
    }

    /// A square's shape decides nothing, so the bone in it does.
    #[test]
    fn a_square_with_its_structure_across_an_axis_mirrors_too() {
        let square = [[0.0, 0.0], [15.0, 1e-13], [15.0, 15.0], [-1e-13, 15.0]];
        let mirrored: Vec<[f64; 2]> = square.iter().rev().map(|p| [15.0 - p[0], p[1]]).collect();
        let f = RasterFrame::chosen(&square, Some([0.0, 1.0]), [7.8, 7.4]);
        let m = RasterFrame::chosen(&mirrored, Some([0.0, 1.0]), [7.2, 7.4]);
        for (x, y) in [(1.0, 2.0), (9.0, 0.5)] {
            let (a, b) = (f.uv(Point::new(x - 7.5, y, 0.0)), m.uv(Point::new(7.5 - x, y, 0.0)));
            assert!((a[0] - b[0]).abs() < 1e-9 && (a[1] - b[1]).abs() < 1e-9, "{a:?} {b:?}");
        }
    }

    #[test]
    fn uv_and_point_are_inverse() {
        let f = RasterFrame::at_angle(0.7);
        let p = f.point(3.0, -2.0, 5.0);
        assert!((f.uv(p)[0] - 3.0).abs() < 1e-12 && (f.uv(p)[1] + 2.0).abs() < 1e-12 && p.z() == 5.0);
    }
}
