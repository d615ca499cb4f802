//! Bodies for experiments: phantoms in a temporary folder, or an existing case.

use std::path::{Path, PathBuf};

use bonemill_imaging::phantom::Phantom;
use bonemill_imaging::{write_ct_i16, write_labels_u8};
use bonemill_planner::case::Case;

use crate::ExperimentError;

/// A case with its images on disk.
#[derive(Debug)]
pub struct Body {
    case_text: String,
    case_path: PathBuf,
    /// Holds the files of a phantom.
    _folder: Option<tempfile::TempDir>,
}

impl Body {
    /// A phantom.
    ///
    /// # Errors
    /// When the temporary folder cannot be written.
    pub fn phantom(phantom: &Phantom) -> Result<Self, ExperimentError> {
        let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
        write_ct_i16(folder.path().join("ct.nii.gz"), &phantom.ct)?;
        write_labels_u8(folder.path().join("labels.nii.gz"), &phantom.labels)?;
        let names: Vec<String> =
            phantom.label_names.iter().map(|(name, value)| format!("\"{name}\": {value}")).collect();
        let names = format!("{{{}}}\n", names.join(", "));
        std::fs::write(folder.path().join("labels.json"), names).map_err(ExperimentError::Folder)?;
        let case_path = folder.path().join("case.toml");
        std::fs::write(&case_path, &phantom.case_toml).map_err(ExperimentError::Folder)?;
        Ok(Self { case_text: phantom.case_toml.clone(), case_path, _folder: Some(folder) })
    }

    /// An existing case file; `None` when it does not exist.
    pub fn case_file(path: &Path) -> Option<Self> {
        let case_text = std::fs::read_to_string(path).ok()?;
        Some(Self { case_text, case_path: path.into(), _folder: None })
    }

    /// The case with the paper's defaults or with this project's.
    ///
    /// # Errors
    /// When it does not parse.
    pub fn case(&self, paper: bool) -> Result<Case, ExperimentError> {
        let preset = if paper { "preset = \"paper\"\n" } else { "" };
        Ok(Case::parse(&format!("{preset}{}", self.case_text), &self.case_path)?)
    }

    /// The file to which its paths are relative.
    pub fn case_path(&self) -> &Path {
        &self.case_path
    }
}

/// The folder of scans that are not part of the repository.
pub fn data() -> PathBuf {
    std::env::var_os("BONEMILL_DATA")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data"), PathBuf::from)
}
