//! `bonemill verify`: a second opinion on a plan, printed and written to `verification.toml` in its folder.

use anyhow::Context;
use bonemill_planner::Progress;
use bonemill_planner::plan::{Need, PlanFileError, StoredPlan, digests, is_prosthesis};
use bonemill_planner::save;
use bonemill_planner::stages;
use bonemill_planner::uncertainty::{ErrorModel, Sigmas, UncertaintyError, simulate_errors};
use bonemill_planner::verify::{Check, Place, Verification, verify};

use crate::args::{ErrorArgs, VerifyArgs};
use crate::outcome::Outcome;

pub fn run(args: &VerifyArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let dir = &args.folder.plan;
    if is_prosthesis(dir).is_ok() {
        if args.samples.is_some() {
            anyhow::bail!(
                "{} holds a prosthesis: --samples draws errors of a plan on a patient",
                dir.display()
            );
        }
        return crate::prosthesis::verify_folder(dir, args.all, progress);
    }
    progress.stage("read plan");
    let (mut drawn, mut warnings) = (None, Vec::new());
    let found = match args.folder.load(Need::All) {
        Ok(plan) => {
            // invalid numbers are refused before the verification, which takes minutes
            let model = args.samples.map(|n| error_model(&plan, &args.errors, n)).transpose()?;
            let checked = stages::of_verification(&plan.record.case);
            let drawn_after = if model.is_some() { stages::DRAW_ERRORS } else { &[] };
            progress.expect(&[&[stages::READ_PLAN], checked, drawn_after, &[stages::WRITE_VERDICT]].concat());
            let failed = || format!("the plan in {} cannot be verified", dir.display());
            let found = verify(&plan, progress).with_context(failed)?;
            warnings.clone_from(&plan.record.warnings);
            warnings.extend(found.shared_readers.iter().map(ToString::to_string));
            if let Some(model) = model {
                let risk = simulate_errors(&plan, &model, progress)?;
                drawn = Some((model, risk));
            }
            found
        }
        // the inputs have changed, so no other check has a meaning
        Err(PlanFileError::InputChanged { path, .. }) => Verification {
            checks: vec![
                Check::none_wrong("inputs unchanged", 1).at(Place::Named(path.display().to_string())),
            ],
            files: digests(dir)?,
            shared_readers: vec![],
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

/// The requested errors.
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
