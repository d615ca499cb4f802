//! Writes a phantom as the files of a case: images, label names, case file.

use std::path::Path;
use std::{fs, io};

use crate::error::ImageError;
use crate::phantom::Phantom;
use crate::write::{write_ct_i16, write_labels_u8};

/// Name of the case file of a phantom.
pub const PHANTOM_CASE_FILE: &str = "case.toml";

/// Writes `ct.nii.gz`, `labels.nii.gz`, `labels.json` and [`PHANTOM_CASE_FILE`] into an existing folder.
///
/// # Errors
/// [`ImageError::Write`] when the system refuses.
pub fn write_phantom(dir: &Path, phantom: &Phantom) -> Result<(), ImageError> {
    write_ct_i16(dir.join("ct.nii.gz"), &phantom.ct)?;
    write_labels_u8(dir.join("labels.nii.gz"), &phantom.labels)?;
    let names: serde_json::Map<_, _> =
        phantom.label_names.iter().map(|(name, value)| (name.clone(), (*value).into())).collect();
    let write = |name: &str, text: io::Result<String>| {
        let path = dir.join(name);
        let written = text.and_then(|text| fs::write(&path, text));
        written.map_err(|problem| ImageError::Write { path, problem })
    };
    let names = serde_json::to_string_pretty(&names).map(|text| text + "\n").map_err(io::Error::from);
    write("labels.json", names)?;
    write(PHANTOM_CASE_FILE, Ok(phantom.case_toml.clone()))
}
