//! The burr's motion in the planning grid's frame: by the waypoints, and by the arm's joint trajectory.

use bonemill_geometry::{Base, Ct, Rigid, Work, cancel};
use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::VerifyError;

/// Whether a move cuts, by the kind in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MoveClass {
    /// A cut.
    Cut,
    /// A link or a retract.
    Free,
}

/// The waypoints' polyline.
#[derive(Debug)]
pub struct Moves {
    /// Burr's centre, mm.
    pub points: Vec<Vector3<f64>>,
    /// Unit axis of the shaft, to the handpiece.
    pub axes: Vec<Vector3<f64>>,
    /// Kind of the move that ends at each waypoint.
    pub kinds: Vec<MoveClass>,
    /// Time of each waypoint, s.
    pub times_s: Vec<f64>,
    /// Path length to each waypoint, mm.
    pub arc_mm: Vec<f64>,
}

/// The poses of the trajectory's rows, by forward kinematics.
#[derive(Debug)]
pub struct Executed {
    /// Burr's centre, mm.
    pub points: Vec<Vector3<f64>>,
    /// Unit axis of the shaft.
    pub axes: Vec<Vector3<f64>>,
    /// The waypoint at which the move of each row ends.
    pub next: Vec<u32>,
}

impl Moves {
    /// The waypoints of a plan.
    pub fn new(plan: &StoredPlan) -> Self {
        let grid_from_ct: Rigid<Work, Ct> = plan.record.frames.ct_from_grid().inverse();
        let rows = &plan.waypoints;
        let points: Vec<_> = rows.iter().map(|w| (grid_from_ct * w.position).coords).collect();
        let mut arc_mm = Vec::with_capacity(points.len());
        let mut sum = 0.0;
        for (n, p) in points.iter().enumerate() {
            sum += n.checked_sub(1).map_or(0.0, |before| (p - points[before]).norm());
            arc_mm.push(sum);
        }
        Self {
            axes: rows.iter().map(|w| grid_from_ct.rotate(&w.axis)).collect(),
            kinds: rows
                .iter()
                .map(|w| if w.kind.word() == "cut" { MoveClass::Cut } else { MoveClass::Free })
                .collect(),
            times_s: rows.iter().map(|w| w.time_s).collect(),
            points,
            arc_mm,
        }
    }

    /// Number of waypoints.
    pub fn len(&self) -> usize {
        self.points.len()
    }

    /// The waypoint at which the move at an instant ends: the first that is passed then or later.
    pub fn next_at(&self, time_s: f64) -> usize {
        let next = self.times_s.partition_point(|t| *t < time_s);
        next.max(1).min(self.len().saturating_sub(1))
    }

    /// Start and end of the move that ends at a waypoint.
    pub fn ends(&self, waypoint: usize) -> [usize; 2] {
        [waypoint.saturating_sub(1), waypoint]
    }
}

impl Executed {
    /// The waypoint at which the move of a row ends.
    pub fn waypoint_at(&self, row: usize) -> usize {
        self.next.get(row).map_or(0, |next| *next as usize)
    }

    /// The poses of every row of the trajectory.
    ///
    /// # Errors
    /// [`VerifyError::Robot`] where a row is not a joint vector of the arm.
    pub fn new(plan: &StoredPlan, moves: &Moves) -> Result<Self, VerifyError> {
        let base_from_grid: Rigid<Base, Work> =
            plan.record.frames.base_from_ct * plan.record.frames.ct_from_grid();
        let grid_from_base = base_from_grid.inverse();
        let rows = &plan.trajectory;
        let poses: Vec<_> = (0..rows.len())
            .into_par_iter()
            .map(|row| {
                cancel::poll();
                let pose = grid_from_base * plan.arm.burr(rows.q_at(row))?;
                Ok((pose.translation_mm, pose.rotation * Vector3::z()))
            })
            .collect::<Result<_, VerifyError>>()?;
        let (points, axes) = poses.into_iter().unzip();
        let next = rows.time_s.par_iter().map(|t| moves.next_at(*t) as u32).collect();
        Ok(Self { points, axes, next })
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        self.points.len()
    }
}

/// Angle between unit vectors, rad; accurate for small angles.
pub fn angle_rad(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

/// The axis at a share of the way from one axis to another along the great circle; the first one if they are opposite.
pub fn between(a: &Vector3<f64>, b: &Vector3<f64>, share: f64) -> Vector3<f64> {
    let angle = angle_rad(a, b);
    let sine = angle.sin();
    if sine.abs() < 1e-9 {
        return (a + (b - a) * share).try_normalize(1e-9).unwrap_or(*a);
    }
    a * (((1.0 - share) * angle).sin() / sine) + b * ((share * angle).sin() / sine)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_turns_evenly() {
        let (a, b) = (Vector3::z(), Vector3::new(0.6, 0.0, 0.8));
        for n in 0..=10 {
            let share = f64::from(n) / 10.0;
            let axis = between(&a, &b, share);
            assert!((axis.norm() - 1.0).abs() < 1e-12);
            assert!((angle_rad(&a, &axis) - share * angle_rad(&a, &b)).abs() < 1e-12);
        }
        assert_eq!(between(&a, &a, 0.5), a);
    }
}
