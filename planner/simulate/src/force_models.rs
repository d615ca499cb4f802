//! The names of the force models that a simulation can use.

use std::f64::consts::PI;
use std::fmt;
use std::str::FromStr;

use bonemill_case::Case;
use bonemill_cutting::burr::ModelError;

use super::{EngineSpec, FlutedBurr, ForceModel, Lumped, LumpedForm};

/// A force model's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ModelName {
    /// The spherical fluted burr (Dillon), blade by blade.
    #[default]
    Fluted,
    /// The lumped removal rate (Yang & Chen) with the burr model's specific cutting energy.
    Lumped,
    /// The lumped removal rate as printed: one K_t per cross-section, that of the nominal speed, at every speed.
    LumpedAsPrinted,
}

impl ModelName {
    /// Every model.
    pub const ALL: [Self; 3] = [Self::Fluted, Self::Lumped, Self::LumpedAsPrinted];

    fn word(self) -> &'static str {
        match self {
            Self::Fluted => "fluted",
            Self::Lumped => "lumped",
            Self::LumpedAsPrinted => "lumped-as-printed",
        }
    }

    /// The model with a case's coefficients: K of the lumped forms is the case's k_t, and F_r/F_t is k_r/k_t.
    ///
    /// # Errors
    /// [`ModelError`] for a lumped model of a case with k_t = 0.
    pub fn model(self, case: &Case, spec: &EngineSpec) -> Result<Box<dyn ForceModel>, ModelError> {
        let tool = spec.tool.clone();
        let [k_t, k_r, _] = spec.material.k_n_mm2();
        let positive = || {
            bonemill_cutting::burr::checked(
                "material.k_t, N/mm²",
                k_t,
                |k| k > 0.0,
                "positive for a lumped model",
            )
        };
        Ok(match self {
            Self::Fluted => Box::new(FlutedBurr { tool, material: spec.material.clone() }),
            Self::Lumped => {
                let form = LumpedForm::CuttingEnergy { k_n_mm2: positive()?, k_r: k_r / k_t };
                Box::new(Lumped::new(tool, form)?)
            }
            Self::LumpedAsPrinted => {
                let tooth_mm_s = 2.0 * PI * spec.spindle_rpm / 60.0 * tool.radius_mm();
                // K f/V_c at the nominal speed
                let k_t_n_mm2 = positive()? * case.speed.nominal_mm_s / tooth_mm_s;
                Box::new(Lumped::new(tool, LumpedForm::AsPrinted { k_t_n_mm2, k_r: k_r / k_t })?)
            }
        })
    }
}

impl fmt::Display for ModelName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.word())
    }
}

/// There is no force model of this name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("no force model is called {0:?}: expected fluted, lumped or lumped-as-printed")]
pub struct NoSuchModel(String);

impl FromStr for ModelName {
    type Err = NoSuchModel;

    fn from_str(word: &str) -> Result<Self, NoSuchModel> {
        Self::ALL.into_iter().find(|m| m.word() == word).ok_or_else(|| NoSuchModel(word.into()))
    }
}
