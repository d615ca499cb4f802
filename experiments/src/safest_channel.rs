//! The safest straight channel to the cochlea's basal turn, as for a cochlear implant through the facial recess: procedural temporal
//! bones and a segmented one, over the registration's error, each plan verified.
//!
//! The target is found from the labels, so that it needs no hand. On the segmented bone it is the most lateral voxel of the labyrinth
//! from 2.5 to 3.5 mm below the stapes' footplate (its most medial voxels): the lateral end of the basal turn, beside the round window. The
//! procedural cochlea is the ball at the labyrinth's front: there it is the most lateral voxel from 3 to 4 mm behind the foremost
//! one. The labyrinth is not a structure to keep, since the channel ends in it.
//!
//! The drill has a diameter of 1.5 mm, as published for this access (1.5 to 1.8 mm). A target registration error of 0.2 to 0.5 mm is 0.12 to
//! 0.29 mm along each axis.

use std::fmt::Write;
use std::path::Path;

use bonemill_geometry::{Ct, Point, Volume};
use bonemill_imaging::phantom::{PhantomKind, phantom};
use bonemill_imaging::{AffineChoice, read_labels};
use bonemill_planner::case::Case;
use bonemill_planner::channel::{self, ChannelPlan};
use bonemill_planner::plan::{Need, Replace, StagedDirectory, StoredPlan};
use bonemill_planner::report::CtSlices;
use bonemill_planner::verify::verify;
use bonemill_planner::{PlanError, Progress, save};

use crate::body::{Body, data};
use crate::{ExperimentError, Size, Table};

/// Standard deviations of the registration's error along each axis, mm.
const SIGMAS_MM: [f64; 4] = [0.1, 0.15, 0.2, 0.3];
/// That for which every structure is listed.
const LISTED_SIGMA_MM: f64 = 0.15;
/// Name, label and clearance, mm, of what is kept, in the order of importance.
type Kept = [(&'static str, u16, f64)];
const SEGMENTED: &Kept = &[
    ("facial_nerve", 10, 0.3),
    ("chorda_tympani", 11, 0.1),
    ("eac", 16, 0.1),
    ("incus", 3, 0.1),
    ("malleus", 2, 0.1),
    ("stapes", 4, 0.1),
    ("sinus_and_dura", 13, 0.5),
    ("ica", 12, 0.5),
];
const PROCEDURAL: &Kept =
    &[("facial_nerve", 1, 0.3), ("ear_canal", 3, 0.1), ("sigmoid_sinus", 4, 0.5), ("dura", 5, 0.5)];

/// The tables of channels and of what the first of each body keeps.
///
/// # Errors
/// [`ExperimentError`] where a body cannot be written, read or planned.
pub fn run(size: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let mut tables = [channels_table(), kept_table()];
    for seed in 1..=size.seeds {
        progress.stage(&format!("temporal {seed}"));
        let body = Body::phantom(&phantom(PhantomKind::Temporal, seed))?;
        let folder = body.case_path().parent().unwrap_or(Path::new("")).to_path_buf();
        let labels = read_labels(folder.join("labels.nii.gz"), AffineChoice::Auto)?.volume;
        let target = ball_at_the_front(&labels, 2);
        measure(&mut tables, &format!("temporal {seed}"), &folder, target, PROCEDURAL)?;
    }
    let folder = data().join("tbone_RT143");
    if folder.exists() {
        progress.stage("tbone_RT143");
        let labels = read_labels(folder.join("labels.nii.gz"), AffineChoice::Auto)?.volume;
        let target = below_the_stapes(&labels, 5, 4);
        measure(&mut tables, "tbone_RT143", &folder, target, SEGMENTED)?;
    } else {
        tables[0].push_note("tbone_RT143".into(), "left out: the scan is not there".into());
    }
    Ok(tables.into())
}

fn channels_table() -> Table {
    let title = "The safest channel to the basal turn, drill of 1.5 mm, allowed probability of touching 0.01: channels by the registration's \
                 standard deviation along each axis; the runner-up lies at least 5° away; the last columns are the verification's";
    let columns = [
        "body",
        "σ [mm]",
        "direction into the bone",
        "depth [mm]",
        "weighted margin [mm]",
        "runner-up's [mm]",
        "limited by",
        "its clearance [mm]",
        "probability",
        "meets the case",
        "lower 95 % end of the drawn probability",
        "checks passed",
    ];
    Table::new("safest-channel", title, &columns)
}

fn kept_table() -> Table {
    let title = format!(
        "What those channels keep at σ = {LISTED_SIGMA_MM} mm: clearance of the drill's surface and probability of touching"
    );
    let columns = ["body", "structure", "clearance [mm]", "asked for [mm]", "at depth [mm]", "probability"];
    Table::new("safest-channel-kept", title, &columns)
}

fn measure(
    tables: &mut [Table; 2],
    name: &str,
    folder: &Path,
    target: Option<Point<Ct>>,
    kept: &Kept,
) -> Result<(), ExperimentError> {
    let Some(target) = target else {
        tables[0].push_note(name.into(), "left out: its labels have no basal turn".into());
        return Ok(());
    };
    let scratch = tempfile::tempdir().map_err(ExperimentError::Folder)?;
    for sigma_mm in SIGMAS_MM {
        let text = case_text(folder, target, sigma_mm, kept);
        let case_path = scratch.path().join("case.toml");
        std::fs::write(&case_path, &text).map_err(ExperimentError::Folder)?;
        let case = Case::parse(&text, &case_path)?;
        let Some(spec) = case.job.channel() else { continue };
        let plan = match channel::plan(&case, spec, &case_path, &()) {
            Ok(plan) => plan,
            Err(PlanError::Channel(fault)) => {
                tables[0].push_note(name.into(), format!("σ = {sigma_mm} mm: {fault}"));
                continue;
            }
            Err(error) => return Err(error.into()),
        };
        let checked = verified(&plan, &case_path, &scratch.path().join("plan"))?;
        tables[0].push(row(name, sigma_mm, &plan, checked));
        if (sigma_mm - LISTED_SIGMA_MM).abs() < 1e-9 {
            for (found, of) in plan.channel.kept.iter().zip(&case.structures) {
                let Some(found) = found else { continue };
                tables[1].push(vec![
                    name.into(),
                    of.name.clone(),
                    format!("{:.3}", found.clearance_mm),
                    of.clearance_mm.to_string(),
                    format!("{:.1}", found.depth_mm),
                    format!("{:.1e}", found.touch_probability),
                ]);
            }
        }
    }
    Ok(())
}

/// The largest lower end of the drawn probabilities, and the checks that passed, of all.
fn verified(plan: &ChannelPlan, case_path: &Path, out: &Path) -> Result<(f64, [usize; 2]), ExperimentError> {
    let staged = StagedDirectory::create(out, Replace::Plan)?;
    save::channel(plan, case_path, &staged, CtSlices::Shown)?;
    let stored = StoredPlan::load_with(&staged.commit()?, None, Need::All)?;
    let found = verify(&stored, &())?.checks;
    let drawn = found.iter().filter(|check| check.name == "probability of touching");
    let most = drawn.map(|check| check.value).fold(0.0, f64::max);
    Ok((most, [found.iter().filter(|check| check.passed()).count(), found.len()]))
}

fn row(name: &str, sigma_mm: f64, plan: &ChannelPlan, checked: (f64, [usize; 2])) -> Vec<String> {
    let (drawn, [passed, all]) = checked;
    let d = plan.record.direction;
    let kept = plan.channel.kept.iter().zip(&plan.setup.case.structures);
    let kept = kept.filter_map(|(kept, of)| Some((kept.as_ref()?, of)));
    let limit = kept.min_by(|a, b| a.0.weighted_margin_mm.total_cmp(&b.0.weighted_margin_mm));
    let [limited, clearance, probability] = limit.map_or_else(Default::default, |(kept, of)| {
        [of.name.clone(), format!("{:.3}", kept.clearance_mm), format!("{:.1e}", kept.touch_probability)]
    });
    let runner_up = plan.found.channels.iter().find(|c| c.axis != plan.channel.axis);
    vec![
        name.into(),
        sigma_mm.to_string(),
        format!("{:.3}, {:.3}, {:.3}", d.x, d.y, d.z),
        format!("{:.1}", plan.record.depth_mm),
        format!("{:.3}", plan.channel.margin_mm()),
        runner_up.map_or("none".into(), |c| format!("{:.3}", c.margin_mm())),
        limited,
        clearance,
        probability,
        if plan.shortfalls.is_empty() { "yes".into() } else { "no".into() },
        format!("{drawn:.1e}"),
        format!("{passed} of {all}"),
    ]
}

fn case_text(folder: &Path, target: Point<Ct>, sigma_mm: f64, kept: &Kept) -> String {
    let mut text = format!(
        "[images]\nct = {:?}\nlabels = {:?}\n[approach]\ndirection = [1, 0, 0]\n",
        folder.join("ct.nii.gz"),
        folder.join("labels.nii.gz")
    );
    for (n, (name, label, clearance_mm)) in kept.iter().enumerate() {
        let _ = write!(
            text,
            "[[structure]]\nname = {name:?}\nlabel = {label}\nclearance_mm = {clearance_mm}\npriority = {}\n",
            n + 1
        );
    }
    let [x, y, z]: [f64; 3] = target.coords.into();
    let _ = write!(
        text,
        "[tool]\nkind = \"drill\"\n[drill]\nradius_mm = 0.75\npoint_deg = 59\nhelix_deg = 25\nchisel_deg = 116\nweb_mm = 0.1\nlips = 2\n\
         flute_mm = 25\nspindle_rpm = 1000\n[shank]\nsegments = [[40, 0.75], [60, 8]]\n[path]\npattern = \"plunge\"\ndirection = \"safest\"\n\
         target_mm = [{x}, {y}, {z}]\npeck_mm = 2\nregistration_sigma_mm = {sigma_mm}\n[robot]\nmodel = \"bone-attached\"\n"
    );
    text
}

/// The voxels of a label, ct.
fn voxels(labels: &Volume<u16, Ct>, label: u16) -> Vec<Point<Ct>> {
    let all = labels.data().iter().enumerate().filter(|(_, l)| **l == label);
    all.map(|(n, _)| labels.grid().center(labels.grid().voxel(n))).collect()
}

fn most_lateral(points: impl Iterator<Item = Point<Ct>>) -> Option<Point<Ct>> {
    points.max_by(|a, b| a.x().total_cmp(&b.x()))
}

/// The labyrinth's most lateral voxel from 2.5 to 3.5 mm below the stapes' footplate.
fn below_the_stapes(labels: &Volume<u16, Ct>, labyrinth: u16, stapes: u16) -> Option<Point<Ct>> {
    let stapes = voxels(labels, stapes);
    let medial_mm = stapes.iter().map(|p| p.x()).fold(f64::INFINITY, f64::min);
    let footplate: Vec<f64> = stapes.iter().filter(|p| p.x() < medial_mm + 0.6).map(|p| p.z()).collect();
    let height_mm = footplate.iter().sum::<f64>() / footplate.len() as f64;
    let below = voxels(labels, labyrinth).into_iter();
    most_lateral(below.filter(|p| (2.5..3.5).contains(&(height_mm - p.z()))))
}

/// The most lateral voxel from 3 to 4 mm behind a label's foremost one.
fn ball_at_the_front(labels: &Volume<u16, Ct>, label: u16) -> Option<Point<Ct>> {
    let all = voxels(labels, label);
    let front_mm = all.iter().map(|p| p.y()).fold(f64::NEG_INFINITY, f64::max);
    most_lateral(all.into_iter().filter(|p| (3.0..4.0).contains(&(front_mm - p.y()))))
}
