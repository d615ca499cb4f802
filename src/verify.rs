//! `bonemill verify`: a second opinion on a plan, printed and kept as `verification.toml` beside it.

use anyhow::Context;
use bonemill_planner::Progress;
use bonemill_planner::plan::{Need, PlanFileError, StoredPlan, digests, is_prosthesis};
use bonemill_planner::save;
use bonemill_planner::uncertainty::{ErrorModel, Sigmas, UncertaintyError, simulate_errors};
use bonemill_planner::verify::{Check, Place, Verification, verify};

use crate::args::{ErrorArgs, VerifyArgs};
use crate::outcome::Outcome;

pub fn run(args: &VerifyArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let dir = &args.folder.plan;
    if is_prosthesis(dir).is_ok() {
        return crate::prosthesis::verify_folder(dir, args.all, progress);
    }
    progress.stage("read plan");
    let (mut drawn, mut warnings) = (None, Vec::new());
    let found = match args.folder.load(Need::All) {
        Ok(plan) => {
            // numbers that make no sense are refused before minutes go by
            let model = args.samples.map(|n| error_model(&plan, &args.errors, n)).transpose()?;
            let failed = || format!("the plan in {} cannot be verified", dir.display());
            let found = verify(&plan, progress).with_context(failed)?;
            warnings.clone_from(&plan.record.warnings);
            if let Some(model) = model {
                let risk = simulate_errors(&plan, &model, progress)?;
                drawn = Some((model, risk));
            }
            found
        }
        // a sound plan of something else: no other check would mean anything
        Err(PlanFileError::InputChanged { path, .. }) => Verification {
            checks: vec![
                Check::none_wrong("inputs unchanged", 1).at(Place::Named(path.display().to_string())),
            ],
            files: digests(dir)?,
        },
        Err(error) => {
            return Err(error).with_context(|| format!("the plan in {} cannot be read", dir.display()));
        }
    };
    progress.stage("write verdict");
    let drawn = drawn.as_ref().map(|(model, risk)| (model, risk));
    let path = save::verification(dir, &found, drawn)?;
    Ok(Outcome::verified(&path, &found, drawn, args.all).warning_first(&warnings))
}

/// The errors asked for.
fn error_model(plan: &StoredPlan, args: &ErrorArgs, samples: u32) -> Result<ErrorModel, UncertaintyError> {
    let sigmas = Sigmas {
        registration_mm: args.registration_mm,
        registration_rad: args.registration_deg.to_radians(),
        boundary_mm: args.boundary_mm,
        density_share: args.density_share,
        coefficient_share: args.k_share,
    };
    ErrorModel::about_path(plan, &sigmas, samples as usize, args.draw_seed, args.keep)
}
