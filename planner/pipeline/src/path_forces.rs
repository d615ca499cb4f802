//! The force on the burr along a path as the arm drives it, for the axes that the shaft has.
//!
//! A row of a plan states the force where its move ends. Engagement changes within a move too, and a move may cut the skin that a rounded corner left,
//! so forces are also computed at places within every move, those that plan to cut nothing included. Levels and caps hold at all of them.

use bonemill_arm::Arm;
use bonemill_case::Case;
use bonemill_cutter::Ball;
use bonemill_cutting::burr::{EngagedForce, Feed, ForceKernel, Material};
use bonemill_geometry::{Base, Rigid, Work};
use bonemill_scene::Scene;
use bonemill_setup::tools;
use bonemill_stock::removal::RemovalTime;
use bonemill_toolpath::engagement::{RoundedCorner, SweptPath};
use bonemill_toolpath::path::PathPoint;
use nalgebra::{Unit, Vector3};
use rayon::prelude::*;

use super::PlanError;
use super::speeds::JointMotion;

/// Places within a move at which the force is computed, as shares of its way, besides its end.
const WITHIN: [f64; 4] = [0.02, 0.25, 0.5, 0.75];
/// The same, from where a move comes back to a rounded corner and meets the skin there.
const AROUND_BACK: [f64; 4] = [-0.2, -0.06, 0.0, 0.06];
/// Elements from tip to shaft and around of the force sum where moves end.
pub(super) const FINE: [usize; 2] = [64, 128];
/// The same within moves, and while axes are still chosen.
pub(super) const COARSE: [usize; 2] = [32, 64];
/// A corner by whose rounding the burr leaves the path less than this leaves no skin that counts, mm.
const LEAST_CORNER_MM: f64 = 2e-3;

/// A path as forces see it; one entry per waypoint.
#[derive(Debug, Clone, Copy)]
pub(super) struct ForcedPath<'a> {
    pub scene: &'a Scene,
    pub removal: &'a RemovalTime,
    pub points: &'a [PathPoint],
    pub feeds: &'a [Option<Unit<Vector3<f64>>>],
}

/// The corners that an arm rounds along its motion, in the path's order.
pub(super) fn rounded_corners(
    motion: &JointMotion,
    arm: &Arm,
    base_from_work: &Rigid<Base, Work>,
) -> Vec<RoundedCorner> {
    let work_from_base = base_from_work.inverse();
    let place = |q: Vec<f64>| {
        let tool: Rigid<Base, bonemill_geometry::Tool> = arm.tool_at(&q);
        let center: bonemill_geometry::Point<Base> =
            bonemill_geometry::Point::from_coords(tool.translation_mm);
        work_from_base * center
    };
    let corners = motion.burr_corners(LEAST_CORNER_MM).into_iter();
    corners.map(|(waypoint, q)| RoundedCorner { waypoint, at: q.map(place) }).collect()
}

impl ForcedPath<'_> {
    /// Forces where moves end, of those that are planned to remove something: `removes(i)`.
    ///
    /// # Errors
    /// When the tool or the material is not usable.
    pub fn at_ends(
        &self,
        case: &Case,
        axes: &[Unit<Vector3<f64>>],
        elements: [usize; 2],
        removes: impl Fn(usize) -> bool + Sync,
    ) -> Result<Vec<Option<EngagedForce>>, PlanError> {
        let (kernel, material) = kernel(case, elements)?;
        let ball = Ball { radius_mm: case.burr.radius_mm };
        let swept = SweptPath::new(self.scene, self.removal, self.points, ball);
        let force = |i: usize| {
            let feed = self.feeds[i].filter(|_| removes(i))?;
            let mut bone = swept.bone_at(i as u32, kernel.sample_radius_mm(), |d| material.weight(d));
            Some(kernel.engaged_force(&axes[i], &feed_of(case, &feed), &mut bone))
        };
        Ok((0..self.points.len()).into_par_iter().map(force).collect())
    }

    /// Forces at places within every move of a path whose `corners` are rounded, the ends of moves that are planned to remove nothing
    /// included.
    ///
    /// # Errors
    /// When the tool or the material is not usable.
    pub fn within(
        &self,
        case: &Case,
        axes: &[Unit<Vector3<f64>>],
        corners: &[RoundedCorner],
        removes: impl Fn(usize) -> bool + Sync,
    ) -> Result<Vec<Vec<EngagedForce>>, PlanError> {
        let (kernel, material) = kernel(case, COARSE)?;
        let ball = Ball { radius_mm: case.burr.radius_mm };
        let swept = SweptPath::driven(self.scene, self.removal, self.points, ball, corners);
        let of_move = |i: usize| {
            let back = swept.comes_back(i).map(|back| AROUND_BACK.map(|off| (back + off).clamp(0.0, 1.0)));
            let shares = back.iter().flatten().chain(WITHIN.iter().filter(|_| removes(i)));
            let force = |share: &f64| {
                let weight = |density| material.weight(density);
                let (feed, mut bone) =
                    swept.bone_within((i as u32, *share), kernel.sample_radius_mm(), weight)?;
                let force = kernel.engaged_force(&axes[i], &feed_of(case, &feed), &mut bone);
                (force.mrr_mm2 > 0.0).then_some(force)
            };
            shares.filter_map(force).collect()
        };
        Ok((0..self.points.len()).into_par_iter().map(of_move).collect())
    }
}

fn kernel(case: &Case, [n_kappa, n_around]: [usize; 2]) -> Result<(ForceKernel, Material), PlanError> {
    let tool = tools::tool(&case.burr)?;
    let (material, measure) = tools::material(&case.material)?;
    let kernel =
        ForceKernel::new(&tool, &material, &tools::discretisation(&tool, measure, n_kappa, n_around)?);
    Ok((kernel, material))
}

fn feed_of(case: &Case, direction: &Unit<Vector3<f64>>) -> Feed {
    Feed::new(direction, case.speed.nominal_mm_s, case.burr.spindle_rpm)
}
