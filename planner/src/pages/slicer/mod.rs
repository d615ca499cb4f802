//! A finished plan as files for 3D Slicer: a folder with one scene, `plan.mrml`, that refers to all others and to the case's CT.
//!
//! | file | what |
//! |---|---|
//! | `plan.seg.nrrd` | [`Segments`] on the CT's grid: cavity, removed beside the target, bone that remains, rest of the target by cause, structures |
//! | `plan.nii.gz`, `labels.json` | the same voxels as a label map, and the names of its labels |
//! | `cavity.stl`, `tool.stl`, `arm_base.stl` | surfaces; the tool where the motion begins, the base if the case says where it is |
//! | `path.mrk.json`, `approach.mrk.json`, `holds.mrk.json` | curves and points with speed and force at each |
//! | `forces.vtk` | the path as lines with force, force toward the structure and speed |
//!
//! Every file is in LPS and says so; [`bonemill_geometry::Rigid::lps_from_ct`] is the only conversion. Only the scene's camera and slices are in
//! RAS, in which 3D Slicer keeps them. Of the images nothing is written but which voxels belong to what. The same plan gives the same bytes.

mod bodies;
mod markups;
mod polydata;
mod scene;
mod segments;

use std::path::{Path, PathBuf};

use bonemill_geometry::{Ct, Lps, Point, Progress, Rigid};
use bonemill_imaging::part::stl_bytes_lps;
use bonemill_imaging::{write_labels_u8, write_segments};
use bonemill_planfile::{PlanFileError, Replace, StagedDirectory, StoredPlan, verified};
use bonemill_setup::PlanError;
use bonemill_setup::inputs::{CaseImages, images_and_scene_of};
use bonemill_toolpath::scene::Scene;
use serde_json::{Map, Value};

pub use segments::Segments;

use super::show::ShownTool;

/// A plan's CT in segments, and what they were found from.
struct Parted {
    segments: Segments,
    images: CaseImages,
    work: Scene,
    tool: ShownTool,
    removal: Vec<u32>,
}

impl Parted {
    fn of(plan: &StoredPlan, progress: &dyn Progress) -> Result<Self, PlanError> {
        let (images, work) = images_and_scene_of(plan, progress)?;
        progress.stage("removal");
        let tool = ShownTool::of(plan)?;
        let path: Vec<_> = plan.waypoints.iter().map(|w| work.ct_from_work.inverse() * w.position).collect();
        let removal = tool.removal(work.class.grid(), &path);
        progress.stage("causes of the rest");
        let segments = Segments::of(plan, &images, &work, &removal)?;
        Ok(Self { segments, images, work, tool, removal })
    }
}

/// What a plan removes and leaves, as segments of its CT.
///
/// # Errors
/// [`PlanError::File`] where an input of the plan is missing; otherwise [`PlanError`] for images that cannot be read or trusted.
pub fn segments(plan: &StoredPlan, progress: &dyn Progress) -> Result<Segments, PlanError> {
    plan.inputs.require()?;
    Ok(Parted::of(plan, progress)?.segments)
}

/// Writes the files of a plan into the folder `out`, whole or not at all; replaces an earlier scene there.
///
/// # Errors
/// [`PlanError::File`] where `out` holds anything else or cannot be written, or an input of the plan is missing; otherwise [`PlanError`] for images that
/// cannot be read or trusted.
pub fn export(plan: &StoredPlan, out: &Path, progress: &dyn Progress) -> Result<PathBuf, PlanError> {
    plan.inputs.require()?;
    let staged = StagedDirectory::create(out, Replace::Scene)?;
    let Parted { segments, images, work, tool, removal } = Parted::of(plan, progress)?;
    progress.stage("write files");
    write_segments(&staged.path().join("plan.seg.nrrd"), &segments.labels, &segments.list)?;
    write_labels_u8(staged.path().join("plan.nii.gz"), &segments.labels)?;
    let names: Map<String, Value> =
        segments.list.iter().map(|s| (s.label.to_string(), s.name.clone().into())).collect();
    staged.write("labels.json", Value::from(names).to_string() + "\n")?;

    let bodies = bodies::bodies(plan, &work, &tool, &removal)?;
    for (name, mesh) in &bodies {
        staged.write(&format!("{name}.stl"), stl_bytes_lps(mesh))?;
    }
    let markups = markups::markups(plan);
    for (name, text) in &markups {
        staged.write(&format!("{name}.mrk.json"), text)?;
    }
    staged.write("forces.vtk", polydata::forces(plan))?;

    let scene = scene::Contents {
        ct: ct_files(plan, &images.ct.provenance.files, &staged)?,
        bodies: bodies.iter().map(|(name, _)| *name).collect(),
        markups: markups.iter().map(|(name, _)| *name).collect(),
        is_verified: verified(&plan.dir).is_ok(),
        eye: scene::Eye::of(plan),
    };
    staged.write("plan.mrml", scene.text())?;
    Ok(staged.commit()?)
}

/// The CT's file, or those in its folder, from the scene's folder.
fn ct_files(
    plan: &StoredPlan,
    read: &[PathBuf],
    staged: &StagedDirectory,
) -> Result<Vec<PathBuf>, PlanFileError> {
    let named = plan.input_path(&plan.record.case.images.ct);
    let files = if named.is_dir() { read } else { std::slice::from_ref(&named) };
    files.iter().map(|file| staged.relative(file)).collect()
}

/// A point of a plan as the files have it: x to the left, y to the back, z up, mm.
fn lps(p: Point<Ct>) -> [f64; 3] {
    (Rigid::<Lps, Ct>::lps_from_ct() * p).coords.map(|c| c + 0.0).into()
}
