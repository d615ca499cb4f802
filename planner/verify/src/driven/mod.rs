//! Computes the burr's force along the driven motion, and checks what the plan states about it.
//!
//! The burr follows the trajectory ([`DrivenPath`]). At the end of each step the sum over its surface ([`BurrSum`]) counts the bone of
//! the images ([`MassRule`]) that no earlier piece of the driven path has removed ([`Covered`]). Where the trajectory cuts a corner, a skin of
//! bone stays; it gives force when the burr comes back, whether that move is a cut or a link. However thin the skin is, all of the
//! burr's surface that moves into it cuts.
//!
//! Nothing of the planner's force is used: not its nodes, its geometry, nor its waypoints. Not checked: the force at each single
//! waypoint; the motion between two rows of the trajectory.

mod bone;
mod caps;
mod covered;
mod path;
mod stated;
mod sum;

use bonemill_case::Burr;
use bonemill_geometry::{Grid, Point, Work, cancel};
use nalgebra::Vector3;
use rayon::prelude::*;

use self::bone::MassRule;
use self::covered::Covered;
use self::path::{DrivenPath, PieceStep};
use self::sum::{BurrSum, Engaged};
use super::check::{Check, Place};
use super::extents::scan_box;
use super::{Evidence, VerifyError};

/// Polar angles and azimuths of the sum's nodes. Twice as many change a force by 0.5 % in the median.
const NODES: [usize; 2] = [48, 96];
/// By this share and this much, N, the driven force may exceed what the plan states, or a cap. It covers that both sides sum over
/// nodes, that the driven path lies within 0.5 µm of its rows, and that the force is computed every 0.05 mm.
const FORCE_SHARE: f64 = 0.05;
const FORCE_N: f64 = 0.01;
/// A step that ends at a waypoint to this belongs to the move before it, s.
const ROUNDING_S: f64 = 1e-9;

/// The checks of the force along the driven motion.
///
/// # Errors
/// [`VerifyError`] for a grid that cannot be made, or a row that is no joint vector of the arm.
pub fn checks(evidence: &Evidence) -> Result<Vec<Check>, VerifyError> {
    let path = DrivenPath::new(evidence.executed, &evidence.plan.trajectory.time_s);
    let force = DrivenForce::new(evidence, &path)?;
    let mut checks = stated::checks(evidence, &force);
    if evidence.plan.record.case.speed.mode.keeps_caps() {
        checks.extend(caps::checks(evidence, &force)?);
    }
    Ok(checks)
}

/// The force at every step at which there is one.
#[derive(Debug)]
struct DrivenForce<'a> {
    instants: Vec<Instant<'a>>,
}

/// A step of the driven path with its force.
#[derive(Debug, Clone, Copy)]
struct Instant<'a> {
    /// Its index among the instants.
    index: usize,
    step: &'a PieceStep,
    /// What is engaged at the step's end, and in the mean of its start and its end.
    end: Engaged,
    mean: Engaged,
}

impl Instant<'_> {
    /// The force at the step's end, N in work.
    fn end_n(&self) -> Vector3<f64> {
        self.end.force_n(self.step.end_mm_s)
    }

    /// The mean force over the step's time, N in work.
    fn mean_n(&self) -> Vector3<f64> {
        self.mean.force_n(self.step.mean_mm_s)
    }

    /// The burr's centre.
    fn center(&self) -> Point<Work> {
        Point::from_coords(self.step.center)
    }

    /// The waypoint at which the move ends in which it ends.
    fn waypoint(&self, evidence: &Evidence) -> usize {
        evidence.moves.next_at(self.step.end_s - ROUNDING_S)
    }

    fn place(&self, evidence: &Evidence) -> Place {
        Place::Instant { time_s: self.step.end_s, waypoint: self.waypoint(evidence) }
    }
}

impl<'a> DrivenForce<'a> {
    /// The force along a path.
    fn new(evidence: &Evidence, path: &'a DrivenPath) -> Result<Self, VerifyError> {
        let Evidence { plan, anatomy, target, executed, .. } = *evidence;
        let case = &plan.record.case;
        let ct_from_grid = plan.record.frames.ct_from_grid();
        let dims = plan.record.frames.grid.dims;
        let grid = Grid::aligned(dims, case.grid.spacing_mm, Point::new(0.0, 0.0, 0.0))?;
        let bone = MassRule::new(target, &case.density, ct_from_grid, &grid)?;
        let turning = plan.record.burr();
        let burr = BurrSum::new(&turning, &case.material, NODES);
        let space = swept_box(path, scan_box(anatomy, &ct_from_grid.inverse()), case.burr.radius_mm);
        Ok(Self::along(path, &executed.axes, (&burr, &turning), space, |p| bone.density_g_cm3(p)))
    }

    /// The force along a path in bone of a density, g/cm³. `axes`: the shaft's at every row; `space`: a box beyond which is no bone.
    fn along(
        path: &'a DrivenPath,
        axes: &[Vector3<f64>],
        (sum, burr): (&BurrSum, &Burr),
        space: [Vector3<f64>; 2],
        density_g_cm3: impl Fn(Point<Work>) -> f64 + Sync,
    ) -> Self {
        let covered = Covered::new(&path.pieces, burr.radius_mm, sum.patch_mm(), space);
        let at = |step: &'a PieceStep| {
            cancel::poll();
            sum.engaged(&axes[step.row], &step.direction, step.end_mm_s, |normal, patch| {
                let p = step.center + normal * burr.radius_mm;
                let share = covered.share_left(step.piece, &p, |direction| patch.sides_mm(direction));
                if share > 0.0 { share * sum.weight(density_g_cm3(Point::from_coords(p))) } else { 0.0 }
            })
        };
        let ends: Vec<Engaged> = path.steps.par_iter().map(at).collect();
        let found = path.steps.iter().enumerate().filter_map(|(n, step)| {
            // the step before the first one of a piece has another direction: that one counts as at its end
            let is_same = |before: &usize| path.steps[*before].piece == step.piece;
            let start = n.checked_sub(1).filter(is_same).unwrap_or(n);
            let mean = ends[start].mean_with(&ends[n]);
            (!mean.is_none()).then_some((step, ends[n], mean))
        });
        let instant = |(index, (step, end, mean))| Instant { index, step, end, mean };
        Self { instants: found.enumerate().map(instant).collect() }
    }

    /// The instant with the largest value, and the value; the first of several.
    fn largest(&self, of: impl Fn(&Instant) -> Option<f64>) -> Option<(f64, &Instant<'a>)> {
        let found = self.instants.iter().filter_map(|instant| Some((of(instant)?, instant)));
        found.reduce(|most, next| if next.0 > most.0 { next } else { most })
    }
}

/// The part of the scan that the burr can reach.
fn swept_box(path: &DrivenPath, [lo, hi]: [Vector3<f64>; 2], radius_mm: f64) -> [Vector3<f64>; 2] {
    let ends = || path.pieces.iter().flat_map(|piece| [piece.a, piece.b]);
    let around = Vector3::repeat(radius_mm * (1.0 + 1e-9));
    let first = ends().fold(Vector3::repeat(f64::INFINITY), |lo, p| lo.inf(&p)) - around;
    let last = ends().fold(Vector3::repeat(f64::NEG_INFINITY), |hi, p| hi.sup(&p)) + around;
    let lo = lo.sup(&first);
    [lo, hi.inf(&last).sup(&lo)]
}

/// The largest value that is accepted where `limit_n` is stated or allowed, N.
fn accepted_n(limit_n: f64) -> f64 {
    limit_n * (1.0 + FORCE_SHARE) + FORCE_N
}

#[cfg(test)]
mod tests;
