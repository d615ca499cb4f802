//! Converts the crates' errors to the package's exceptions, with the same texts as the command.

use std::error::Error;

use bonemill_geometry::{GridError, VolumeError};
use bonemill_imaging::ImageError as RustImageError;
use bonemill_planner::PlanError as RustPlanError;
use bonemill_planner::burr::ModelError as RustModelError;
use bonemill_planner::case::CaseError as RustCaseError;
use bonemill_planner::pipeline::Refused;
use bonemill_planner::plan::PlanFileError as RustPlanFileError;
use bonemill_robot::RobotError as RustRobotError;
use pyo3::{PyErr, import_exception};

import_exception!(bonemill._errors, ArrayError);
import_exception!(bonemill._errors, CalibrationError);
import_exception!(bonemill._errors, CaseError);
import_exception!(bonemill._errors, ImageError);
import_exception!(bonemill._errors, InfeasibleError);
import_exception!(bonemill._errors, ModelError);
import_exception!(bonemill._errors, PlanError);
import_exception!(bonemill._errors, PlanFileError);
import_exception!(bonemill._errors, RobotError);
import_exception!(bonemill._errors, StreamError);

/// An error with its causes, one per line, as the command prints them.
pub fn words(error: &dyn Error) -> String {
    let mut text = error.to_string();
    let mut said = text.clone();
    let mut cause = error.source();
    while let Some(error) = cause {
        // some errors already contain their cause
        if !said.contains(&error.to_string()) {
            said = error.to_string();
            text.push_str(&format!("\n  because: {said}"));
        }
        cause = error.source();
    }
    text
}

/// A case could not be planned.
pub fn refused(refused: &Refused) -> PyErr {
    let text = words(refused);
    match refused.error() {
        _ if refused.falls_short() => InfeasibleError::new_err(text),
        RustPlanError::Image(_) | RustPlanError::Scene(_) => ImageError::new_err(text),
        RustPlanError::File(_) => PlanFileError::new_err(text),
        RustPlanError::Robot(_) => RobotError::new_err(text),
        RustPlanError::Model(_) => ModelError::new_err(text),
        RustPlanError::LabelName { .. }
        | RustPlanError::NoLabelNames { .. }
        | RustPlanError::SharedLabel { .. }
        | RustPlanError::Registration(_)
        | RustPlanError::FiducialsOutside { .. }
        | RustPlanError::Unsupported { .. }
        | RustPlanError::Needed { .. }
        | RustPlanError::Mount(_)
        | RustPlanError::StiffnessMissing => CaseError::new_err(text),
        _ => PlanError::new_err(text),
    }
}

/// A case file is not valid.
pub fn case(error: &RustCaseError) -> PyErr {
    CaseError::new_err(words(error))
}

/// An image, or a field on its grid, is not valid.
pub fn image(error: &RustImageError) -> PyErr {
    ImageError::new_err(words(error))
}

/// A plan's files cannot be read or written.
pub fn file(error: &RustPlanFileError) -> PyErr {
    PlanFileError::new_err(words(error))
}

/// An arm is not valid.
pub fn robot(error: &RustRobotError) -> PyErr {
    RobotError::new_err(words(error))
}

/// The force model refused a number.
pub fn model(error: &RustModelError) -> PyErr {
    ModelError::new_err(words(error))
}

/// An array's grid is not valid.
pub fn grid(error: &GridError) -> PyErr {
    ArrayError::new_err(words(error))
}

/// The number of values does not match the grid.
pub fn volume(error: &VolumeError) -> PyErr {
    ArrayError::new_err(words(error))
}

/// A prosthesis that could not be planned: its job, its part, its block or its files.
pub fn prosthesis(error: &bonemill_prosthesis::ProsthesisError) -> PyErr {
    use bonemill_prosthesis::ProsthesisError;
    match error {
        ProsthesisError::Job(_) => CaseError::new_err(words(error)),
        ProsthesisError::Files(_) | ProsthesisError::Folder { .. } => PlanFileError::new_err(words(error)),
        _ => PlanError::new_err(words(error)),
    }
}
