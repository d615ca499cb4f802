//! From the case's values to the tools of planning: burr, material, arm, registration.

use bonemill_geometry::{Approach, Base, Ct, Rigid, Work};
use bonemill_imaging::Scene;
use bonemill_robot::Arm;
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

use super::PlanError;
use crate::access::ShankCylinder;
use crate::burr::{Discretisation, ElementGrid, Material, Measure, ModelError, Tool};
use crate::case::{self, Case, Registration};
use crate::orientation::TiltFamily;

/// Elements of the force sum: 64 from tip to shaft, about 128 around.
const N_KAPPA: usize = 64;
const N_AROUND: usize = 128;

/// The burr of a case.
pub fn tool(burr: &case::Burr) -> Result<Tool, ModelError> {
    Tool::new(burr.radius_mm, burr.flutes, i32::from(burr.spin))?.with_neck(burr.neck_radius_mm)
}

/// Its material, and the measure that its coefficients belong to.
pub fn material(material: &case::Material) -> Result<(Material, Measure), ModelError> {
    let made = Material::new(material.k_n_mm2, material.rho_ref_g_cm3)?
        .with_edge(material.k_edge_n_mm, material.t0_mm)?
        .with_density_law(material.exponent, 0.0)?;
    let measure = match material.measure {
        case::Measure::Db => Measure::Db,
        case::Measure::Dz => Measure::Dz,
    };
    Ok((made, measure))
}

/// The force sum's discretisation for a burr.
pub fn discretisation(tool: &Tool, measure: Measure) -> Result<Discretisation, ModelError> {
    let n_gamma = N_AROUND.div_ceil(tool.blades() as usize);
    Discretisation::new(n_gamma, N_KAPPA, ElementGrid::Kappa, measure)
}

/// The shank as cylinders; the first starts at the burr's radius.
pub fn shank(case: &Case) -> Vec<ShankCylinder> {
    let mut from_mm = case.burr.radius_mm;
    case.shank
        .iter()
        .map(|segment| {
            let cylinder =
                ShankCylinder { from_mm, to_mm: from_mm + segment.length_mm, radius_mm: segment.radius_mm };
            from_mm = cylinder.to_mm;
            cylinder
        })
        .collect()
}

/// The arm of a case, with its limits.
pub fn arm(case: &Case) -> Result<Arm, PlanError> {
    if case.robot.model != "bone-attached" {
        return Err(PlanError::Unsupported {
            key: "robot.model",
            value: case.robot.model.clone(),
            supported: "\"bone-attached\"",
        });
    }
    for (key, given) in [
        ("robot.jerk_limits", case.robot.jerk_limits.is_some()),
        ("robot.flange_from_burr", case.robot.flange_from_burr.is_some()),
    ] {
        if given {
            // silently ignoring either would give another motion than the case asks for
            return Err(PlanError::Unsupported {
                key,
                value: "given".into(),
                supported: "no such key with the bone-attached arm, whose URDF ends at the burr",
            });
        }
    }
    let velocity = case.robot.velocity_limits.as_deref();
    let acceleration = case.robot.acceleration_limits.as_deref();
    Ok(Arm::bone_attached()?.with_limits(velocity, acceleration)?)
}

/// base_from_ct: the case's, or the assumed one, which puts the target's centre at the base's origin and lets the arm
/// tilt in the y–z plane of θ.
pub fn base_from_ct(registration: &Registration, scene: &Scene) -> Rigid<Base, Ct> {
    match registration {
        Registration::Given { rotation, translation_mm } => Rigid::new(*rotation, *translation_mm),
        Registration::Assumed => {
            // base x, y, z are approach y, −x, z
            let turn =
                Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0));
            let ct_from_approach = scene.ct_from_approach();
            let center = ct_from_approach.inverse() * (scene.ct_from_work * scene.target_center);
            let base_from_approach: Rigid<Base, Approach> = Rigid::new(turn, -(turn * center.coords));
            base_from_approach * ct_from_approach.inverse()
        }
    }
}

/// Axes that the bone-attached arm reaches, in work.
pub fn tilt_family(arm: &Arm, base_from_work: &Rigid<Base, Work>) -> TiltFamily {
    let work_from_base = base_from_work.rotation.inverse();
    let tilt = &arm.joints()[3];
    TiltFamily {
        // the joint turns the axis from z towards −x: about −y
        hinge: Unit::new_normalize(work_from_base * -Vector3::y()),
        zero: Unit::new_normalize(work_from_base * Vector3::z()),
        lower_rad: tilt.lower,
        upper_rad: tilt.upper,
    }
}
