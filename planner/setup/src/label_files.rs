//! The labels that a case names, as numbers of one map: those of other files are added to it.
//!
//! What is removed has the voxels of the map whose centres lie in it, what is kept every voxel that it touches, so that a structure in
//! finer or shifted voxels loses nothing. On the map's own grid both are its voxels.

use std::path::{Path, PathBuf};

use bonemill_case::{Case, LabelRef, nearest};
use bonemill_geometry::{Ct, Grid};
use bonemill_imaging::{
    AddFault, Added, AffineChoice, Fit, LabelMap, LabelNames, Placement, displacement_mm, label_names_path,
    read_label_map, read_label_names,
};
use bonemill_toolpath::scene::Displaced;
use thiserror::Error;

use super::PlanError;
use super::inputs::named_files;

/// A file whose dimensions are the map's lies where the map lies, or beside it by mistake, voxels.
const MOST_BESIDE_VOXELS: f64 = 1.0;
/// Volumes that differ by no more are equal, of themselves.
const SAME_SHARE: f64 = 1e-3;

/// Names of labels, and the file that holds them.
pub type NamesAt = (LabelNames, PathBuf);

/// Why a file gives no label.
#[derive(Debug, Error)]
pub enum LabelFileFault {
    /// It cannot be added to the map.
    #[error(transparent)]
    Add(#[from] AddFault),
    /// It is to be removed, and it is not said which of its labels.
    #[error("holds the labels {0:?}; expected a mask of one label, or which of them with label or segment")]
    SeveralLabels(Vec<u16>),
    /// It has the dimensions of the label map or the CT, and lies elsewhere.
    #[error(
        "has the dimensions of {what}, but another spacing or origin: its corners lie up to {mm:.3} mm beside it. Write it anew on that \
         grid{}",
        if *is_nifti { "; if it does lie where its own header says, set images.labels_affine to \"sform\" or \"qform\"" } else { "" }
    )]
    Displaced {
        /// Which image.
        what: &'static str,
        /// The largest distance of corners, mm.
        mm: f64,
        /// Whether the case can choose another of its transforms.
        is_nifti: bool,
    },
}

/// The label map of a case, and the files whose labels were added to it.
pub(super) struct LabelFiles<'a> {
    case: &'a Case,
    place: &'a (dyn Fn(&Path) -> PathBuf + Sync),
    ct: &'a Grid<Ct>,
    /// The grid of the map's own file.
    own: Grid<Ct>,
    /// The map.
    pub map: LabelMap,
    /// The names of its own labels.
    pub names: Option<NamesAt>,
    others: Vec<OtherFile>,
    /// The other files that were read, as the case names them.
    pub read: Vec<PathBuf>,
    /// What the user should know.
    pub warnings: Vec<String>,
}

/// A file that is not the map's.
struct OtherFile {
    named: PathBuf,
    map: LabelMap,
    /// How far it lies beside the CT's voxels.
    beside: Option<Displaced>,
    names: Option<NamesAt>,
}

/// What a label is to the case in words, and the table that names it.
pub(super) type Named = (String, String);

impl<'a> LabelFiles<'a> {
    /// Begins with the label map; `place` says where a file is that the case names so.
    pub fn new(
        case: &'a Case,
        place: &'a (dyn Fn(&Path) -> PathBuf + Sync),
        ct: &'a Grid<Ct>,
        (map, names): (LabelMap, Option<NamesAt>),
    ) -> Self {
        let own = map.image.volume.grid().clone();
        Self { case, place, ct, own, map, names, others: vec![], read: vec![], warnings: vec![] }
    }

    /// The number of a label; one of another file is added.
    ///
    /// # Errors
    /// [`PlanError::LabelName`], [`PlanError::NoLabelNames`], [`PlanError::LabelFile`], and images that cannot be read.
    pub fn number(&mut self, (what, table): Named, label: &LabelRef, how: Fit) -> Result<u16, PlanError> {
        let LabelRef::File { path, label } = label else {
            let map = (self.place)(&self.case.images.labels);
            return label_number(what, label, self.names.as_ref(), &map);
        };
        let file = (self.place)(path);
        let n = self.other(path, &file)?;
        if matches!(label.as_deref(), Some(LabelRef::Name(_))) {
            self.read_names(n, &file)?;
        }
        let other = &self.others[n];
        let number = label.as_deref().map(|of| label_number(what.clone(), of, other.names.as_ref(), &file));
        let number = number.transpose()?;
        let refused = |fault: LabelFileFault| PlanError::LabelFile {
            what: what.clone(),
            table: table.clone(),
            path: file.clone(),
            fault,
        };
        let all = if number.is_none() && how == Fit::Centres { other.map.labels() } else { vec![] };
        if all.len() > 1 {
            return Err(refused(LabelFileFault::SeveralLabels(all.into_iter().take(10).collect())));
        }
        let choice = self.choice(&other.map);
        if choice.is_none_or(|choice| choice == AffineChoice::Auto) {
            lies_with(&self.own, &other.map).map_err(&refused)?;
        }
        if let Some(found) = other.beside.filter(|found| found.refusal(choice).is_some()) {
            let is_nifti = choice.is_some();
            return Err(refused(LabelFileFault::Displaced { what: "the CT", mm: found.mm, is_nifti }));
        }
        let names = self.names.as_ref().map(|(names, _)| names);
        let Added { number, mm3: [own, added] } =
            self.map.add((&other.map, number), how, names).map_err(|fault| refused(fault.into()))?;
        if (own - added).abs() > SAME_SHARE * own {
            let rule = match how {
                Fit::Centres => "the voxels whose centres lie in it",
                Fit::Touched => "every voxel that it touches",
            };
            self.warnings.push(format!(
                "{what}: {} lies on another grid than the label map: its {own:.2} mm³ are {added:.2} mm³ there, {rule}",
                path.display()
            ));
        }
        Ok(number)
    }

    /// Of a map that has grown, whether its own voxels lie where the CT's lie; of another the scene tells.
    ///
    /// # Errors
    /// [`PlanError::Scene`] where they lie elsewhere.
    pub fn map_lies_at_ct(&mut self) -> Result<(), PlanError> {
        let has_grown = self.map.image.volume.grid().dims() != self.own.dims();
        let Some(found) = Displaced::of(self.ct, &self.own).filter(|_| has_grown) else { return Ok(()) };
        match found.refusal(self.choice(&self.map)) {
            Some(refusal) => Err(refusal.into()),
            None => {
                self.warnings.push(found.text());
                Ok(())
            }
        }
    }

    /// Which of a map's transforms the case chooses; `None` for a format that has one only.
    fn choice(&self, map: &LabelMap) -> Option<AffineChoice> {
        map.image.provenance.placement.is_nifti().then_some(self.case.images.labels_affine)
    }

    /// Reads a file, once.
    fn other(&mut self, named: &Path, file: &Path) -> Result<usize, PlanError> {
        if let Some(n) = self.others.iter().position(|other| other.named == named) {
            return Ok(n);
        }
        let map = read_label_map(file, self.case.images.labels_affine)?;
        self.warnings
            .extend(map.image.warnings.iter().map(|warning| format!("{}: {warning}", named.display())));
        self.read.extend(named_files(named, file, &map.image.provenance));
        let beside = Displaced::of(self.ct, map.image.volume.grid());
        self.warnings.extend(beside.map(|found| format!("{}: {}", named.display(), found.text())));
        self.others.push(OtherFile { named: named.into(), map, beside, names: None });
        Ok(self.others.len() - 1)
    }

    /// The names of a file's labels.
    fn read_names(&mut self, n: usize, file: &Path) -> Result<(), PlanError> {
        let Some(other) = self.others.get_mut(n).filter(|other| other.names.is_none()) else { return Ok(()) };
        let beside = read_label_names(label_names_path(file))?;
        if beside.is_some() {
            self.read.push(label_names_path(&other.named));
        }
        other.names = names_of(&mut other.map, beside, file);
        Ok(())
    }
}

/// Refuses a file that has the map's dimensions but lies elsewhere.
///
/// # Errors
/// [`LabelFileFault::Displaced`].
pub(super) fn lies_with(here: &Grid<Ct>, file: &LabelMap) -> Result<(), LabelFileFault> {
    let there = file.image.volume.grid();
    let most_mm = MOST_BESIDE_VOXELS * here.spacing_mm().min();
    let beside = displacement_mm(here, there).filter(|mm| *mm > most_mm);
    let is_nifti = file.image.provenance.placement.is_nifti();
    beside.map_or(Ok(()), |mm| Err(LabelFileFault::Displaced { what: "the label map", mm, is_nifti }))
}

/// The names of a map's labels. A `labels.json` beside a NIfTI map is its own; other formats hold their names, and a list that
/// lies beside them may be another map's.
pub(super) fn names_of(
    map: &mut LabelMap,
    beside: Option<LabelNames>,
    labels_path: &Path,
) -> Option<NamesAt> {
    let within = map.names.take().map(|names| (names, labels_path.to_owned()));
    let beside = beside.map(|names| (names, label_names_path(labels_path)));
    match map.image.provenance.placement {
        Placement::Nifti(_) if map.image.provenance.files.len() == 1 => beside.or(within),
        _ => within.or(beside),
    }
}

/// The number of a label of a map with these names.
pub(super) fn label_number(
    key: String,
    label: &LabelRef,
    names: Option<&(LabelNames, PathBuf)>,
    labels_path: &Path,
) -> Result<u16, PlanError> {
    let name = match label {
        LabelRef::Number(number) => return Ok(*number),
        LabelRef::Name(name) => name.clone(),
        // a file in a file is none
        LabelRef::File { path, .. } => path.display().to_string(),
    };
    let beside = labels_path.to_owned();
    let Some((names, list)) = names else {
        return Err(PlanError::NoLabelNames { key, name, beside });
    };
    names.number(&name).ok_or_else(|| {
        let known: Vec<String> = names.iter().map(|(_, known)| known.to_owned()).collect();
        let nearest = nearest(&name, known.iter().map(String::as_str)).map(str::to_owned);
        PlanError::LabelName { key, name, list: list.clone(), known, nearest }
    })
}
