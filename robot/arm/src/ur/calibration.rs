//! The calibration of one particular UR arm.
//!
//! Three forms are read; the contents tell which it is:
//! - YAML with `delta_theta`, `delta_a`, `delta_d`, `delta_alpha` (six numbers each, rad and m), at the top or under
//!   `mounting`: these are added to the nominal DH table;
//! - the controller's own `calibration.conf`, which has the same keys with `=`;
//! - the ROS driver's extraction: YAML with `kinematics`: `shoulder` .. `wrist_3`, each `x y z roll pitch yaw`.
//!
//! Offsets along the parallel axes 2, 3 and 4 may each be metres, while only their sum is small. So the numbers are not
//! checked one by one; `check` compares the calibrated arm with the nominal one.

use std::path::Path;

use saphyr::{LoadableYamlNode, Yaml};

use super::UrModel;
use crate::arm::Arm;
use crate::error::{CalibrationFault, RobotError};

/// Largest distance of a calibrated flange from the nominal one, mm. Factory calibrations move it by 1–2 mm, the
/// calibration of another model by hundreds.
const MOST_OFF_MM: f64 = 20.0;

/// Largest rotation of a calibrated flange from the nominal one, rad. Factory calibrations turn it by milliradians.
const MOST_TURNED_RAD: f64 = 0.02;

/// Names of the links in the ROS driver's extraction.
const LINKS: [&str; 6] = ["shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"];

/// A joint's origin as in a URDF.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct JointOrigin {
    /// Translation, m.
    pub xyz_m: [f64; 3],
    /// Fixed-axis roll, pitch, yaw, rad.
    pub rpy_rad: [f64; 3],
}

/// The contents of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum Calibration {
    /// Values that are added to the nominal DH table; m and rad.
    Deltas {
        /// δθ, rad.
        theta: [f64; 6],
        /// δa, m.
        a_m: [f64; 6],
        /// δd, m.
        d_m: [f64; 6],
        /// δα, rad.
        alpha: [f64; 6],
    },
    /// The origins of the six joints.
    Origins([JointOrigin; 6]),
}

/// Reads a calibration file.
///
/// # Errors
/// [`RobotError::Calibration`] with the file and the fault.
pub fn read_calibration(path: &Path) -> Result<Calibration, RobotError> {
    let source_name = path.display().to_string();
    let fail = |fault| RobotError::Calibration { source_name: source_name.clone(), fault };
    let text = crate::arm::read_text(path).map_err(|source| fail(CalibrationFault::Read(source)))?;
    Calibration::parse(&text).map_err(fail)
}

/// The arm of a model, calibrated where a calibration is given.
///
/// # Errors
/// [`RobotError::Calibration`] with the file and the fault, also where the calibrated arm is not near the model.
pub fn read_ur(model: UrModel, calibration: Option<&Path>) -> Result<Arm, RobotError> {
    let Some(path) = calibration else { return Arm::ur(model, None) };
    Arm::ur(model, Some(&read_calibration(path)?)).map_err(|error| match error {
        RobotError::Calibration { fault, .. } => {
            RobotError::Calibration { source_name: path.display().to_string(), fault }
        }
        other => other,
    })
}

impl Calibration {
    /// The calibration in a file's text.
    ///
    /// # Errors
    /// [`CalibrationFault`] where the text is none of the three forms, or a number is missing or not finite.
    pub fn parse(text: &str) -> Result<Self, CalibrationFault> {
        let assigns =
            text.lines().any(|line| line.trim_start().starts_with("delta_theta") && line.contains('='));
        let text = if assigns { as_yaml(text) } else { text.to_owned() };
        let documents = Yaml::load_from_str(&text).map_err(|e| CalibrationFault::Syntax(e.to_string()))?;
        let root = documents.first().ok_or(CalibrationFault::Unknown)?;
        if let Some(links) = root.as_mapping_get("kinematics") {
            return origins(links);
        }
        let deltas = root.as_mapping_get("mounting").unwrap_or(root);
        if deltas.as_mapping_get("delta_theta").is_none() {
            return Err(CalibrationFault::Unknown);
        }
        let six = |key| six(deltas, key);
        Ok(Self::Deltas {
            theta: six("delta_theta")?,
            a_m: six("delta_a")?,
            d_m: six("delta_d")?,
            alpha: six("delta_alpha")?,
        })
    }
}

/// Converts `key = value` lines to YAML; section titles are left out.
fn as_yaml(text: &str) -> String {
    let line = |line: &str| match line.split_once('=') {
        Some((key, value)) if !key.contains('#') => format!("{}: {}\n", key.trim(), value.trim()),
        _ => String::new(),
    };
    text.lines().map(line).collect()
}

fn origins(links: &Yaml<'_>) -> Result<Calibration, CalibrationFault> {
    let mut origins = [JointOrigin::default(); 6];
    for (origin, link) in origins.iter_mut().zip(LINKS) {
        let entry = links
            .as_mapping_get(link)
            .ok_or_else(|| CalibrationFault::Missing { key: format!("kinematics.{link}") })?;
        let at = |name: &str| {
            let key = format!("kinematics.{link}.{name}");
            let value = entry.as_mapping_get(name).ok_or(CalibrationFault::Missing { key: key.clone() })?;
            number(value).ok_or(CalibrationFault::Number { key })
        };
        *origin = JointOrigin {
            xyz_m: [at("x")?, at("y")?, at("z")?],
            rpy_rad: [at("roll")?, at("pitch")?, at("yaw")?],
        };
    }
    Ok(Calibration::Origins(origins))
}

fn six(table: &Yaml<'_>, key: &str) -> Result<[f64; 6], CalibrationFault> {
    let value = table.as_mapping_get(key).ok_or_else(|| CalibrationFault::Missing { key: key.into() })?;
    let items: Option<Vec<f64>> = value.as_sequence().and_then(|items| items.iter().map(number).collect());
    items
        .and_then(|items| items.try_into().ok())
        .ok_or_else(|| CalibrationFault::Number { key: format!("{key} (six numbers)") })
}

/// The value as a finite number; integers are accepted.
fn number(value: &Yaml<'_>) -> Option<f64> {
    let number = value.as_floating_point().or_else(|| value.as_integer().map(|whole| whole as f64));
    number.filter(|number| number.is_finite())
}

/// Checks at many joint vectors that the calibrated flange is near the nominal one, in position and orientation.
pub(super) fn check(model: UrModel, calibrated: &Arm) -> Result<(), RobotError> {
    let nominal = Arm::ur(model, None)?;
    let (mut worst_mm, mut worst_rad) = (0f64, 0f64);
    for k in 0..32 {
        // steps by the golden ratio spread the joint vectors evenly
        let q: [f64; 6] = std::array::from_fn(|j| {
            let share = f64::from(k) * (0.618_033_988_75 + 0.1 * j as f64);
            (share.fract() - 0.5) * std::f64::consts::TAU
        });
        let (there, here) = (calibrated.forward(&q)?, nominal.forward(&q)?);
        worst_mm = worst_mm.max((there.translation_mm - here.translation_mm).norm());
        worst_rad = worst_rad.max(here.rotation.angle_to(&there.rotation));
    }
    let model = model.name();
    let fault = if worst_mm > MOST_OFF_MM {
        CalibrationFault::OtherModel { model, worst_mm, most_mm: MOST_OFF_MM }
    } else if worst_rad > MOST_TURNED_RAD {
        CalibrationFault::Turned { model, worst_rad, most_rad: MOST_TURNED_RAD }
    } else {
        return Ok(());
    };
    Err(RobotError::Calibration { source_name: "calibration".into(), fault })
}
