//! From the case's values to the tools of planning: burr, material, arm, and where the arm is assumed to stand.

use std::f64::consts::PI;
use std::path::Path;

use bonemill_arm::ur::{UrModel, has_ur_joints, read_ur};
use bonemill_arm::{Arm, read_urdf};
use bonemill_case::{self as case, Case, ToolSpec};
use bonemill_cutting::burr::{
    AtPoints, Discretisation, ElementGrid, Feed, ForceKernel, Material, Measure, ModelError, Tool,
};
use bonemill_cutting::cutter::ShankCylinder;
use bonemill_geometry::{Approach, Base, Ct, Rigid};
use bonemill_toolpath::scene::Scene;
use nalgebra::{Matrix3, Rotation3, Vector3};

use super::{PlanError, mount};

/// The burr of a case.
pub fn tool(burr: &case::Burr) -> Result<Tool, ModelError> {
    Tool::new(burr.radius_mm, burr.flutes, i32::from(burr.spin))?.with_neck(burr.neck_radius_mm)
}

/// Its material, and the measure that its coefficients belong to.
pub fn material(material: &case::MaterialSpec) -> Result<(Material, Measure), ModelError> {
    let made = Material::new(material.k_n_mm2, material.rho_ref_g_cm3)?
        .with_edge(material.k_edge_n_mm, material.t0_mm)?
        .with_density_law(material.exponent, 0.0)?;
    Ok((made, material.measure))
}

/// The force sum's discretisation for a burr: `n_kappa` elements from tip to shaft, about twice as many around.
pub fn discretisation(tool: &Tool, measure: Measure, n_kappa: u32) -> Result<Discretisation, ModelError> {
    let n_kappa = n_kappa as usize;
    let n_gamma = (2 * n_kappa).div_ceil(tool.blades() as usize);
    Discretisation::new(n_gamma, n_kappa, ElementGrid::Kappa, measure)
}

/// The shank as cylinders; the first starts at the burr's radius.
pub fn shank(case: &Case) -> Vec<ShankCylinder> {
    shank_from(case, case.burr.radius_mm)
}

/// The same where the first starts at a height.
pub fn shank_from(case: &Case, from_mm: f64) -> Vec<ShankCylinder> {
    ShankCylinder::stacked(from_mm, case.shank.iter().map(|segment| [segment.length_mm, segment.radius_mm]))
}

/// Where a UR's patient is assumed, as shares of its reach: before the base and above it. In the middle of the range, the
/// handpiece upright above it, far from the base and the shoulder's cylinder.
const ASSUMED_PLACE: [f64; 2] = [0.55, 0.05];

/// The arm of a case, with its tool and limits; `folder` is the case file's.
///
/// # Errors
/// [`PlanError::Needed`] where a UR has no tool, [`PlanError::Unsupported`] where the bone-attached arm is given one,
/// [`PlanError::Mount`] where the arm cannot hold the tool so, [`PlanError::Robot`] where a file cannot be used or limits do not fit.
pub fn arm(case: &Case, folder: &Path) -> Result<Arm, PlanError> {
    let robot = &case.robot;
    let refused = |key, supported: &str| {
        Err(PlanError::Unsupported { key, value: "given".into(), supported: supported.into() })
    };
    let model = UrModel::by_name(&robot.model);
    if robot.calibration.is_some() && model.is_none() {
        return refused("robot.calibration", &format!("a calibration file for {} only", UrModel::names()));
    }
    if robot.branch.is_some() && model.is_none() {
        return refused("robot.branch", &format!("branches of {} only: leave the key out", UrModel::names()));
    }
    let arm = match (robot.model.as_str(), model) {
        ("bone-attached", _) if robot.flange_from_burr.is_some() => {
            // silently ignoring it would give another motion than the case asks for
            return refused(
                "robot.flange_from_burr",
                "no such key with the bone-attached arm, whose URDF ends at the burr",
            );
        }
        ("bone-attached", _) => Arm::bone_attached()?,
        (_, Some(_)) if robot.flange_from_burr.is_none() => {
            return Err(PlanError::Needed {
                key: "robot.flange_from_burr",
                model: robot.model.clone(),
                example: "where the burr's centre is in the flange's frame, and the axes with z to the handpiece; for a \
                          handpiece straight on the flange with the burr 180 mm before it: flange_from_burr with \
                          translation_mm = [0, 0, 180] and rpy_rad = [3.141592653589793, 0, 0]",
            });
        }
        (_, Some(model)) => {
            read_ur(model, robot.calibration.as_ref().map(|path| folder.join(path)).as_deref())?
        }
        (path, None) => read_urdf(&folder.join(path))?,
    };
    let arm = arm.with_limits(robot.velocity_limits.as_deref(), robot.acceleration_limits.as_deref())?;
    let arm = match &robot.jerk_limits {
        Some(jerk) => arm.with_jerk_limits(jerk)?,
        None => arm,
    };
    let Some(mount) = mount::mount(case) else { return Ok(arm) };
    mount::judge(case, &arm, &mount)?;
    Ok(arm.with_mount(mount))
}

/// A burr of a larger radius than this is rare, mm: those of otologic drills have diameters of 0.5 to 7 mm.
const LARGE_RADIUS_MM: f64 = 3.5;

/// What is to be known of tool and arm: a radius that may be a diameter, degrees that may be radians, a doubtful mount, and the
/// arm's accuracy.
pub fn warnings(case: &Case, arm: &Arm) -> Vec<String> {
    doubts(case).into_iter().chain(accuracy_warning(case, arm)).collect()
}

/// Values that look like another unit's or like a diameter.
pub fn doubts(case: &Case) -> Vec<String> {
    let radius_mm = case.burr.radius_mm;
    let large = (case.tool == ToolSpec::Burr && radius_mm > LARGE_RADIUS_MM).then(|| {
        format!("burr.radius_mm = {radius_mm} is a radius, that of a burr of {} mm in diameter; few burrs are larger than {} mm", 2.0 * radius_mm, 2.0 * LARGE_RADIUS_MM)
    });
    let radians = |key: &str, degrees: f64| {
        format!(
            "{key} = {degrees:.3} is in degrees; it looks like radians, which would be {:.1} here",
            degrees.to_degrees()
        )
    };
    let tilt_deg = case.orientation.tilt_limit_rad.to_degrees();
    let small =
        (tilt_deg > 0.0 && tilt_deg <= 0.5 * PI).then(|| radians("orientation.tilt_limit_deg", tilt_deg));
    // a sixth or a quarter of half a turn, and multiples up to a turn
    let is_round = |deg: f64| {
        let of = |part: f64| (deg / part).abs() > 0.5 && (deg - (deg / part).round() * part).abs() < 5e-3;
        deg.abs() < 6.3 && (of(PI / 6.0) || of(PI / 4.0))
    };
    let raster_deg = case.path.raster_rad.map(f64::to_degrees);
    let raster = raster_deg.filter(|deg| is_round(*deg)).map(|deg| radians("path.raster_deg", deg));
    [large, small, raster, mount::warning(case)].into_iter().flatten().collect()
}

fn accuracy_warning(case: &Case, arm: &Arm) -> Option<String> {
    let Some(model) = UrModel::by_name(&case.robot.model) else {
        return has_ur_joints(arm).then(|| {
            format!(
                "{} has a UR's joints: unless it was made from the arm's own calibration, its kinematics are nominal and a real \
                 arm's tool is 1 to 2 mm off",
                case.robot.model
            )
        });
    };
    case.robot.calibration.is_none().then(|| {
        format!(
            "nominal kinematics of the {}: a real arm's tool is 1 to 2 mm off; give its calibration file as robot.calibration",
            model.name()
        )
    })
}

/// base_from_ct where the case gives none: base x, y, z along the approach's y, −x, z.
///
/// The bone-attached arm has the target's centre at its base's origin; a UR has it before and above its base by
/// `ASSUMED_PLACE`, the approach upright.
///
/// # Errors
/// [`PlanError::Needed`] for an arm from a URDF, of which nothing is known that could be assumed.
pub fn assumed_base_from_ct(robot: &case::RobotSpec, scene: &Scene) -> Result<Rigid<Base, Ct>, PlanError> {
    let place = match (robot.model.as_str(), UrModel::by_name(&robot.model)) {
        ("bone-attached", _) => Vector3::zeros(),
        (_, Some(model)) => {
            let [before, above] = ASSUMED_PLACE.map(|share| share * model.reach_mm());
            Vector3::new(before, 0.0, above)
        }
        (path, None) => {
            return Err(PlanError::Needed {
                key: "robot.base_from_ct",
                model: path.into(),
                example: "where the patient is, e.g. base_from_ct with rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]] and \
                          translation_mm = [400, 0, 100], or with fiducials",
            });
        }
    };
    let turn = Rotation3::from_matrix_unchecked(Matrix3::new(0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0));
    let ct_from_approach = scene.ct_from_approach();
    let center = ct_from_approach.inverse() * (scene.ct_from_work * scene.target_center);
    let base_from_approach: Rigid<Base, Approach> = Rigid::new(turn, place - turn * center.coords);
    Ok(base_from_approach * ct_from_approach.inverse())
}

/// Force of a straight shaft in a cut of the path's depth beside the line before, in the reference material at the nominal speed, N; at least
/// `LEAST_OF_SLOT` of that in a full slot, since lines may be so close that nothing stands beside.
///
/// # Errors
/// When the burr or the material is not usable.
pub fn side_cut_n(case: &Case) -> Result<f64, ModelError> {
    const LEAST_OF_SLOT: f64 = 0.1;
    let tool = tool(&case.burr)?;
    let (material, measure) = material(&case.material)?;
    let kernel =
        ForceKernel::new(&tool, &material, &discretisation(&tool, measure, case.accuracy.force_elements)?);
    let (radius_mm, path) = (case.burr.radius_mm, &case.path);
    let force_n = |from_y_mm: f64| {
        let is_bone =
            |n: &Vector3<f64>| radius_mm * n.z <= path.layer_mm - radius_mm && radius_mm * n.y >= from_y_mm;
        let mut bone = AtPoints(|n: &Vector3<f64>| f64::from(u8::from(is_bone(n))));
        let (axis, feed) = (Vector3::z_axis(), Vector3::x_axis());
        let (speed, rpm) = (case.speed.nominal_mm_s, case.burr.spindle_rpm);
        kernel.engaged_force(&axis, &Feed::new(&feed, speed, rpm), &mut bone).force_n(speed).norm()
    };
    Ok(force_n(radius_mm - path.stepover_mm).max(LEAST_OF_SLOT * force_n(-radius_mm)))
}

/// Mass that a step takes in a full slot of the reference material, mg.
pub fn slot_mass_mg(case: &Case, step_mm: f64) -> f64 {
    PI * case.burr.radius_mm.powi(2) * step_mm * case.material.rho_ref_g_cm3
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case(more: &str) -> Case {
        let text = "structure = []\n[images]\nct = \"c\"\nlabels = \"l\"\n[target]\nlabel = 1\n";
        Case::parse(&format!("{text}{more}"), Path::new("case.toml")).unwrap()
    }

    #[test]
    fn a_radius_that_may_be_a_diameter_and_degrees_that_may_be_radians_are_told() {
        let mut case = case("[burr]\nradius_mm = 3.6\n");
        let told = |case: &Case| warnings(case, &Arm::bone_attached().unwrap());
        assert!(told(&case)[0].contains("radius_mm = 3.6 is a radius, that of a burr of 7.2 mm in diameter"));
        case.burr.radius_mm = 3.5;
        assert_eq!(told(&case), Vec::<String>::new());
        case.orientation.tilt_limit_rad = 0.785f64.to_radians();
        assert!(
            told(&case)[0]
                .contains("tilt_limit_deg = 0.785 is in degrees; it looks like radians, which would be 45.0")
        );
        case.orientation.tilt_limit_rad = 0.785;
        for (deg, is_told) in [
            (1.571, true),
            (-0.79, true),
            (1.05, true),
            (-2.36, true),
            (0.0, false),
            (1.5, false),
            (90.0, false),
        ] {
            case.path.raster_rad = Some(f64::to_radians(deg));
            assert_eq!(told(&case).iter().any(|text| text.contains("path.raster_deg = ")), is_told, "{deg}");
        }
    }

    #[test]
    fn lines_however_close_leave_a_force_to_measure_pushes_by() {
        let mut case = case("");
        let mut of = |layer_mm: f64, stepover_mm: f64| {
            (case.path.layer_mm, case.path.stepover_mm) = (layer_mm, stepover_mm);
            side_cut_n(&case).unwrap()
        };
        let [usual, close, closer] = [(1.5, 1.667), (0.6, 0.6), (0.1, 0.05)].map(|(l, s)| of(l, s));
        assert!(usual > close && close > closer && closer > 1e-4, "{usual} {close} {closer} N");
    }
}
