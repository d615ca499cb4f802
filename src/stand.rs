//! `bonemill stand`: searches where a UR may stand beside the patient.

use std::ffi::OsStr;
use std::path::Path;

use anyhow::Context;
use bonemill_planner::case::Registration;
use bonemill_planner::pages::stand::map;
use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::replace;
use bonemill_planner::stand::{Patch, Standing, search};
use bonemill_planner::{Progress, Setup, Stopwatch, stages};
use nalgebra::{Unit, Vector3};
use serde_json::json;

use crate::args::StandArgs;
use crate::outcome::Outcome;
use crate::plan::read_case;

/// How many of the reasons why places do not fit are told.
const REASONS: usize = 3;

pub fn run(args: &StandArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let patch = patch(args)?;
    let map_name = args.map.as_deref().map(named).transpose()?;
    progress.expect(stages::STAND);
    let mut case = read_case(&args.case)?;
    case.robot.base_from_ct = Registration::Assumed;
    let refused = |error| Refused::new(error, &case, &args.case);
    let mut watch = Stopwatch::new(progress);
    let setup = Setup::read(&case, &args.case, &mut watch).map_err(refused)?;
    let standing = watch.run("places", || search(&setup, patch)).map_err(refused)?;
    let mut told = summary(&standing);
    if let Some((folder, name)) = map_name {
        replace(folder, name, map(&standing).as_bytes())?;
        told += &format!("wrote {}\n", folder.join(name).display());
    }
    let warnings = (!standing.tilts && standing.best.is_some())
        .then(|| "no place holds the shaft's tilts (orientation.tilt_limit_deg): places were tried with the shaft straight".to_owned());
    let outcome = Outcome::values("stand", told, figures(&standing));
    let outcome = outcome.warning(&warnings.into_iter().collect::<Vec<_>>());
    Ok(match standing.best {
        Some(_) => outcome,
        None => outcome.falling_short(format!(
            "the arm fits at none of {} places: {}; try another patch (--from-mm, --to-mm), mount the handpiece at another angle \
             (robot.flange_from_burr), or allow more branches (robot.branch)",
            standing.places.len(),
            reasons(&standing)
        )),
    })
}

/// A map's folder and name.
fn named(path: &Path) -> anyhow::Result<(&Path, &str)> {
    let name = path.file_name().and_then(OsStr::to_str).filter(|name| name.ends_with(".svg"));
    let name =
        name.with_context(|| format!("--map {}: expected a file such as stand.svg", path.display()))?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Ok((folder, name))
}

fn patch(args: &StandArgs) -> anyhow::Result<Patch> {
    let vector = |name: &str, of: &[f64]| match of {
        [x, y, z] if [x, y, z].iter().all(|mm| mm.is_finite()) => Ok(Vector3::new(*x, *y, *z)),
        _ => anyhow::bail!("--{name}: expected three numbers, once"),
    };
    let up = Unit::try_new(vector("up", &args.up)?, 1e-6);
    let up = up.context("--up 0 0 0 is no direction; expected the way up in ct, e.g. 0 1 0 for a patient who lies on the back")?;
    let (from_mm, to_mm) = (vector("from-mm", &args.from_mm)?, vector("to-mm", &args.to_mm)?);
    Ok(Patch { up, from_mm, to_mm, step_mm: args.step_mm })
}

/// The most frequent reasons why places do not fit.
fn reasons(standing: &Standing) -> String {
    let faults = standing.faults();
    let told = faults.iter().take(REASONS).map(|fault| match fault.least_short_mm {
        Some(mm) => {
            format!("{} ({}, {mm:.1} mm short of robot.link_clearance_mm at best)", fault.why, fault.count)
        }
        None => format!("{} ({})", fault.why, fault.count),
    });
    told.collect::<Vec<_>>().join(", ")
}

fn summary(standing: &Standing) -> String {
    let (fitting, count) = (standing.fitting(), standing.places.len());
    let Some(best) = &standing.best else { return String::new() };
    let place = &standing.places[best.place];
    let at = place.at_mm;
    let mut told = format!(
        "the base stands best at {:.0}, {:.0}, {:.0} mm in ct from the target's centre, and everything fits within {:.0} mm of there\n\
         {fitting} of {count} places fit",
        at.x, at.y, at.z, place.tolerance_mm
    );
    if fitting < count {
        told += &format!("; the others: {}", reasons(standing));
    }
    told.push('\n');
    if let Some((mm, other)) = &best.links {
        told += &format!("links keep {mm:.0} mm or more, from {other}\n");
    }
    let rows: Vec<String> = best
        .base_from_ct
        .rotation
        .matrix()
        .row_iter()
        .map(|row| format!("[{:.9}, {:.9}, {:.9}]", row[0] + 0.0, row[1] + 0.0, row[2] + 0.0))
        .collect();
    let t = best.base_from_ct.translation_mm;
    told + &format!(
        "to plan from there, in [robot]; register the arm where it really stands:\n\
         base_from_ct = {{ rotation = [{}], translation_mm = [{:.3}, {:.3}, {:.3}] }}\n",
        rows.join(", "),
        t.x + 0.0,
        t.y + 0.0,
        t.z + 0.0
    )
}

fn figures(standing: &Standing) -> serde_json::Value {
    let vector = |v: &Vector3<f64>| [v.x, v.y, v.z];
    let faults: serde_json::Map<_, _> =
        standing.faults().into_iter().map(|fault| (fault.why.to_owned(), fault.count.into())).collect();
    let best = standing.best.as_ref().map(|best| {
        let place = &standing.places[best.place];
        let rows: Vec<[f64; 3]> =
            best.base_from_ct.rotation.matrix().row_iter().map(|row| [row[0], row[1], row[2]]).collect();
        json!({
            "from_target_mm": vector(&place.at_mm),
            "tolerance_mm": place.tolerance_mm,
            "links_mm": best.links.as_ref().map(|(mm, _)| mm),
            "links_near": best.links.as_ref().map(|(_, other)| other),
            "base_from_ct": { "rotation": rows, "translation_mm": vector(&best.base_from_ct.translation_mm) },
        })
    });
    json!({
        "places": standing.places.len(), "fitting": standing.fitting(), "tilts": standing.tilts, "faults": faults, "best": best,
    })
}
