//! Reads an arm's files. No other module of this crate opens files.

use std::path::Path;

use super::Arm;
use crate::error::RobotError;
use crate::ur::UrModel;

/// Names of the arms that come with the program.
pub const NAMES: [&str; 1 + UrModel::ALL.len()] = {
    let mut names = ["bone-attached"; 1 + UrModel::ALL.len()];
    let mut n = 0;
    while n < UrModel::ALL.len() {
        names[n + 1] = UrModel::ALL[n].name();
        n += 1;
    }
    names
};

/// The arm with one of the [`NAMES`] or from a URDF file (a path that ends in `.urdf` or
/// `.xml`), without a tool.
///
/// # Errors
/// [`RobotError::UnknownArm`] for any other name, else those of [`read_urdf`].
pub fn load(name_or_path: &str) -> Result<Arm, RobotError> {
    if name_or_path == "bone-attached" {
        return Arm::bone_attached();
    }
    if let Some(model) = UrModel::by_name(name_or_path) {
        return Arm::ur(model, None);
    }
    let path = Path::new(name_or_path);
    match path.extension().and_then(|extension| extension.to_str()) {
        Some("urdf" | "xml") => read_urdf(path),
        _ => Err(RobotError::UnknownArm { name: name_or_path.into() }),
    }
}

/// A file's text.
pub(crate) fn read_text(path: &Path) -> std::io::Result<String> {
    std::fs::read_to_string(path)
}

/// The arm in a URDF file; see [`Arm::from_urdf`].
///
/// # Errors
/// [`RobotError::ReadUrdf`] where the file cannot be read, else those of [`Arm::from_urdf`].
pub fn read_urdf(path: &Path) -> Result<Arm, RobotError> {
    let text = read_text(path).map_err(|source| RobotError::ReadUrdf { path: path.to_owned(), source })?;
    Arm::from_urdf(&text, &path.display().to_string())
}
