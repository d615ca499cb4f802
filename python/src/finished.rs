//! A finished plan on disk, as the input of simulation, verification and calibration, and the errors of these.

use std::path::PathBuf;

use bonemill_planner::PlanError as RustPlanError;
use bonemill_planner::calibrate::CalibrateError;
use bonemill_planner::plan::{Need, PlanFileError as RustPlanFileError, PlanRecord, StoredPlan};
use bonemill_planner::simulate::{EngineError, PoseError, SimulateError};
use bonemill_planner::uncertainty::UncertaintyError;
use bonemill_planner::verify::VerifyError;
use pyo3::prelude::*;
use thiserror::Error;

use crate::errors::{self, words};
use crate::plan::Plan;

/// A plan's folder, and the record that it must contain.
pub struct Finished {
    dir: PathBuf,
    record: Option<PlanRecord>,
    inputs_folder: Option<PathBuf>,
}

impl Finished {
    /// A plan that was just written to `saved`, else one that was read from its folder.
    pub fn new(plan: &Plan, saved: Option<PathBuf>) -> PyResult<Self> {
        match (saved, plan.home()) {
            (Some(dir), _) => Ok(Self { dir, record: None, inputs_folder: None }),
            (None, Some((dir, record))) => {
                Ok(Self { dir, record: Some(record.clone()), inputs_folder: plan.inputs_folder() })
            }
            (None, None) => {
                Err(errors::PlanFileError::new_err("the plan lies in no folder: save and load it"))
            }
        }
    }

    /// The plan's folder.
    pub fn dir(&self) -> &std::path::Path {
        &self.dir
    }

    /// Reads the files and the needed inputs again, because another plan may be in the folder by now.
    pub fn read(&self, need: Need) -> Result<StoredPlan, NotDone> {
        let stored = StoredPlan::load_with(&self.dir, self.inputs_folder.as_deref(), need)?;
        match &self.record {
            Some(record) if *record != stored.record => Err(NotDone::Replaced(self.dir.clone())),
            _ => Ok(stored),
        }
    }
}

/// Why the work failed.
#[derive(Debug, Error)]
pub enum NotDone {
    /// The plan's files, or those of the result, cannot be read or written.
    #[error(transparent)]
    File(#[from] RustPlanFileError),
    /// The folder contains another plan by now.
    #[error("{} holds another plan than the one that was loaded: load it again", .0.display())]
    Replaced(PathBuf),
    /// The simulation failed.
    #[error(transparent)]
    Simulate(#[from] SimulateError),
    /// The verification failed.
    #[error(transparent)]
    Verify(#[from] VerifyError),
    /// The risks could not be computed.
    #[error(transparent)]
    Uncertainty(UncertaintyError),
    /// The calibration failed.
    #[error(transparent)]
    Calibrate(#[from] CalibrateError),
}

impl From<UncertaintyError> for NotDone {
    fn from(error: UncertaintyError) -> Self {
        match error {
            UncertaintyError::Verify(error) => Self::Verify(error),
            error => Self::Uncertainty(error),
        }
    }
}

impl From<NotDone> for PyErr {
    fn from(error: NotDone) -> Self {
        let text = words(&error);
        match &error {
            NotDone::File(_) | NotDone::Replaced(_) | NotDone::Verify(VerifyError::File(_)) => {
                errors::PlanFileError::new_err(text)
            }
            NotDone::Simulate(SimulateError::Images(RustPlanError::Image(_) | RustPlanError::Scene(_)))
            | NotDone::Verify(VerifyError::Image { .. } | VerifyError::Imaging(_)) => {
                errors::ImageError::new_err(text)
            }
            NotDone::Simulate(SimulateError::Engine(EngineError::Model(_))) => {
                errors::ModelError::new_err(text)
            }
            NotDone::Simulate(SimulateError::Poses(
                PoseError::Sampling { .. } | PoseError::Coarse { .. },
            ))
            | NotDone::Uncertainty(_) => errors::ArrayError::new_err(text),
            NotDone::Simulate(SimulateError::Compliance { .. }) | NotDone::Verify(VerifyError::Robot(_)) => {
                errors::RobotError::new_err(text)
            }
            NotDone::Calibrate(_) => errors::CalibrationError::new_err(text),
            NotDone::Simulate(_) | NotDone::Verify(_) => errors::PlanError::new_err(text),
        }
    }
}
