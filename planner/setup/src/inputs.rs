//! The images of a case, read and checked, the files that its plan depends on, and the scene made of them.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use bonemill_case::{Case, LabelRef, OrientationMode, Target, TargetRegion};
use bonemill_geometry::{Ct, Point, Progress};
use bonemill_imaging::{
    AffineChoice, Fit, Image, ImageError, LabelMap, Provenance, available_memory_mb, label_names_path,
    looks_like_hu, padding_to_air, read_ct_series, read_label_map, read_label_names,
};
use bonemill_planfile::{Input, PlanFileError, StoredPlan};
use bonemill_toolpath::scene::{
    ApproachSpec, ArmHolds, MemoryNeed, Scene, SceneSpec, ToolReach, WayInTool, build_scene,
};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::label_files::{LabelFiles, NamesAt, label_number, names_of};
use super::reach::{StandingArm, assumed_tilts};
use super::{PlanError, channel};

/// Distances to structures are kept this far from the target's box, mm, beside what the burr and its cost need.
const STRUCTURE_FIELD_MARGIN_MM: f64 = 12.0;

/// What planning takes at its peak for each voxel of its grid, bytes: 59 to 65 measured at 0.15 and 0.1 mm on both phantoms and
/// a temporal bone.
const BYTES_PER_VOXEL: f64 = 66.0;
/// What it takes beside that and the images, MB: the program, and what belongs to waypoints.
const WAYPOINTS_MB: f64 = 100.0;

/// The memory that planning on a scene takes at its peak, MB, about.
pub fn memory_mb(scene: &Scene, inputs: &CaseImages) -> f64 {
    let images = 4 * inputs.ct.volume.grid().len() + 2 * inputs.labels.volume.grid().len();
    WAYPOINTS_MB + 1e-6 * (BYTES_PER_VOXEL * scene.class.grid().len() as f64 + images as f64)
}

/// The images of a case.
pub struct CaseImages {
    /// Grey values.
    pub ct: Image<f32>,
    /// Labels.
    pub labels: Image<u16>,
    /// Further labels of its voxels, by their places in memory, where structures overlap.
    pub further: Vec<(u32, u16)>,
    /// Further files of labels and their names, as the case names them.
    pub label_files: Vec<PathBuf>,
    /// Names of labels, and the file that holds them.
    pub names: Option<NamesAt>,
    /// What is to be removed.
    pub target: Target<u16>,
    /// What belongs to it besides.
    pub also: Vec<TargetRegion<u16>>,
    /// What is taken away from it.
    pub less: Vec<TargetRegion<u16>>,
    /// Name and label of each structure, in the case's order.
    pub structures: Vec<(String, u16)>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// Reads and checks the images of a case in `case_path`; notes every file that its plan depends on, with its digest and where
/// it is: case, images, names of labels, an arm's
/// and a tool's own files.
pub fn read_inputs(case: &Case, case_path: &Path) -> Result<(CaseImages, Vec<(Input, PathBuf)>), PlanError> {
    let folder = case_path.parent().unwrap_or(Path::new(""));
    let images = read_images(case, |path| folder.join(path))?;
    let names = label_names_path(&case.images.labels);
    let mut paths: Vec<&Path> = case_path.file_name().map(Path::new).into_iter().collect();
    let [ct, labels] = [
        named_files(&case.images.ct, &folder.join(&case.images.ct), &images.ct.provenance),
        named_files(&case.images.labels, &folder.join(&case.images.labels), &images.labels.provenance),
    ];
    paths.extend(ct.iter().chain(&labels).chain(&images.label_files).map(PathBuf::as_path));
    paths.extend(folder.join(&names).exists().then_some(names.as_path()));
    paths.extend(case.robot.files().chain(case.tool.files()).map(|(_, path)| path));
    // a file may hold several labels
    let mut earlier = BTreeSet::new();
    paths.retain(|path| earlier.insert(*path));
    let noted = |path: &&Path| Ok((Input::now(folder, path)?, folder.join(path)));
    let files = paths.par_iter().map(noted).collect::<Result<_, PlanError>>()?;
    Ok((images, files))
}

/// An image's files as the case names them: below the folder that it names, the file itself, or beside it.
pub(super) fn named_files(named: &Path, place: &Path, provenance: &Provenance) -> Vec<PathBuf> {
    let beside = (place.parent(), named.parent());
    let name = |file: &PathBuf| match (file.strip_prefix(place), beside) {
        (Ok(below), _) if !below.as_os_str().is_empty() => named.join(below),
        (Ok(_), _) => named.into(),
        // voxels in a file that a header names
        (Err(_), (Some(place), Some(named))) => {
            file.strip_prefix(place).map_or_else(|_| file.clone(), |rest| named.join(rest))
        }
        _ => file.clone(),
    };
    provenance.files.iter().map(name).collect()
}

/// A CT and a label map as they are read, whatever a case makes of them.
pub(super) struct PlainImages {
    /// Grey values; padding is air.
    pub ct: Image<f32>,
    /// Voxels of padding.
    pub padding_voxels: usize,
    /// Labels.
    pub map: LabelMap,
    /// Names of labels, and the file that holds them.
    pub names: Option<NamesAt>,
}

/// Reads a CT (and of a folder with several series that with a name), which must be in HU, and a label map
/// with the file of its names, which need not be there.
pub(super) fn read_plain(
    (ct, ct_affine, series): (&Path, AffineChoice, Option<&str>),
    (labels, labels_affine, names): (&Path, AffineChoice, &Path),
) -> Result<PlainImages, ImageError> {
    let (ct, map) = rayon::join(
        || -> Result<_, ImageError> {
            let mut ct = read_ct_series(ct, ct_affine, series)?;
            looks_like_hu(&ct.volume)?;
            let padding_voxels = padding_to_air(&mut ct.volume);
            Ok((ct, padding_voxels))
        },
        || -> Result<_, ImageError> {
            let beside = read_label_names(names)?;
            Ok((read_label_map(labels, labels_affine)?, beside))
        },
    );
    let ((ct, padding_voxels), (mut map, beside)) = (ct?, map?);
    let names = names_of(&mut map, beside, labels);
    Ok(PlainImages { ct, padding_voxels, map, names })
}

/// Reads and checks the images of a case; `place` says where the file is that the case names so.
pub fn read_images(case: &Case, place: impl Fn(&Path) -> PathBuf + Sync) -> Result<CaseImages, PlanError> {
    let labels_path = place(&case.images.labels);
    let PlainImages { ct, padding_voxels: padding, map, names } = read_plain(
        (&place(&case.images.ct), case.images.ct_affine, case.images.ct_series.as_deref()),
        (&labels_path, case.images.labels_affine, &place(&label_names_path(&case.images.labels))),
    )?;
    let mut files = LabelFiles::new(case, &place, ct.volume.grid(), (map, names));
    let target = case.target.with_label(|label| {
        files.number((format!("target.{}", label.key()), "target".into()), label, Fit::Centres)
    })?;
    let mut regions = |list: &str, regions: &[TargetRegion], how| -> Result<Vec<_>, PlanError> {
        let number = |(n, region): (usize, &TargetRegion)| {
            let table = format!("target.{list}[{n}]");
            region.with_label(|label| {
                files.number((format!("{table}.{}", label.key()), table.clone()), label, how)
            })
        };
        regions.iter().enumerate().map(number).collect()
    };
    let also = regions("also", &case.also, Fit::Centres)?;
    let less = regions("less", &case.less, Fit::Touched)?;
    let mut structures = Vec::new();
    for (n, s) in case.structures.iter().enumerate() {
        let named = (format!("structure '{}'", s.name), format!("structure[{n}]"));
        structures.push((s.name.clone(), files.number(named, &s.label, Fit::Touched)?));
    }
    files.map_lies_at_ct()?;
    let LabelFiles { mut map, names, read: label_files, warnings: of_files, .. } = files;
    labels_differ(&target, &also, &structures)?;
    let mut warnings: Vec<String> =
        ct.warnings.iter().chain(&map.image.warnings).map(ToString::to_string).collect();
    if padding > 0 {
        warnings.push(format!("{padding} voxels of the CT are below -1500 HU, outside the scanner's field of view: taken for air"));
    }
    warnings.extend(of_files);
    warnings.extend(settle(&mut map, (&target, &also, &less), &structures));
    let LabelMap { image: labels, further, .. } = map;
    Ok(CaseImages { ct, labels, further, names, label_files, target, also, less, structures, warnings })
}

/// Target, what belongs to it besides, and what is taken away.
type Regions<'a> = (&'a Target<u16>, &'a [TargetRegion<u16>], &'a [TargetRegion<u16>]);

/// Where labels share voxels a structure is shown first, then what is taken away from the target, then the target. What the user
/// should know of it.
fn settle(
    map: &mut LabelMap,
    (target, also, less): Regions<'_>,
    structures: &[(String, u16)],
) -> Vec<String> {
    let of_label = |of: &Target<u16>, label| matches!(of, Target::Label(own) if *own == label);
    let shared = map.settle(|label| {
        if structures.iter().any(|(_, own)| *own == label) {
            3
        } else if less.iter().any(|region| of_label(&region.of, label)) {
            2
        } else {
            u8::from(of_label(target, label) || also.iter().any(|region| of_label(&region.of, label)))
        }
    });
    let voxel_mm3 = map.image.volume.grid().voxel_mm3();
    let name = |label| structures.iter().find(|(_, own)| *own == label).map(|(name, _)| name);
    let told = shared.iter().filter_map(|s| {
        let mm3 = s.voxels as f64 * voxel_mm3;
        match (name(s.shown), name(s.other)) {
            (Some(a), Some(b)) => {
                Some(format!("structures '{a}' and '{b}' share {mm3:.2} mm³, which belong to both"))
            }
            (Some(a), None) => {
                let part = if of_label(target, s.other) {
                    "the target"
                } else {
                    "what target.also or target.less names"
                };
                Some(format!("structure '{a}' shares {mm3:.2} mm³ with {part}, which the structure keeps"))
            }
            _ => None,
        }
    });
    told.collect()
}

/// The number of a label that the case names.
///
/// # Errors
/// [`PlanError::LabelName`] and [`PlanError::NoLabelNames`] for a name without number.
pub fn label_of(
    key: &str,
    label: &LabelRef,
    images: &CaseImages,
    labels_path: &Path,
) -> Result<u16, PlanError> {
    label_number(key.into(), label, images.names.as_ref(), labels_path)
}

/// Refuses a label that two structures, or a structure and the target, have by number and by name. The target may well be
/// less a structure, with a margin.
fn labels_differ(
    target: &Target<u16>,
    also: &[TargetRegion<u16>],
    structures: &[(String, u16)],
) -> Result<(), PlanError> {
    let also = also.iter().enumerate().map(|(n, region)| (format!("target.also[{n}]"), &region.of));
    let drawn = [("the target".to_owned(), target)].into_iter().chain(also);
    let mut taken: Vec<(String, u16)> = drawn
        .filter_map(|(what, of)| if let Target::Label(number) = of { Some((what, *number)) } else { None })
        .collect();
    for (place, (name, number)) in structures.iter().enumerate() {
        let (second, number) = (format!("structure '{name}'"), *number);
        if let Some((first, _)) = taken.iter().find(|(_, earlier)| *earlier == number) {
            return Err(PlanError::SharedLabel { first: first.clone(), second, number, place });
        }
        taken.push((second, number));
    }
    Ok(())
}

/// The scene that a case makes of its images; `arm`: where its place is known, so that an approach that is not given is one along which it holds the tool.
///
/// # Errors
/// [`PlanError::Scene`].
pub fn make_scene(
    case: &Case,
    inputs: &CaseImages,
    arm: Option<&StandingArm<'_>>,
) -> Result<Scene, PlanError> {
    let holds = |places: &[Point<Ct>], shaft: &Vector3<f64>| arm.is_none_or(|arm| arm.holds(places, shaft));
    let approach = match (case.job.channel(), case.approach) {
        (Some(_), Some(direction)) => ApproachSpec::Fixed(direction),
        _ => ApproachSpec::For {
            given: case.approach,
            tool: way_in_tool(case, arm),
            arm: arm.is_some().then_some(ArmHolds(&holds)),
        },
    };
    make_scene_of(case, (inputs.target.clone(), approach), inputs)
}

/// The tool as far as the way in depends on it.
fn way_in_tool(case: &Case, arm: Option<&StandingArm<'_>>) -> WayInTool {
    let straight = case.orientation.mode == OrientationMode::Fixed;
    let angles = case.orientation.angles;
    WayInTool {
        shank_mm: case.shank.iter().map(|s| [s.length_mm, s.radius_mm]).collect(),
        tilt_limit_rad: if straight { 0.0 } else { case.orientation.tilt_limit_rad },
        tilts: arm.map_or_else(|| assumed_tilts(angles), |arm| arm.tilts(angles)),
    }
}

/// The same with another target than the one that was read with the images, along an approach.
///
/// # Errors
/// [`PlanError::Scene`].
pub fn make_scene_of(
    case: &Case,
    (target, approach): (Target<u16>, ApproachSpec<'_>),
    inputs: &CaseImages,
) -> Result<Scene, PlanError> {
    Ok(build_scene(&SceneSpec {
        ct: &inputs.ct.volume,
        labels: &inputs.labels.volume,
        further: &inputs.further,
        labels_affine: inputs.labels.provenance.placement.is_nifti().then_some(case.images.labels_affine),
        target,
        also: &inputs.also,
        less: &inputs.less,
        is_swept: case.job.channel().is_some(),
        structures: &inputs.structures,
        clearances_mm: &case.clearances_mm(),
        table: &case.density.table,
        air_hu: case.density.air_hu,
        bone_hu: case.density.bone_hu,
        sheets: case.sheets,
        approach,
        spacing_mm: case.grid.spacing_mm,
        memory: MemoryNeed { bytes_per_voxel: BYTES_PER_VOXEL, available_mb: available_memory_mb() },
        margin_mm: case.grid.margin_mm,
        tool: ToolReach {
            cutter_radius_mm: case.burr.radius_mm,
            shank_length_mm: case.burr.radius_mm + case.shank.iter().map(|s| s.length_mm).sum::<f64>(),
            shank_radius_mm: case.shank.iter().map(|s| s.radius_mm).fold(0.0, f64::max),
            influence_mm: 2.0 * case.burr.radius_mm
                + case
                    .structures
                    .iter()
                    .map(|s| s.clearance_mm.max(s.shank_clearance_mm))
                    .fold(0.0, f64::max)
                + STRUCTURE_FIELD_MARGIN_MM,
        },
    })?)
}

/// The images of a finished plan's case.
///
/// # Errors
/// [`PlanError`] for images that are missing or cannot be read or trusted, and for a folder with files that were not there when the
/// plan was made.
pub fn images_of(plan: &StoredPlan, case: &Case) -> Result<CaseImages, PlanError> {
    let images = read_images(case, |path| plan.input_path(path))?;
    let known: Vec<PathBuf> = plan.record.inputs.iter().map(|input| plan.input_path(&input.path)).collect();
    for (named, of) in
        [(&case.images.ct, &images.ct.provenance), (&case.images.labels, &images.labels.provenance)]
    {
        let added = of.files.iter().find(|file| !known.contains(file));
        if let Some(file) = added.filter(|_| plan.input_path(named).is_dir()) {
            let (path, missing) = (plan.dir.clone(), file.display().to_string());
            return Err(PlanFileError::InputNotListed { path, missing }.into());
        }
    }
    let is_listed = |file: &&PathBuf| plan.record.inputs.iter().any(|input| input.path == **file);
    if let Some(file) = images.label_files.iter().find(|file| !is_listed(file)) {
        let (path, missing) = (plan.dir.clone(), file.display().to_string());
        return Err(PlanFileError::InputNotListed { path, missing }.into());
    }
    Ok(images)
}

/// The scene of a finished plan, as it was planned on.
///
/// # Errors
/// As [`images_and_scene_of`].
pub fn scene_of(plan: &StoredPlan, progress: &dyn Progress) -> Result<Scene, PlanError> {
    Ok(images_and_scene_of(plan, progress)?.1)
}

/// The images of a finished plan, and the scene that it was planned on.
///
/// # Errors
/// [`PlanError`] for images that are missing or cannot be read or trusted.
pub fn images_and_scene_of(
    plan: &StoredPlan,
    progress: &dyn Progress,
) -> Result<(CaseImages, Scene), PlanError> {
    let case = &channel::scene_case_of(&plan.record);
    progress.stage("read images");
    let images = images_of(plan, case)?;
    progress.stage("scene");
    let approach = ApproachSpec::Fixed(plan.record.frames.approach_direction);
    let scene = make_scene_of(case, (images.target.clone(), approach), &images)?;
    Ok((images, scene))
}
