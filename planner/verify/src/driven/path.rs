//! The burr's path as it is driven: the trajectory's rows as straight pieces, and the steps along them at which the force is
//! computed.
//!
//! A piece replaces the rows between its ends if all of them lie within [`THIN_MM`] of it. Where the trajectory rounds a corner,
//! pieces are short. A step is a part of a piece, with the time that the burr takes for it and its speeds there. The force is
//! computed at its end, so that a force that begins within it is found.

use bonemill_geometry::cancel;
use nalgebra::Vector3;

use super::super::carve::MoveSegment;
use super::super::moves::Executed;

/// Largest distance of a row from its piece, mm.
pub const THIN_MM: f64 = 0.0005;
/// Longest piece, mm.
const LONGEST_MM: f64 = 2.0;
/// Longest step, mm.
const STEP_MM: f64 = 0.05;
/// Largest number of steps of a piece: more than the longest has, unless two rows are far apart.
const MOST_STEPS: usize = 1000;
/// A piece shorter than this is rounding of the joints: the burr is at rest, mm.
const AT_REST_MM: f64 = 1e-6;

/// The driven path.
#[derive(Debug, Default)]
pub struct DrivenPath {
    /// Its pieces in the order of time; each one's number is its index.
    pub pieces: Vec<MoveSegment>,
    /// The steps in the order of time.
    pub steps: Vec<PieceStep>,
}

/// A part of a piece.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PieceStep {
    /// The index of its piece.
    pub piece: u32,
    /// The burr's centre at its end, mm in work.
    pub center: Vector3<f64>,
    /// Unit direction of the burr's motion.
    pub direction: Vector3<f64>,
    /// The last row of the trajectory before its end, and before its middle.
    pub row: usize,
    pub middle_row: usize,
    /// When it ends, s.
    pub end_s: f64,
    /// The time that it takes, s.
    pub took_s: f64,
    /// Mean speed, mm/s.
    pub mean_mm_s: f64,
    /// Speed at its end, from row to row, mm/s.
    pub end_mm_s: f64,
}

impl DrivenPath {
    /// The path through the rows of a trajectory, which are at `time_s`.
    pub fn new(executed: &Executed, time_s: &[f64]) -> Self {
        let points = &executed.points;
        let mut path = Self::default();
        // the ball at the start
        path.pieces.extend(points.first().map(|p| MoveSegment { a: *p, b: *p, number: 0 }));
        let mut first = 0;
        while first + 1 < points.len() {
            cancel::poll();
            let last = farthest(points, first);
            path.push(first, &points[first..=last], &time_s[first..=last]);
            first = last;
        }
        path
    }

    /// Adds a piece from the first to the last of `points`, and its steps. `row`: the first point's row.
    fn push(&mut self, row: usize, points: &[Vector3<f64>], time_s: &[f64]) {
        let (Some(a), Some(b)) = (points.first(), points.last()) else { return };
        let length_mm = (b - a).norm();
        // also false for what is not a number
        if !(AT_REST_MM..f64::INFINITY).contains(&length_mm) {
            return;
        }
        let piece = self.pieces.len() as u32;
        self.pieces.push(MoveSegment { a: *a, b: *b, number: piece });
        let direction = (b - a) / length_mm;
        // 1e-9: rounding must not add a step
        let count = ((length_mm / STEP_MM - 1e-9).ceil() as usize).clamp(1, MOST_STEPS);
        let step_mm = length_mm / count as f64;
        let first = self.steps.len();
        self.steps.extend((0..count).map(|n| PieceStep {
            piece,
            center: a + direction * ((n + 1) as f64 * step_mm),
            direction,
            row,
            middle_row: row,
            end_s: 0.0,
            took_s: 0.0,
            mean_mm_s: 0.0,
            end_mm_s: 0.0,
        }));
        let steps = &mut self.steps[first..];
        let step_at = |mm: f64| ((mm / step_mm) as usize).min(count - 1);
        // the way along the piece to each row never falls
        let mut from_mm = 0.0;
        for n in 1..points.len() {
            let to_mm = (points[n] - a).dot(&direction).clamp(from_mm, length_mm);
            let took_s = time_s[n] - time_s[n - 1];
            let speed_mm_s = (points[n] - points[n - 1]).norm() / took_s;
            let way = RowWay { from_mm, to_mm, from_s: time_s[n - 1], took_s, speed_mm_s, row: row + n };
            let passed = step_at(from_mm)..=step_at(to_mm);
            for (at, step) in passed.clone().zip(&mut steps[passed]) {
                step.add(&way, [at as f64 * step_mm, (at + 1) as f64 * step_mm]);
            }
            from_mm = to_mm;
        }
        for step in steps {
            step.mean_mm_s = if step.took_s > 0.0 { step_mm / step.took_s } else { 0.0 };
        }
    }
}

/// The way along a piece from one row to the next.
#[derive(Debug, Clone, Copy)]
struct RowWay {
    from_mm: f64,
    to_mm: f64,
    from_s: f64,
    took_s: f64,
    speed_mm_s: f64,
    /// The row at its end.
    row: usize,
}

impl PieceStep {
    /// Adds the part of a row's way that lies in the step, which is given by its start and end along the piece, mm.
    fn add(&mut self, way: &RowWay, [start_mm, end_mm]: [f64; 2]) {
        let on_mm = way.to_mm.min(end_mm) - way.from_mm.max(start_mm);
        let share = if way.to_mm > way.from_mm { on_mm / (way.to_mm - way.from_mm) } else { 1.0 };
        self.took_s += share * way.took_s;
        if on_mm > 0.0 {
            (self.end_mm_s, self.row) = (way.speed_mm_s, way.row - 1);
            let gone = (way.to_mm.min(end_mm) - way.from_mm) / (way.to_mm - way.from_mm);
            self.end_s = way.from_s + gone * way.took_s;
        }
        let middle_mm = 0.5 * (start_mm + end_mm);
        if way.from_mm <= middle_mm {
            self.middle_row = if way.to_mm <= middle_mm { way.row } else { way.row - 1 };
        }
    }
}

/// The last row that a piece from row `first` can reach.
fn farthest(points: &[Vector3<f64>], first: usize) -> usize {
    let fits = |last: usize| last < points.len() && is_straight(&points[first..=last]);
    let (mut last, mut by) = (first + 1, 1);
    while fits(last + by) {
        last += by;
        by *= 2;
    }
    while by > 1 {
        by /= 2;
        if fits(last + by) {
            last += by;
        }
    }
    last
}

/// Whether all points lie near the straight line from the first to the last, and none goes back on it.
fn is_straight(points: &[Vector3<f64>]) -> bool {
    let (Some(a), Some(b)) = (points.first(), points.last()) else { return true };
    let length_mm = (b - a).norm();
    if length_mm > LONGEST_MM {
        return false;
    }
    let direction = if length_mm > 0.0 { (b - a) / length_mm } else { Vector3::zeros() };
    let mut most_mm = 0.0;
    points.iter().all(|p| {
        let along_mm = (p - a).dot(&direction);
        most_mm = f64::max(most_mm, along_mm);
        let off2 = (p - a - direction * along_mm).norm_squared();
        off2 <= THIN_MM * THIN_MM && along_mm >= most_mm - THIN_MM && along_mm <= length_mm + THIN_MM
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A burr that goes 3 mm along x, rests, and goes 2 mm along y, with a rounded corner of 0.1 mm.
    fn rounded() -> (Executed, Vec<f64>) {
        let mut points = Vec::new();
        let turn = std::f64::consts::FRAC_PI_2;
        points.extend((0..500).map(|n| Vector3::new(2.9 * f64::from(n) / 500.0, 0.0, 0.0)));
        points.extend((0..=50).map(|n| {
            let angle = turn * f64::from(n) / 50.0;
            Vector3::new(2.9 + 0.1 * angle.sin(), 0.1 - 0.1 * angle.cos(), 0.0)
        }));
        points.extend([Vector3::new(3.0, 0.1, 0.0); 20]);
        points.extend((1..=200).map(|n| Vector3::new(3.0, 0.1 + 1.9 * f64::from(n) / 200.0, 0.0)));
        let time_s = (0..points.len()).map(|n| n as f64 * 0.002).collect();
        let count = points.len();
        (Executed { points, axes: vec![Vector3::z(); count], next: vec![0; count] }, time_s)
    }

    #[test]
    fn every_row_lies_near_the_pieces_and_every_second_is_in_a_step() {
        let (executed, time_s) = rounded();
        let path = DrivenPath::new(&executed, &time_s);
        for p in &executed.points {
            let off = path.pieces.iter().map(|piece| piece.squared(p).sqrt()).fold(f64::INFINITY, f64::min);
            assert!(off <= THIN_MM + 1e-12, "{off}");
        }
        assert!(path.pieces.len() < 20, "{}", path.pieces.len());
        let whole: f64 = path.steps.iter().map(|s| s.took_s).sum();
        assert!((whole - time_s[time_s.len() - 1]).abs() < 1e-9, "{whole}");
        let way: f64 = path.steps.iter().map(|s| s.took_s * s.mean_mm_s).sum();
        assert!((way - (2.9 + 0.05 * std::f64::consts::PI + 1.9)).abs() < 0.003, "{way}");
        // 2.9 mm in 500 rows of 2 ms
        assert!((path.steps[5].end_mm_s - 2.9).abs() < 1e-9 && (path.steps[5].mean_mm_s - 2.9).abs() < 1e-9);
        let far = |s: &PieceStep| (executed.points[s.row] - s.center).norm();
        assert!(
            path.steps.iter().all(|s| far(s) < 0.06),
            "{:?}",
            path.steps.iter().map(far).reduce(f64::max)
        );
    }

    #[test]
    fn steps_between_distant_rows_have_the_row_before() {
        let points: Vec<_> = (0..4).map(|n| Vector3::new(0.4 * f64::from(n), 0.0, 0.0)).collect();
        let executed = Executed { points, axes: vec![Vector3::z(); 4], next: vec![0; 4] };
        let path = DrivenPath::new(&executed, &[0.0, 0.1, 0.2, 0.3]);
        assert_eq!(path.steps.len(), 24);
        for step in &path.steps {
            let before =
                [(step.middle_row, 0.025), (step.row, 0.0)].map(|(row, mm)| executed.points[row].x + mm);
            assert!(before.iter().all(|x| (0.0..=0.4 + 1e-9).contains(&(step.center.x - x))), "{step:?}");
            assert!((step.end_mm_s - 4.0).abs() < 1e-9 && (step.took_s - 0.0125).abs() < 1e-9);
            assert!((step.end_s - 0.25 * step.center.x).abs() < 1e-9, "{step:?}");
        }
    }

    #[test]
    fn a_way_back_is_a_piece_of_its_own() {
        let there = |n: i32| Vector3::new(0.01 * f64::from(n), 0.0, 0.0);
        let points: Vec<_> = (0..=60).chain((0..60).rev()).map(there).collect();
        let time_s: Vec<_> = (0..points.len()).map(|n| n as f64 * 0.01).collect();
        let count = points.len();
        let executed = Executed { points, axes: vec![Vector3::z(); count], next: vec![0; count] };
        let path = DrivenPath::new(&executed, &time_s);
        assert_eq!(path.pieces.len(), 3);
        assert!(path.steps[0].direction.x > 0.9 && path.steps[path.steps.len() - 1].direction.x < -0.9);
    }
}
