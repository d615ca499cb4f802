//! The burr's way in the planning grid's frame: as the waypoints say, and as the arm goes by its joint trajectory.

use bonemill_geometry::{Base, Ct, Rigid, Work, cancel};
use bonemill_planfile::StoredPlan;
use nalgebra::Vector3;
use rayon::prelude::*;

use super::VerifyError;

/// What a move is for, as the file says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MoveClass {
    /// Removes bone.
    Cut,
    /// Crosses free space, or goes out of the bone or back in.
    Free,
}

/// The waypoints' polyline.
#[derive(Debug)]
pub struct Moves {
    /// Burr's centre, mm.
    pub points: Vec<Vector3<f64>>,
    /// Shaft, unit, to the handpiece.
    pub axes: Vec<Vector3<f64>>,
    /// Of the move that ends there.
    pub kinds: Vec<MoveClass>,
    /// s.
    pub times_s: Vec<f64>,
    /// Path length to here, mm.
    pub arc_mm: Vec<f64>,
}

/// The trajectory's rows through the arm's forward kinematics.
#[derive(Debug)]
pub struct Executed {
    /// Burr's centre, mm.
    pub points: Vec<Vector3<f64>>,
    /// Shaft, unit.
    pub axes: Vec<Vector3<f64>>,
    /// The waypoint that the move at this instant leads to.
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

    /// The waypoint that the move at an instant leads to: the first that is passed then or later.
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
    /// Every row of the trajectory.
    ///
    /// # Errors
    /// [`VerifyError::Robot`] where a row is no joint vector of the arm.
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

/// Angle between unit vectors, rad; exact for small ones.
pub fn angle_rad(a: &Vector3<f64>, b: &Vector3<f64>) -> f64 {
    a.cross(b).norm().atan2(a.dot(b))
}

/// The axis a share of the way from one to another, along the great circle; the first where they are opposite.
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
