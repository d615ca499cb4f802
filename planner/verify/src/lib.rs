//! A second opinion on a finished plan: checks by code that did not make the plan.
//!
//! The checks start from the result. Forward kinematics turns the trajectory into poses of the burr; the burr's sweep is
//! tested point by point on a lattice of half the planner's spacing; the shank is tested against everything that still
//! stands at each moment; distances to structures are exact to their label boxes; the burr's force is summed along the driven
//! motion; and every figure that the plan states is computed again. Volumes are counted on the planner's own voxels, so that a correct figure needs no tolerance. A [`Check`]
//! holds its value, its limit, the margin and the place of the worst value.
//!
//! Shared with the planner are frames and grids, the arm's forward kinematics, and the reader of plan
//! files. Not shared are path, space, access, orientation, removal, engagement, pipeline and time law; Cargo and a test of the
//! source tree enforce this. Definitions are those of the plan format: closed label boxes, obstacle bone without specks and
//! without sheets thinner than the band within the band of the target; soft tissue outside the target is free.
//!
//! Not checked: whether the CT shows the patient; whether the registration is correct (only its fiducials' positions, their
//! fit and the expected error; the uncertainty module computes the effect of errors); whether the material's coefficients are
//! those of the bone; the arm's links beyond what their capsules and the scan tell.
//!
//! Invariants: checks are independent of each other; equal plans give equal bytes on any number of threads.

mod anatomy;
mod boxes;
mod bricks;
mod carve;
mod channel;
mod check;
mod clearance;
mod columns;
mod driven;
mod edge;
mod edt;
mod error;
mod extents;
mod figures;
mod follow;
mod forces;
mod gouge;
mod head;
mod images;
mod lattice;
mod links;
mod milled;
mod motion;
mod moves;
mod provenance;
mod reach;
mod registration;
mod requirements;
mod rest;
mod result;
mod room;
mod shaft;
mod solid;
mod target;
pub mod uncertainty;
mod voxels;

pub(crate) use anatomy::{Anatomy, Kept};
pub(crate) use boxes::Boxes;
pub use check::{Check, LimitSide, Place, Short};
pub use error::{ReadProblem, VerifyError};
pub use images::SharedReader;
pub use result::Verification;

use bonemill_geometry::Progress;
use bonemill_planfile::{StoredPlan, digests, read_case_text};
use motion::MotionLimits;
use moves::{Executed, Moves};
use target::TargetRule;

/// A plan and what its checks look at.
#[derive(Clone, Copy)]
pub(crate) struct Evidence<'a> {
    /// The plan.
    pub plan: &'a StoredPlan,
    /// Its images.
    pub anatomy: &'a Anatomy,
    /// What is target.
    pub target: &'a TargetRule<'a>,
    /// The structures' voxel boxes; `None` for one that the map lacks.
    pub boxes: &'a [Option<Boxes<'a>>],
    /// The moves between its waypoints.
    pub moves: &'a Moves,
    /// The burr along its trajectory.
    pub executed: &'a Executed,
}

impl Evidence<'_> {
    /// Checks of every structure; one that the label map lacks fails by itself.
    fn of_structures(&self, checks: impl Fn(&Kept, &Boxes<'_>) -> Vec<Check>) -> Vec<Check> {
        let missing =
            |kept: &Kept| Check::none_wrong("structures are in the label map", 1).of(kept.name.clone());
        let of = |(kept, boxes): (&Kept, &Option<Boxes<'_>>)| match boxes {
            Some(boxes) => checks(kept, boxes),
            None => vec![missing(kept)],
        };
        self.anatomy.kept.iter().zip(self.boxes).flat_map(of).collect()
    }

    /// The instant of a row of the trajectory.
    fn instant(&self, row: usize) -> Place {
        Place::Instant {
            time_s: self.plan.trajectory.time_s[row],
            waypoint: self.executed.next[row] as usize,
        }
    }
}

/// Verifies a plan.
///
/// Reads the plan's images again. A plan that fails is not an error: its [`Verification`] tells which checks failed.
///
/// # Errors
/// [`VerifyError`] when there is nothing to verify or an image cannot be read.
pub fn verify(plan: &StoredPlan, progress: &dyn Progress) -> Result<Verification, VerifyError> {
    if plan.waypoints.is_empty() || plan.trajectory.is_empty() {
        return Err(VerifyError::Empty);
    }
    // before anything is judged: a file that is changed meanwhile does not get the verdict
    let files = digests(&plan.dir)?;
    let case = &plan.record.case;
    progress.stage("read images");
    let anatomy = Anatomy::read(plan)?;
    let boxes: Vec<Option<Boxes<'_>>> =
        anatomy.kept.iter().map(|kept| Boxes::new(anatomy.map_of(kept.label), kept.label)).collect();
    let mut checks = provenance::provenance(plan, &read_case_text(plan)?)?;
    checks.extend(registration::registration(&plan.record, &anatomy, &boxes));

    progress.stage("check motion");
    let moves = Moves::new(plan);
    let executed = Executed::new(plan, &moves)?;
    let limits = MotionLimits {
        arm: &plan.arm,
        rate_hz: case.robot.rate_hz,
        end_s: moves.times_s.last().copied().unwrap_or(0.0),
    };
    checks.extend(motion::motion(&plan.trajectory, &limits));
    checks.extend(follow::follow(plan, &moves, &executed)?);
    checks.extend(follow::speeds(plan, &moves, &executed));
    checks.extend(links::links(plan, &executed)?);
    progress.stage("check links");
    checks.extend(room::room(plan, &anatomy, &executed)?);
    let (anatomy, boxes, moves, executed) = (&anatomy, &boxes[..], &moves, &executed);
    let target = &TargetRule::new(anatomy, boxes);
    let evidence = Evidence { plan, anatomy, target, boxes, moves, executed };
    checks.extend(match case.job.channel() {
        Some(spec) => channel::checks(&evidence, spec, progress)?,
        None => milled::checks(&evidence, progress)?,
    });
    Ok(Verification { checks, files, shared_readers: anatomy.shared_readers.clone() })
}
