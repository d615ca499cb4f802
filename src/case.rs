//! `bonemill case`: makes a commented case file from a CT and labels.

use std::path::{Path, PathBuf};

use anyhow::Context;
use bonemill_imaging::series_name;
use bonemill_imaging::slicer::{read_base_from_ct, read_markups};
use bonemill_planner::Progress;
use bonemill_planner::case::draft::{
    self, Choice, Drafted, FoundLabel, ImagePaths, KnownPlace, Role, SideFound, TargetChoice, TargetWish,
    Wishes,
};
use bonemill_planner::case::{Case, LabelRef, Target};
use bonemill_planner::plan::{relative_path, replace};
use bonemill_planner::survey::Survey;
use nalgebra::Vector3;
use serde_json::{Value, json};

use crate::args::CaseArgs;
use crate::outcome::Outcome;
use crate::phantom::{shell_word, vacant_beside};

pub fn run(args: &CaseArgs, progress: &dyn Progress) -> anyhow::Result<Outcome> {
    let out = Output::of(args)?;
    let named = |path: &Path| relative_path(&out.folder, path).map_err(anyhow::Error::from);
    let (labels, masks) = args.labels.split_first().context("expected a label file")?;
    let images = ImagePaths {
        ct: named(&args.ct)?,
        ct_series: args.ct_series.as_deref().map(series_name),
        labels: named(labels)?,
    };
    let masks: Vec<(PathBuf, PathBuf)> =
        masks.iter().map(|mask| Ok((mask.clone(), named(mask)?))).collect::<anyhow::Result<_>>()?;
    each_once(&images.labels, &masks)?;
    let approach = args.approach.as_deref().map(approach).transpose()?;
    let place = known_place(args)?;
    progress.stage("read images");
    let survey = Survey::read(&args.ct, args.ct_series.as_deref(), (labels, &images.labels), &masks)?;
    let choice = draft::choose(&survey.labels, &wishes(args)).inspect_err(|_| {
        // what there is to choose from
        progress.note(table(&survey.labels, None).trim_end());
    })?;
    let known = (args.robot.as_str(), approach, place);
    let (side, drafted) = survey.draft(images, &choice, known, &out.path)?;
    progress.stage("write case");
    replace(&out.folder, &out.name, drafted.text.as_bytes())?;
    let text = table(&survey.labels, Some(&choice)) + &summary(&out.path, &drafted, &side);
    let warnings = [survey.warnings, drafted.notes.clone()].concat();
    let values = figures(&survey.labels, &choice, &drafted.case, &side);
    Ok(Outcome::drafted(&out.path, text, values).warning(&warnings))
}

/// Where the case is written.
struct Output {
    path: PathBuf,
    folder: PathBuf,
    name: String,
}

impl Output {
    /// Refuses what is no case file by its name, and what exists, unless it may be replaced.
    fn of(args: &CaseArgs) -> anyhow::Result<Self> {
        let path = args.out.clone();
        let name = path.file_name().and_then(|name| name.to_str()).filter(|name| name.ends_with(".toml"));
        let name = name.map(str::to_owned);
        let name =
            name.with_context(|| format!("--out {}: expected a file such as case.toml", path.display()))?;
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if let Ok(there) = path.symlink_metadata() {
            if !there.is_file() {
                anyhow::bail!(
                    "{} is no ordinary file, and is not replaced: choose another name",
                    path.display()
                );
            }
            if !args.force {
                anyhow::bail!("{} exists: choose another name, or --force to replace it", path.display());
            }
        }
        Ok(Self { folder: folder.into(), name, path })
    }
}

/// Refuses a label file that is given twice.
fn each_once(labels: &Path, masks: &[(PathBuf, PathBuf)]) -> anyhow::Result<()> {
    for (n, (_, named)) in masks.iter().enumerate() {
        let earlier = masks.iter().take(n).map(|(_, other)| other.as_path()).chain([labels]);
        if earlier.into_iter().any(|other| other == named) {
            anyhow::bail!("the label file {} is given twice; expected once", named.display());
        }
    }
    Ok(())
}

/// Out of the bone: from the last of a line's points to the first.
fn approach(path: &Path) -> anyhow::Result<Vector3<f64>> {
    let points = read_markups(path)?.points;
    match points.as_slice() {
        [outside, .., inside] => Ok(outside.position.coords - inside.position.coords),
        _ => anyhow::bail!(
            "{}: {} point; expected a line or curve whose first point is outside and whose last is inside the bone",
            path.display(),
            points.len()
        ),
    }
}

fn known_place(args: &CaseArgs) -> anyhow::Result<KnownPlace> {
    if let Some(path) = &args.registration {
        return Ok(KnownPlace::Registered(read_base_from_ct(path)?));
    }
    let Some(path) = &args.fiducials else { return Ok(KnownPlace::Unknown) };
    let points: Vec<_> = read_markups(path)?.points.iter().map(|point| point.position).collect();
    if points.len() < 3 {
        anyhow::bail!("{}: {} points; expected at least three fiducials", path.display(), points.len());
    }
    Ok(KnownPlace::Fiducials(points))
}

fn wishes(args: &CaseArgs) -> Wishes {
    let ball = match args.target_ball_mm.as_deref() {
        Some([x, y, z, radius_mm]) => {
            Some(Target::Ball { center_mm: Vector3::new(*x, *y, *z), radius_mm: *radius_mm })
        }
        _ => None,
    };
    let frustum = match args.target_frustum_mm.as_deref() {
        Some([x, y, z, from_radius_mm, to_x, to_y, to_z, to_radius_mm]) => Some(Target::Frustum {
            from_mm: Vector3::new(*x, *y, *z),
            to_mm: Vector3::new(*to_x, *to_y, *to_z),
            from_radius_mm: *from_radius_mm,
            to_radius_mm: *to_radius_mm,
        }),
        _ => None,
    };
    let label = args.target.clone().map(TargetWish::Label);
    let target = label.or(ball.or(frustum).map(TargetWish::Shape));
    Wishes { target, structures: args.structure.clone(), ignored: args.ignore.clone() }
}

/// Every label on a line, with what it is taken for where that is known.
fn table(labels: &[FoundLabel], choice: Option<&Choice>) -> String {
    let name = |label: &FoundLabel| label.name.clone().unwrap_or_default();
    let width = labels.iter().map(|label| name(label).chars().count()).max().unwrap_or(0).max(4);
    let mut text = format!(
        "{:>6}  {:width$}  {:>12}  {:>7}  {:>13}  taken for\n",
        "label", "name", "mm³", "mean HU", "5 to 95 %"
    );
    for (n, label) in labels.iter().enumerate() {
        let number = match &label.of {
            LabelRef::File { label: None, .. } => "mask".into(),
            LabelRef::File { label: Some(_), .. } => "file".into(),
            _ => label.number.to_string(),
        };
        let hu = label.survey.as_ref().and_then(|survey| survey.hu);
        let mean = hu.map_or("-".into(), |hu| format!("{:.0}", hu.mean_hu));
        let range = hu.map_or("-".into(), |hu| format!("{} to {}", hu.low_hu, hu.high_hu));
        let role = choice.and_then(|choice| choice.roles.get(n)).map_or("", |role| role.words());
        let line = format!(
            "{number:>6}  {:width$}  {:>12.1}  {mean:>7}  {range:>13}  {role}",
            name(label),
            label.volume_mm3()
        );
        text += line.trim_end();
        text.push('\n');
    }
    text
}

fn summary(out: &Path, drafted: &Drafted, side: &SideFound) -> String {
    let spared: Vec<&str> = drafted.case.structures.iter().map(|structure| structure.name.as_str()).collect();
    let spared = if spared.is_empty() { "nothing".into() } else { spared.join(", ") };
    let known = side.side.map_or("not known", |side| side.word());
    let plan = vacant_beside(&out.with_extension(""));
    format!(
        "spares {spared}\nside {known}: {}\nwrote {}; read it, then: bonemill plan {} --out {}\n",
        side.reason,
        out.display(),
        shell_word(out),
        shell_word(&plan)
    )
}

/// The same for machines.
fn figures(labels: &[FoundLabel], choice: &Choice, case: &Case, side: &SideFound) -> Value {
    let label = |(label, role): (&FoundLabel, &Role)| {
        let hu = label.survey.as_ref().and_then(|survey| survey.hu);
        json!({
            "number": label.of.file().is_none().then_some(label.number),
            "name": label.name,
            "file": label.of.file().map(|file| file.to_string_lossy()),
            "volume_mm3": label.volume_mm3(),
            "mean_hu": hu.map(|hu| hu.mean_hu),
            "hu_05_95": hu.map(|hu| [hu.low_hu, hu.high_hu]),
            "taken_for": role.words(),
        })
    };
    let structures: Vec<Value> = case
        .structures
        .iter()
        .map(|s| json!({ "name": s.name, "clearance_mm": s.clearance_mm, "priority": s.priority }))
        .collect();
    let target = match choice.target {
        TargetChoice::Label(place) => labels.get(place).filter(|label| label.of.file().is_none()),
        TargetChoice::Shape(_) => None,
    };
    json!({
        "labels": labels.iter().zip(&choice.roles).map(label).collect::<Vec<_>>(),
        "target_label": target.map(|label| label.number),
        "structures": structures,
        "side": side.side.map(|side| side.word()),
        "side_reason": side.reason,
    })
}
