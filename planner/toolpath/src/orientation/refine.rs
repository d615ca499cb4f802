//! Refines the best sequence on the set of directions to a smooth one between them, without leaving free axes.
//!
//! Two guarantees hold, each by the access test itself rather than by conclusions from neighbours:
//! - the chosen turns are free between waypoints too: [`best_checked`] runs the dynamic program, tests the turns that it
//!   chose, forbids those that fail, and runs it again (few rounds, and only turns that are used are tested);
//! - the refined axis of every waypoint is free, and so is every refined turn: where one fails, its ends are reset to the
//!   set's directions, which are known to be free.
//!
//! Refinement minimises J, with C replaced within half a spacing of the chosen direction by the quadratic through the
//! neighbours' costs. It uses coordinate descent: the minimum over one waypoint's axis with fixed neighbours is a 2 × 2
//! system.

use bonemill_geometry::cancel;
use nalgebra::{Matrix2, Matrix3, Unit, UnitQuaternion, Vector2, Vector3};
use rayon::prelude::*;

use super::TiltFamily;
use super::sequence::{BestSequence, Forbidden, Problem, best_sequence};

/// Largest number of runs of the dynamic program; turns that still fail are then counted.
const MOST_ROUNDS: usize = 60;
/// Number of sweeps of coordinate descent. A few sweeps halve the error.
const SWEEPS: usize = 24;
/// Largest distance by which an axis is moved from its direction, spacings.
const TRUST: f64 = 0.5;
/// Shares of a displacement that are tried, one after the other, until the axis is free.
const RETREATS: [f64; 3] = [1.0, 0.5, 0.25];

/// A sequence whose turns were tested.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// The sequence, or the waypoint at which every sequence is blocked.
    pub found: BestSequence,
    /// Turns that were forbidden during the rounds.
    pub forbidden: Forbidden,
    /// Turns of the sequence that are still not free between waypoints.
    pub failing: Vec<usize>,
}

impl Checked {
    /// Whether a sequence was found whose turns are all free.
    pub fn is_free(&self) -> bool {
        self.failing.is_empty() && matches!(self.found, BestSequence::Sequence { .. })
    }
}

/// The best sequence whose turns are all free; `is_turn_free(i, from, to)` tests the turn during the move that ends at i.
///
/// `first`: the best sequence of `problem`. The problem's forbidden turns stay forbidden.
pub fn best_checked(
    problem: &Problem,
    first: BestSequence,
    is_turn_free: impl Fn(usize, u16, u16) -> bool + Sync,
) -> Checked {
    let mut forbidden: Forbidden = problem.forbidden.clone();
    let (mut found, mut last) = (first, None);
    for _ in 0..MOST_ROUNDS {
        let BestSequence::Sequence { directions, .. } = &found else { break };
        let failing: Vec<usize> = (1..directions.len())
            .into_par_iter()
            .filter(|i| {
                cancel::poll();
                !is_turn_free(*i, directions[*i - 1], directions[*i])
            })
            .collect();
        if failing.is_empty() {
            return Checked { found, forbidden, failing };
        }
        for i in &failing {
            forbidden.insert(*i, directions[*i - 1], directions[*i]);
        }
        last = Some((found, failing));
        found = best_sequence(&Problem { forbidden: &forbidden, ..*problem });
    }
    // every sequence has a failing turn: return the last sequence, with its failing turns
    let (found, failing) = last.unwrap_or((found, Vec::new()));
    Checked { found, forbidden, failing }
}

/// Coordinates of axes near a set's directions: an angle in a plane, or two tangent coordinates.
#[derive(Debug, Clone, Copy)]
pub enum Chart<'a> {
    /// In a family: the first coordinate is the change of its angle.
    Plane(&'a TiltFamily),
    /// On the sphere: coordinates along two tangents of the direction.
    Sphere,
}

/// A refined sequence.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// Axis of each waypoint.
    pub axes: Vec<Unit<Vector3<f64>>>,
    /// Angle of each waypoint in the family, rad; for a plane.
    pub angles_rad: Option<Vec<f64>>,
    /// Number of waypoints that kept, or were reset to, a direction of the set because the refined axis or turn was not free.
    pub held: usize,
}

/// Moves the axes of `sequence` off the set's directions so that J becomes less.
///
/// `is_free(i, axis)`: whether the axis is free at waypoint i; `is_turn_free(i, from, to)`: whether the turn is free during
/// the move that ends at i. Axes and turns of the sequence itself that are not free are not made worse.
pub fn refine(
    problem: &Problem,
    sequence: &[u16],
    chart: Chart,
    is_free: impl Fn(usize, &Vector3<f64>) -> bool + Sync,
    is_turn_free: impl Fn(usize, &Unit<Vector3<f64>>, &Unit<Vector3<f64>>) -> bool + Sync,
) -> Refined {
    let mut state = State::new(problem, sequence, chart);
    for _ in 0..SWEEPS {
        cancel::poll();
        state.sweep();
    }
    let retreated: Vec<Vector2<f64>> = (0..sequence.len())
        .into_par_iter()
        .map(|i| {
            cancel::poll();
            let t = state.offset[i];
            let shares = RETREATS.iter().map(|share| t * *share).filter(|t| t.norm() > 0.0);
            shares.into_iter().find(|t| is_free(i, &state.axis(i, t))).unwrap_or_default()
        })
        .collect();
    let moved = |t: &Vector2<f64>| t.norm() > 0.0;
    let wanted = state.offset.iter().filter(|t| moved(t)).count();
    state.offset = retreated;
    state.release_failing_turns(&is_turn_free);
    let held = wanted - state.offset.iter().filter(|t| moved(t)).count();
    let axes = (0..sequence.len()).map(|i| state.axis(i, &state.offset[i])).collect();
    let angles_rad = problem.directions.angles_rad().map(|angles| {
        sequence.iter().zip(&state.offset).map(|(n, t)| angles[usize::from(*n)] + t.x).collect()
    });
    Refined { axes, angles_rad, held }
}

struct State<'a> {
    problem: &'a Problem<'a>,
    sequence: &'a [u16],
    chart: Chart<'a>,
    /// Offset of each axis from its direction, rad.
    offset: Vec<Vector2<f64>>,
    /// Gradient and curvature of C about the direction.
    model: Vec<(Vector2<f64>, Matrix2<f64>)>,
}

impl<'a> State<'a> {
    fn new(problem: &'a Problem<'a>, sequence: &'a [u16], chart: Chart<'a>) -> Self {
        let model = (0..sequence.len())
            .into_par_iter()
            .map(|i| {
                cancel::poll();
                quadratic(problem, i, usize::from(sequence[i]), chart)
            })
            .collect();
        Self { problem, sequence, chart, offset: vec![Vector2::zeros(); sequence.len()], model }
    }

    fn axis(&self, i: usize, t: &Vector2<f64>) -> Unit<Vector3<f64>> {
        let n = usize::from(self.sequence[i]);
        match (self.chart, self.problem.directions.angles_rad()) {
            (Chart::Plane(family), Some(angles)) => family.axis(angles[n] + t.x),
            _ => from_tangent(&self.problem.directions.axes()[n], t),
        }
    }

    /// Offset of waypoint j's axis from waypoint i's direction.
    fn seen_from(&self, i: usize, j: usize) -> Vector2<f64> {
        let (n, m) = (usize::from(self.sequence[i]), usize::from(self.sequence[j]));
        match (self.chart, self.problem.directions.angles_rad()) {
            (Chart::Plane(_), Some(angles)) => Vector2::new(angles[m] - angles[n] + self.offset[j].x, 0.0),
            _ if n == m => self.offset[j],
            _ => to_tangent(&self.problem.directions.axes()[n], &self.axis(j, &self.offset[j])),
        }
    }

    fn sweep(&mut self) {
        let trust = TRUST * self.problem.directions.spacing_rad();
        for i in 0..self.sequence.len() {
            let (gradient, curvature) = self.model[i];
            let length = self.problem.length_mm[i].max(1e-3);
            let mut matrix = curvature * length;
            let mut right = -gradient * length;
            for (j, edge) in [(i.checked_sub(1), i), (Some(i + 1), i + 1)] {
                let Some(j) = j.filter(|j| *j < self.sequence.len()) else { continue };
                let weight = 2.0 * self.problem.turn_weight(edge);
                matrix += Matrix2::identity() * weight;
                right += self.seen_from(i, j) * weight;
            }
            let Some(t) = matrix.try_inverse().map(|inverse| inverse * right) else { continue };
            let size = t.norm();
            let t = if size > trust { t * (trust / size) } else { t };
            self.offset[i] = self.within_family(i, t);
        }
    }

    /// An offset that does not leave the family's range.
    fn within_family(&self, i: usize, t: Vector2<f64>) -> Vector2<f64> {
        let (Chart::Plane(family), Some(angles)) = (self.chart, self.problem.directions.angles_rad()) else {
            return t;
        };
        let angle_rad = angles[usize::from(self.sequence[i])];
        Vector2::new((angle_rad + t.x).clamp(family.lower_rad, family.upper_rad) - angle_rad, t.y)
    }

    /// Resets the ends of turns that are not free to the set, until every turn is free or has both ends on the set.
    fn release_failing_turns(
        &mut self,
        is_turn_free: &(impl Fn(usize, &Unit<Vector3<f64>>, &Unit<Vector3<f64>>) -> bool + Sync),
    ) {
        let mut look: Vec<usize> = (1..self.sequence.len()).collect();
        while !look.is_empty() {
            let failing: Vec<usize> = look
                .par_iter()
                .copied()
                .filter(|i| {
                    cancel::poll();
                    let (from, to) = (self.axis(i - 1, &self.offset[i - 1]), self.axis(*i, &self.offset[*i]));
                    !is_turn_free(*i, &from, &to)
                })
                .collect();
            look.clear();
            for i in failing {
                for end in [i - 1, i] {
                    if self.offset[end].norm() > 0.0 {
                        self.offset[end] = Vector2::zeros();
                        look.extend(
                            [end, end + 1].into_iter().filter(|i| (1..self.sequence.len()).contains(i)),
                        );
                    }
                }
            }
            look.sort_unstable();
            look.dedup();
        }
    }
}

/// Gradient and curvature of C about direction n of waypoint i, from the free neighbours' costs. The curvature is not negative,
/// and 0 where there are too few neighbours.
fn quadratic(problem: &Problem, i: usize, n: usize, chart: Chart) -> (Vector2<f64>, Matrix2<f64>) {
    let directions = problem.directions;
    let own = |m: usize| f64::from(problem.cost[i * directions.len() + m]);
    let around = directions.neighbours(n).filter(|m| problem.free.contains(i, *m));
    match (chart, directions.angles_rad()) {
        (Chart::Plane(_), Some(angles)) => {
            let slopes: Vec<[f64; 2]> = around
                .map(|m| [angles[m] - angles[n], own(m) - own(n)])
                .filter(|[step, _]| step.abs() < 1.01 * directions.spacing_rad())
                .map(|[step, rise]| [step, rise / step])
                .collect();
            let (gradient, curvature) = match slopes.as_slice() {
                [[a, slope_a], [b, slope_b]] => {
                    // the slope of each chord is that at the middle of its span
                    let curvature = (slope_a - slope_b) / (0.5 * (a - b));
                    (slope_a - 0.5 * curvature * a, curvature)
                }
                [[_, slope]] => (*slope, 0.0),
                _ => (0.0, 0.0),
            };
            (Vector2::new(gradient, 0.0), Matrix2::new(curvature.max(0.0), 0.0, 0.0, 0.0))
        }
        _ => {
            let points: Vec<(Vector2<f64>, f64)> = around
                .map(|m| (to_tangent(&directions.axes()[n], &directions.axes()[m]), own(m) - own(n)))
                .collect();
            fitted(&points)
        }
    }
}

/// Least-squares fit: a slope from at least two points, and a curvature (equal in all directions) from at least four.
fn fitted(points: &[(Vector2<f64>, f64)]) -> (Vector2<f64>, Matrix2<f64>) {
    let with_bowl = points.len() >= 4;
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for (t, rise) in points {
        let row = Vector3::new(t.x, t.y, if with_bowl { 0.5 * t.norm_squared() } else { 0.0 });
        normal += row * row.transpose();
        right += row * *rise;
    }
    if !with_bowl {
        normal[(2, 2)] = 1.0;
    }
    match normal.try_inverse().filter(|_| points.len() >= 2 && normal.determinant().abs() > 1e-15) {
        Some(inverse) => {
            let s = inverse * right;
            (s.xy(), Matrix2::identity() * s.z.max(0.0))
        }
        None => (Vector2::zeros(), Matrix2::zeros()),
    }
}

/// The axis at tangent coordinates t of `from`, rad.
fn from_tangent(from: &Unit<Vector3<f64>>, t: &Vector2<f64>) -> Unit<Vector3<f64>> {
    let basis = bonemill_geometry::basis::from_z(from);
    let angle = t.norm();
    match Unit::try_new(Vector3::new(-t.y, t.x, 0.0), 1e-15) {
        Some(about) => {
            UnitQuaternion::from_axis_angle(&Unit::new_normalize(basis * about.into_inner()), angle) * from
        }
        None => *from,
    }
}

/// The tangent coordinates of `to` at `from`: rad along the great circle.
fn to_tangent(from: &Unit<Vector3<f64>>, to: &Unit<Vector3<f64>>) -> Vector2<f64> {
    let local = bonemill_geometry::basis::from_z(from).inverse() * to.into_inner();
    let across = local.xy();
    let sine = across.norm();
    if sine < 1e-15 { Vector2::zeros() } else { across * (sine.atan2(local.z) / sine) }
}

#[cfg(test)]
mod tests;
