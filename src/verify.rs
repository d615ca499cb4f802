//! `bonemill verify`: a second opinion on a plan, printed and kept as `verification.toml` beside it.

use anyhow::Context;
use bonemill_geometry::Point;
use bonemill_planner::Progress;
use bonemill_planner::plan::{PlanFileError, StoredPlan, digests, save_verification};
use bonemill_planner::uncertainty::{ErrorModel, RigidError, simulate_errors};
use bonemill_planner::verify::{Check, Place, Verification, verify};

use crate::args::{ErrorArgs, VerifyArgs};
use crate::outcome::Outcome;

pub fn run(args: &VerifyArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    progress.stage("read plan");
    let mut risk = None;
    let found = match StoredPlan::load(&args.plan) {
        Ok(plan) => {
            let failed = || format!("the plan in {} cannot be verified", args.plan.display());
            let found = verify(&plan, progress).with_context(failed)?;
            if let Some(samples) = args.samples {
                progress.stage("draw errors");
                risk = Some(simulate_errors(&plan, &error_model(&plan, &args.errors, samples)?)?);
            }
            found
        }
        // a sound plan of something else: no other check would mean anything
        Err(PlanFileError::InputChanged { path, .. }) => Verification {
            checks: vec![
                Check::none_wrong("inputs unchanged", 1).at(Place::Named(path.display().to_string())),
            ],
            files: digests(&args.plan)?,
        },
        Err(error) => {
            return Err(error).with_context(|| format!("the plan in {} cannot be read", args.plan.display()));
        }
    };
    progress.stage("write verdict");
    let path = save_verification(&args.plan, &found)?;
    let outcome = Outcome::verified(&path, &found);
    Ok(match risk {
        Some(risk) => outcome.risking(&risk, args.errors.keep),
        None => outcome,
    })
}

/// The errors asked for; rotations are about the middle of the path.
fn error_model(plan: &StoredPlan, args: &ErrorArgs, samples: u32) -> anyhow::Result<ErrorModel> {
    let mut middle = Point::new(0.0, 0.0, 0.0);
    for w in &plan.waypoints {
        middle = middle + w.position.coords / plan.waypoints.len() as f64;
    }
    let rotation_rad = args.registration_deg.to_radians();
    Ok(ErrorModel {
        registration: RigidError::of_sigmas([args.registration_mm; 3], [rotation_rad; 3], middle)?,
        boundary_sigma_mm: args.boundary_mm,
        density_share: args.density_share,
        coefficient_share: args.k_share,
        samples: samples as usize,
        seed: args.draw_seed,
        keep: args.keep,
    })
}
