//! A folder with one mask per structure, as TotalSegmentator writes it: the files' names are the structures' names.
//!
//! Every image file in the folder is a mask; voxels that are not 0 belong to its structure. Masks may overlap, and must lie on one grid.
//! Labels are numbered by the order of the names, from 1.

use std::fs;
use std::path::{Path, PathBuf};

use bonemill_geometry::{Ct, Grid, Volume};

use super::labels::{Drawing, LabelMap, same_grid};
use super::problem::FormatProblem;
use super::{AffineChoice, Image, Provenance, read_labels};
use crate::error::ImageError;
use crate::names::LabelNames;

/// Endings of image files, the longer before its own end.
pub const MASK_ENDINGS: &[&str] = &[".nii.gz", ".nii", ".nrrd", ".nhdr", ".mha", ".mhd"];

/// The image files in a folder with their names without ending, in the order of the names.
pub(super) fn files(folder: &Path) -> Vec<(String, PathBuf)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let named = entries.filter_map(|path| {
        let name = path.file_name()?.to_str()?.to_owned();
        let stem = MASK_ENDINGS.iter().find_map(|ending| name.strip_suffix(ending))?;
        path.is_file().then(|| (stem.to_owned(), path.clone()))
    });
    let mut all: Vec<_> = named.collect();
    all.sort();
    all
}

/// Reads the masks of a folder as one map.
///
/// # Errors
/// [`ImageError`] for a mask that cannot be read, and for masks on different grids.
pub(super) fn read(
    folder: &Path,
    files: &[(String, PathBuf)],
    choice: AffineChoice,
) -> Result<LabelMap, ImageError> {
    let failed = |problem| ImageError::Format { path: folder.into(), problem };
    let mut made: Option<(Image<()>, Drawing, Grid<Ct>)> = None;
    let mut names = Vec::new();
    for (place, (name, path)) in files.iter().enumerate() {
        let number = u16::try_from(place + 1)
            .map_err(|_| failed(FormatProblem::field("masks", &files.len().to_string(), "at most 65535")))?;
        let mask = read_labels(path, choice)?;
        let grid = mask.volume.grid().clone();
        let (image, drawing, first) = made.get_or_insert_with(|| {
            let volume = Volume::filled(grid.clone(), ());
            let provenance = Provenance { files: vec![], placement: mask.provenance.placement };
            (Image { volume, provenance, warnings: vec![] }, Drawing::new(grid.len()), grid.clone())
        });
        if !same_grid(first, &grid) {
            let first = files.first().map(|(_, path)| path.clone()).unwrap_or_default();
            return Err(failed(FormatProblem::OtherGrid { path: path.clone(), first }));
        }
        let voxels = mask.volume.data().iter().enumerate().filter(|(_, value)| **value != 0);
        voxels.for_each(|(place, _)| drawing.draw(place, number));
        image.provenance.files.extend(mask.provenance.files);
        image.warnings.extend(mask.warnings);
        names.push((number, name.clone()));
    }
    let Some((Image { provenance, mut warnings, .. }, drawing, grid)) = made else {
        return Err(failed(FormatProblem::Empty));
    };
    warnings.dedup();
    let (labels, further) = drawing.finish();
    let volume = Volume::new(grid, labels).map_err(|_| failed(FormatProblem::Empty))?;
    let names = LabelNames::new(names)
        .map_err(|_| failed(FormatProblem::NameTwice { name: "of two files".into() }))?;
    Ok(LabelMap { image: Image { volume, provenance, warnings }, names: Some(names), further })
}
