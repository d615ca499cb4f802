//! The motion of arm and burr, from the trajectory's rows by forward kinematics.

use bonemill_arm::RobotError;
use bonemill_geometry::{Point, Rigid, Tool, Work};
use nalgebra::Vector3;

use super::Show;

/// The arm and the burr at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Moment {
    /// Time, s.
    pub time_s: f64,
    /// The waypoint at which the present move ends.
    pub waypoint: usize,
    /// Burr and shaft: origin the burr's centre, z to the handpiece.
    pub tool: Rigid<Work, Tool>,
    /// Positions of the arm's joints and of its flange, from the base outwards.
    pub links: Vec<Point<Work>>,
    /// Joint positions, mm or rad.
    pub q: Vec<f64>,
    /// Force on the burr during the move, N; `None` where nothing is cut.
    pub force_n: Option<Vector3<f64>>,
}

impl Show<'_> {
    /// At most `most` moments, evenly spaced in rows, the last row included.
    ///
    /// # Errors
    /// When a row is not a joint vector of the arm.
    pub fn moments(&self, most: usize) -> Result<Vec<Moment>, RobotError> {
        let rows = &self.plan.trajectory;
        let step = rows.len().div_ceil(most.max(1)).max(1);
        let last = rows.len().saturating_sub(1);
        let chosen = (0..last).step_by(step).chain([last]);
        let work_from_base = self.work_from_base();
        let mut waypoint = 0;
        let mut moments = Vec::with_capacity(last / step + 2);
        for row in chosen.filter(|row| *row < rows.len()) {
            let (time_s, q) = (rows.time_s[row], rows.q_at(row));
            while waypoint + 1 < self.plan.waypoints.len() && self.plan.waypoints[waypoint].time_s < time_s {
                waypoint += 1;
            }
            let arm = &self.plan.arm;
            moments.push(Moment {
                time_s,
                waypoint,
                tool: work_from_base * arm.burr(q)?,
                links: arm.joint_places(q)?.into_iter().map(|p| work_from_base * p).collect(),
                q: q.to_vec(),
                force_n: self
                    .plan
                    .waypoints
                    .get(waypoint)
                    .filter(|w| w.mass_mg > 0.0)
                    .map(|w| self.work_from_ct.rotate(&w.force_n)),
            });
        }
        Ok(moments)
    }
}
