//! A case made from labels: which is the target, which are spared, and a commented case file with values to start from.
//!
//! Nothing is guessed that a name does not tell: without a target [`choose`] refuses, and a label that fits no usual name is told in the
//! notes and in the file. The text is a case by [`Case::parse`] before it is given away. No file is read or written here.

mod choice;
mod error;
mod kinds;
mod side;
mod text;

use std::path::{Path, PathBuf};

use bonemill_geometry::{Base, Ct, Point, Rigid};
use bonemill_imaging::LabelSurvey;
use nalgebra::Vector3;

pub use choice::{Choice, Role, TargetChoice, TargetWish, Wishes, choose};
pub use error::DraftError;
pub use kinds::{Meaning, Side, StructureKind, meaning, side_in};
pub use side::{SideFound, side};

use super::{Case, LabelRef};

/// Names of the arms for which a case can be made.
pub const ROBOTS: [&str; bonemill_arm::arm::NAMES.len()] = bonemill_arm::arm::NAMES;

/// A label of the map or of a file of its own.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundLabel {
    /// Its number in the map; of another file one that is free there.
    pub number: u16,
    /// Its name, or that of the mask's file.
    pub name: Option<String>,
    /// How the case names it.
    pub of: LabelRef,
    /// What it holds; `None` for a name without a voxel.
    pub survey: Option<LabelSurvey>,
}

impl FoundLabel {
    /// Its name, or its number where it has none.
    pub fn called(&self) -> String {
        self.name.clone().unwrap_or_else(|| self.number.to_string())
    }

    /// What a message calls it: a mask's file, else its number and name.
    fn described(&self) -> String {
        match (&self.of, &self.name) {
            (LabelRef::File { path, label: None }, _) => path.display().to_string(),
            (LabelRef::File { path, label: Some(label) }, _) => format!("{label} of {}", path.display()),
            (_, Some(name)) => format!("{} {name:?}", self.number),
            (_, None) => self.number.to_string(),
        }
    }

    /// Volume, mm³.
    pub fn volume_mm3(&self) -> f64 {
        self.survey.as_ref().map_or(0.0, |survey| survey.volume_mm3)
    }
}

/// Where the images are, as the case names them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ImagePaths {
    /// The CT.
    pub ct: PathBuf,
    /// The name of its series, where it is a folder with several.
    pub ct_series: Option<String>,
    /// The label map.
    pub labels: PathBuf,
}

/// Where the patient is, as far as it is known.
#[derive(Debug, Clone, PartialEq)]
pub enum KnownPlace {
    /// Not at all: left to the planner's assumption.
    Unknown,
    /// By a registration.
    Registered(Rigid<Base, Ct>),
    /// By fiducials in ct, whose places in base are not known yet.
    Fiducials(Vec<Point<Ct>>),
}

/// What a case is written of.
#[derive(Debug, Clone)]
pub struct Draft<'a> {
    /// The images.
    pub images: ImagePaths,
    /// Every label.
    pub labels: &'a [FoundLabel],
    /// What is taken for what.
    pub choice: &'a Choice,
    /// Numbers of labels that share a voxel, a face, an edge or a corner with the target's.
    pub beside_target: &'a [u16],
    /// Diagonal of a voxel of the label map, mm.
    pub diagonal_mm: f64,
    /// Left or right.
    pub side: &'a SideFound,
    /// Out of the bone, in ct, if it is given; any length.
    pub approach: Option<Vector3<f64>>,
    /// The arm's name: `bone-attached`, or that of a UR.
    pub robot: &'a str,
    /// Where the patient is.
    pub place: KnownPlace,
}

/// A case file that was made.
#[derive(Debug, Clone)]
pub struct Drafted {
    /// The file's text.
    pub text: String,
    /// The case that it is.
    pub case: Case,
    /// What the user should know.
    pub notes: Vec<String>,
}

/// Writes the case that will lie in `file`.
///
/// # Errors
/// [`DraftError::Fiducials`] for fewer than three points, [`DraftError::Approach`] for two points in one place, [`DraftError::Path`]
/// for a path that is not Unicode, [`DraftError::Refused`] when a case of these values is none.
pub fn draft(draft: &Draft<'_>, file: &Path) -> Result<Drafted, DraftError> {
    let text = text::case_text(draft)?;
    let case = Case::parse(&text, file).map_err(DraftError::Refused)?;
    Ok(Drafted { text, case, notes: text::notes(draft) })
}

#[cfg(test)]
mod tests;
