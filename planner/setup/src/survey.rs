//! What a CT and label files hold, for a case that is made of them: every label with its volume and grey values.
//!
//! Images are read and judged as planning reads them, so that what is surveyed is what will be planned on.

use std::path::{Path, PathBuf};

use bonemill_case::draft::{
    self, Choice, Draft, DraftError, Drafted, FoundLabel, ImagePaths, KnownPlace, SideFound, TargetChoice,
};
use bonemill_case::{DEFAULT_BONE_HU, LabelRef};
use bonemill_geometry::{Ct, Grid, Volume};
use bonemill_imaging::{
    AffineChoice, Fit, ImageError, LabelMap, LabelSurvey, MASK_ENDINGS, bone_extent_x_mm, label_names_path,
    labels_beside, read_label_map, read_label_names, survey_labels,
};
use bonemill_toolpath::scene::{Displaced, label_extents};
use nalgebra::Vector3;
use thiserror::Error;

use super::inputs::{PlainImages, read_plain};
use super::label_files::{LabelFileFault, lies_with, names_of};

/// Endings of label files that are no mask in a folder; the longer before its own end.
const ENDINGS: &[&str] = &[".seg.nrrd", ".dcm"];

/// Why images cannot be surveyed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum SurveyError {
    /// An image or its names cannot be read or trusted.
    #[error(transparent)]
    Image(#[from] ImageError),
    /// A further label file gives no label.
    #[error("{} {fault}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Why not.
        fault: LabelFileFault,
    },
}

/// The images of a case to be made.
pub struct Survey {
    /// Every label of the map, ascending, then those of the further files.
    pub labels: Vec<FoundLabel>,
    /// From where to where bone reaches in x, ct, mm.
    pub bone_x_mm: Option<[f64; 2]>,
    /// Diagonal of a voxel of the label map, mm.
    pub diagonal_mm: f64,
    /// Oddities of the files.
    pub warnings: Vec<String>,
    ct: Grid<Ct>,
    map: Volume<u16, Ct>,
    further: Vec<(u32, u16)>,
}

impl Survey {
    /// Reads a CT, a label map, and further files of labels or masks, each with its path as the case will name it.
    ///
    /// # Errors
    /// [`SurveyError`] for an image that cannot be read or trusted, and a file without a label.
    pub fn read(
        ct_path: &Path,
        series: Option<&str>,
        (labels, labels_named): (&Path, &Path),
        further_files: &[(PathBuf, PathBuf)],
    ) -> Result<Self, SurveyError> {
        let PlainImages { ct, mut map, names, .. } = read_plain(
            (ct_path, AffineChoice::Auto, series),
            (labels, AffineChoice::Auto, &label_names_path(labels)),
        )?;
        let names = names.map(|(names, _)| names);
        let of_ct = ct.warnings.iter().map(|warning| (ct_path, warning));
        let of_map = map.image.warnings.iter().map(|warning| (labels, warning));
        let mut warnings: Vec<String> =
            of_ct.chain(of_map).map(|(path, warning)| format!("{}: {warning}", path.display())).collect();
        warnings.extend(beside(ct.volume.grid(), &map).map(|text| format!("{}: {text}", labels.display())));
        // one label without a name, in a file: its name is the file's
        let own = map.labels();
        let is_mask = own.len() == 1 && names.is_none() && labels.is_file();
        let own_grid = map.image.volume.grid().clone();
        let mut added = Vec::new();
        for (path, named) in further_files {
            let mut file = read_label_map(path, AffineChoice::Auto)?;
            warnings
                .extend(file.image.warnings.iter().map(|warning| format!("{}: {warning}", path.display())));
            let refused = |fault| SurveyError::File { path: path.clone(), fault };
            lies_with(&own_grid, &file).map_err(refused)?;
            warnings
                .extend(beside(ct.volume.grid(), &file).map(|text| format!("{}: {text}", path.display())));
            for (label, name, of) in labels_of(&mut file, path, named)? {
                let as_added = map.add((&file, label), Fit::Touched, names.as_ref());
                added.push((as_added.map_err(|fault| refused(fault.into()))?.number, name, of));
            }
        }
        let LabelMap { image, further, .. } = map;
        let mut found = survey_labels(&ct.volume, &image.volume, &further);
        let mut of_files = Vec::new();
        for (number, name, of) in added {
            let place = found.iter().position(|survey| survey.number == number);
            let survey = place.map(|place| found.remove(place));
            of_files.push(FoundLabel { number, name, of, survey });
        }
        let of_map = |survey: LabelSurvey| {
            let number = survey.number;
            let name = names.as_ref().and_then(|names| names.name(number)).map(str::to_owned);
            if is_mask {
                let of = LabelRef::File { path: labels_named.into(), label: None };
                return FoundLabel { number, name: stem(labels), of, survey: Some(survey) };
            }
            FoundLabel { of: label_ref(number, name.as_deref()), number, name, survey: Some(survey) }
        };
        let mut labels: Vec<FoundLabel> = found.into_iter().map(of_map).collect();
        let absent = names.iter().flat_map(|names| names.iter()).filter(|(number, _)| *number != 0);
        for (number, name) in absent {
            if labels.iter().all(|label| label.number != number) {
                let (of, name) = (label_ref(number, Some(name)), Some(name.to_owned()));
                labels.push(FoundLabel { number, name, of, survey: None });
            }
        }
        labels.sort_by_key(|label| label.number);
        labels.extend(of_files);
        Ok(Self {
            labels,
            bone_x_mm: bone_extent_x_mm(&ct.volume, DEFAULT_BONE_HU),
            diagonal_mm: image.volume.grid().diagonal_mm(),
            warnings,
            ct: ct.volume.grid().clone(),
            map: image.volume,
            further,
        })
    }

    /// The case file that these images make, to lie in `file`, and which side they show; `approach` points out of the bone.
    ///
    /// # Errors
    /// As [`draft::draft`].
    pub fn draft(
        &self,
        images: ImagePaths,
        choice: &Choice,
        (robot, approach, place): (&str, Option<Vector3<f64>>, KnownPlace),
        file: &Path,
    ) -> Result<(SideFound, Drafted), DraftError> {
        let side = draft::side(&self.labels, choice, self.bone_x_mm);
        let beside = match choice.target {
            TargetChoice::Label(target) => self.labels.get(target).map(|label| self.beside(label.number)),
            TargetChoice::Shape(_) => None,
        };
        let of = Draft {
            images,
            labels: &self.labels,
            choice,
            beside_target: &beside.unwrap_or_default(),
            diagonal_mm: self.diagonal_mm,
            side: &side,
            approach,
            robot,
            place,
        };
        let mut drafted = draft::draft(&of, file)?;
        drafted.notes.extend(self.outside(choice));
        Ok((side, drafted))
    }

    /// What a plan will say of the chosen labels that lie outside the CT, wholly or in part.
    fn outside(&self, choice: &Choice) -> Vec<String> {
        let target = match choice.target {
            TargetChoice::Label(place) => Some((place, "the target")),
            TargetChoice::Shape(_) => None,
        };
        let places = choice.structures.iter().map(|place| (*place, "structure"));
        let chosen: Vec<(&FoundLabel, String)> = target
            .into_iter()
            .chain(places)
            .filter_map(|(place, what)| Some((self.labels.get(place)?, what)))
            .map(|(label, what)| (label, format!("{what} '{}'", label.called())))
            .collect();
        let numbers = chosen.iter().map(|(label, _)| label.number);
        let extents = label_extents(&self.ct, &self.map, &self.further, numbers);
        let told = |(label, what): &(&FoundLabel, String)| {
            let extent = extents.get(&label.number)?;
            let refusal = extent.refusal(what, label.number).map(|refusal| refusal.to_string());
            refusal.or_else(|| extent.text(what))
        };
        chosen.iter().filter_map(told).collect()
    }

    /// Numbers of the labels that share a voxel, a face, an edge or a corner with that one, ascending.
    pub fn beside(&self, number: u16) -> Vec<u16> {
        labels_beside(&self.map, &self.further, number)
    }
}

/// What a plan will say of a map that lies beside the CT.
fn beside(ct: &Grid<Ct>, map: &LabelMap) -> Option<String> {
    let found = Displaced::of(ct, map.image.volume.grid())?;
    let refusal = found.refusal(map.image.provenance.placement.is_nifti().then_some(AffineChoice::Auto));
    Some(refusal.map_or_else(|| found.text(), |refusal| refusal.to_string()))
}

/// A label of a further file: its number there, its name, and how the case names it.
type InFile = (Option<u16>, Option<String>, LabelRef);

/// The labels of a further file: their numbers there, their names, and how the case names them. One alone is a mask.
fn labels_of(file: &mut LabelMap, path: &Path, named: &Path) -> Result<Vec<InFile>, ImageError> {
    let all = file.labels();
    if all.len() < 2 {
        return Ok(vec![(None, stem(path), LabelRef::File { path: named.into(), label: None })]);
    }
    let names = names_of(file, read_label_names(label_names_path(path))?, path).map(|(names, _)| names);
    let label = |number: u16| {
        let name = names.as_ref().and_then(|names| names.name(number)).map(str::to_owned);
        let label = Some(Box::new(label_ref(number, name.as_deref())));
        (Some(number), name, LabelRef::File { path: named.into(), label })
    };
    Ok(all.into_iter().map(label).collect())
}

/// How a case names a label of a map: by its name where it has one that a case can give.
fn label_ref(number: u16, name: Option<&str>) -> LabelRef {
    let name = name.filter(|name| !name.trim().is_empty());
    name.map_or(LabelRef::Number(number), |name| LabelRef::Name(name.to_owned()))
}

/// A file's name without the ending of its format.
fn stem(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_string_lossy().into_owned();
    let stem = ENDINGS
        .iter()
        .chain(MASK_ENDINGS)
        .find_map(|ending| name.strip_suffix(ending))
        .filter(|stem| !stem.is_empty());
    Some(stem.unwrap_or(&name).to_owned())
}
