//! Reads URDF files; the only place of this crate that opens one.

use std::path::Path;

use super::Arm;
use crate::error::RobotError;

/// The arm in a URDF file; see [`Arm::from_urdf`].
///
/// # Errors
/// [`RobotError::ReadUrdf`] where the file cannot be read, else those of [`Arm::from_urdf`].
pub fn read_urdf(path: &Path) -> Result<Arm, RobotError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| RobotError::ReadUrdf { path: path.to_owned(), source })?;
    Arm::from_urdf(&text, &path.display().to_string())
}
