//! Checks that the plan belongs to its inputs: digests, the case in it, its frames and its arm.

use std::f64::consts::PI;
use std::path::Path;

use bonemill_arm::ur::{UrModel, read_ur};
use bonemill_arm::{Arm, read_urdf};
use bonemill_case::{Case, Registration, Sense};
use bonemill_geometry::{Base, Ct, Point, Rigid, basis};
use bonemill_planfile::{Sha256, StoredPlan, Value};
use nalgebra::{Rotation3, Vector3};

use super::VerifyError;
use super::check::{Check, Place};

/// Name of the checks of what a plan chose.
const CHOICES: &str = "choices within the case";
/// Rounding of frames that are written and read back.
const ROUNDING: f64 = 1e-9;
/// Largest possible improvement of a fit to fiducials, mm.
const FIT_MM: f64 = 1e-4;

/// All checks of the plan's provenance; `case_text` is the case file as it is now.
///
/// # Errors
/// [`VerifyError::Robot`] when the description of the case's arm cannot be read.
pub fn provenance(plan: &StoredPlan, case_text: &str) -> Result<Vec<Check>, VerifyError> {
    let mut checks = vec![inputs(plan), case(plan, case_text)];
    checks.extend(frames(plan));
    checks.push(arm(plan)?);
    Ok(checks)
}

fn inputs(plan: &StoredPlan) -> Check {
    let record = &plan.record;
    let changed = record
        .inputs
        .iter()
        .filter(|input| Sha256::of_file(&plan.input_path(&input.path)).ok() != Some(input.sha256));
    let changed: Vec<String> = changed.map(|input| input.path.display().to_string()).collect();
    let check = Check::none_wrong("inputs unchanged", changed.len());
    if changed.is_empty() { check } else { check.at(Place::Named(changed.join(", "))) }
}

/// Checks that the case in the plan is that of its case file.
fn case(plan: &StoredPlan, text: &str) -> Check {
    const NAME: &str = "case of the plan";
    match Case::parse(text, &plan.case_path()) {
        Ok(case) if case == plan.record.case => Check::none_wrong(NAME, 0),
        Ok(case) => {
            let (now, then) = (case.to_toml(), plan.record.case.to_toml());
            let differs = then.lines().zip(now.lines()).filter(|(a, b)| a != b);
            let lines: Vec<String> = differs.map(|(a, b)| format!("`{a}`, the file `{b}`")).collect();
            let first = lines.first().cloned().unwrap_or_else(|| "another number of keys".into());
            Check::none_wrong(NAME, lines.len().max(1)).noting(format!("the plan says {first}"))
        }
        Err(error) => Check::none_wrong(NAME, 1).noting(format!("the case file is not valid: {error}")),
    }
}

/// Checks that what the plan says it chose is what its case gives, where that leaves no choice.
pub fn choices(plan: &StoredPlan) -> Vec<Check> {
    let (record, case) = (&plan.record, &plan.record.case);
    let number = |name| match record.modelled(name) {
        Some(Value::Number(v)) => Some(*v),
        Some(Value::Integer(v)) => Some(*v as f64),
        _ => None,
    };
    let spin = number("spin");
    let is_turned = match spin {
        Some(spin) => spin.abs() == 1.0 && (case.burr.turns_both_ways || spin == f64::from(case.burr.spin)),
        // plans of earlier versions state the chosen spin in their case
        None => true,
    };
    let is_along = case.path.raster_rad.is_none_or(|given_rad| {
        let turns = number("raster_deg").map(|deg| (deg.to_radians() - given_rad) / PI);
        turns.is_some_and(|turns| (turns - turns.round()).abs() < ROUNDING)
    });
    let is_in_sense = case.path.sense == Sense::Auto
        || record.modelled("sense") == Some(&Value::Text(case.path.sense.word().into()));
    let is_in_branch = case.robot.branch.is_none_or(|branches| {
        let branch = number("branch").filter(|branch| (0.0..8.0).contains(branch));
        branch.is_some_and(|branch| branches.contains(branch as u8))
    });
    let check = |key: &str, holds: bool| Check::none_wrong(CHOICES, usize::from(!holds)).of(key);
    vec![
        check("burr.spin", is_turned)
            .noting(spin.map_or(String::new(), |spin| format!("the plan turns it {spin:+}"))),
        check("path.raster_deg", is_along),
        check("path.sense", is_in_sense),
        check("robot.branch", is_in_branch),
    ]
}

fn frames(plan: &StoredPlan) -> Vec<Check> {
    const NAME: &str = "frames";
    let record = &plan.record;
    // a channel is approached along its own direction
    let along = record.channel().map(|channel| -channel.direction.into_inner());
    let approach = along.or(record.case.approach).unwrap_or(record.frames.approach_direction);
    let mut checks = vec![
        Check::at_most(NAME, (record.frames.approach_direction - approach).amax(), ROUNDING, "")
            .of("approach of the case"),
        Check::at_most(
            NAME,
            angle_rad(&record.frames.ct_from_approach.rotation, &basis::from_z(&approach)),
            ROUNDING,
            "rad",
        )
        .of("ct_from_work is the approach's basis"),
    ];
    let registration = Check::none_wrong(NAME, 0).of("base_from_ct of the case");
    checks.push(match &record.case.robot.base_from_ct {
        Registration::Assumed => {
            Check { value: f64::from(u8::from(!record.frames.registration_assumed)), ..registration }
                .noting("assumed: the case gives none")
        }
        Registration::Given { rotation, translation_mm } => {
            let turned = angle_rad(rotation, &record.frames.base_from_ct.rotation);
            let moved = (translation_mm - record.frames.base_from_ct.translation_mm).amax();
            let value = turned.max(moved) + f64::from(u8::from(record.frames.registration_assumed));
            Check { value, limit: ROUNDING, ..registration }
        }
        Registration::Fiducials { ct_mm, base_mm } => {
            let value = misfit(&record.frames.base_from_ct, ct_mm, base_mm);
            Check {
                value: value + f64::from(u8::from(record.frames.registration_assumed)),
                limit: FIT_MM,
                ..registration
            }
            .noting("how far the fit to the fiducials could still be bettered, mm")
        }
    });
    let mount = record.case.robot.flange_from_burr.unwrap_or_default();
    let [off_mm, off_rad] = between_mounts([mount, record.frames.flange_from_burr]);
    let check = Check::at_most(NAME, off_mm.max(off_rad), ROUNDING, "mm or rad");
    checks.push(check.of("flange_from_burr of the case"));
    checks
}

/// Distance, mm, and angle, rad, between two tools on the flange. Different sets of three angles can give the same rotation, so
/// the rotations are compared.
fn between_mounts([(a_mm, a_rpy), (b_mm, b_rpy)]: [Mount; 2]) -> [f64; 2] {
    let turn = |[roll, pitch, yaw]: [f64; 3]| Rotation3::from_euler_angles(roll, pitch, yaw);
    [(Vector3::from(a_mm) - Vector3::from(b_mm)).norm(), angle_rad(&turn(a_rpy), &turn(b_rpy))]
}

/// The angle between two rotations, rad in [0, π], by |A − B|_F = √8 sin(angle/2), which is accurate near 0, unlike an arc
/// cosine of the trace.
fn angle_rad(a: &Rotation3<f64>, b: &Rotation3<f64>) -> f64 {
    2.0 * ((a.matrix() - b.matrix()).norm() / 8f64.sqrt()).min(1.0).asin()
}

/// A tool on the flange: translation, mm, and roll, pitch and yaw, rad.
type Mount = ([f64; 3], [f64; 3]);

/// How much a registration could be improved, mm: the residuals' mean, and their mean moment divided by the points' spread.
/// Both are 0 exactly where the sum of squares is least, however the registration was computed.
fn misfit(base_from_ct: &Rigid<Base, Ct>, ct_mm: &[[f64; 3]], base_mm: &[[f64; 3]]) -> f64 {
    if ct_mm.len() != base_mm.len() || ct_mm.is_empty() {
        return f64::INFINITY;
    }
    let n = ct_mm.len() as f64;
    let pairs = || {
        ct_mm.iter().zip(base_mm).map(|(ct, base)| {
            let moved = (*base_from_ct * Point::<Ct>::from_coords(Vector3::from(*ct))).coords;
            (moved, Vector3::from(*base) - moved)
        })
    };
    let middle = pairs().map(|(p, _)| p).sum::<Vector3<f64>>() / n;
    let shift = pairs().map(|(_, r)| r).sum::<Vector3<f64>>() / n;
    let moment = pairs().map(|(p, r)| (p - middle).cross(&r)).sum::<Vector3<f64>>() / n;
    let spread = (pairs().map(|(p, _)| (p - middle).norm_squared()).sum::<f64>() / n).sqrt();
    shift.norm() + moment.norm() / spread.max(1e-9)
}

/// Checks that the plan's URDF is that of the arm that the case names.
fn arm(plan: &StoredPlan) -> Result<Check, VerifyError> {
    let robot = &plan.record.case.robot;
    let named = match (robot.model.as_str(), UrModel::by_name(&robot.model)) {
        ("bone-attached", _) => Arm::bone_attached()?,
        (_, Some(model)) => {
            let calibration = robot.calibration.as_deref().map(|path| plan.input_path(path));
            read_ur(model, calibration.as_deref())?
        }
        (path, None) => read_urdf(&plan.input_path(Path::new(path)))?,
    };
    let same = named.urdf_text() == plan.arm.urdf_text();
    let check = Check::none_wrong("arm of the case", usize::from(!same)).of(robot.model.clone());
    Ok(check.at((!same).then(|| Place::Named("robot.urdf".into()))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    /// Angles at gimbal lock, beyond half a turn, and arbitrary ones.
    fn angle() -> impl Strategy<Value = f64> {
        prop_oneof![
            Just(0.0),
            Just(PI),
            Just(-PI),
            Just(FRAC_PI_2),
            Just(-FRAC_PI_2),
            Just(FRAC_PI_2 + 1e-9),
            -10.0..10.0f64
        ]
    }

    proptest! {
        #[test]
        fn other_angles_of_one_rotation_are_the_same_mount(rpy in [angle(), angle(), angle()], by in 1e-6..PI) {
            let at = [1.0, -2.0, 180.0];
            let [roll, pitch, yaw] = rpy;
            // the second set of angles of the same rotation
            let other = [roll + PI, PI - pitch, yaw + PI];
            let [off_mm, off_rad] = between_mounts([(at, rpy), (at, other)]);
            prop_assert!(off_mm == 0.0 && off_rad < ROUNDING, "{rpy:?}: {off_rad}");
            // a rotation by an angle is measured as that angle
            let [_, off_rad] = between_mounts([(at, rpy), (at, [roll, pitch, yaw + by])]);
            prop_assert!((off_rad - by).abs() < 1e-7, "{rpy:?} by {by}: {off_rad}");
        }
    }

    #[test]
    fn a_best_fit_cannot_be_bettered_and_any_other_can() {
        let points: [[f64; 3]; 4] =
            [[0.0, 0.0, 0.0], [30.0, 5.0, 0.0], [0.0, 40.0, 10.0], [-20.0, 7.0, 25.0]];
        let exact: Rigid<Base, Ct> =
            Rigid::new(Rotation3::new(Vector3::new(0.3, -0.2, 0.5)), Vector3::new(4.0, 5.0, 6.0));
        let base = points.map(|p| <[f64; 3]>::from((exact * Point::<Ct>::from_coords(p.into())).coords));
        assert!(misfit(&exact, &points, &base) < 1e-12);
        let moved = Rigid::new(exact.rotation, exact.translation_mm + Vector3::new(0.01, 0.0, 0.0));
        assert!(misfit(&moved, &points, &base) > FIT_MM);
        let turned =
            Rigid::new(Rotation3::new(Vector3::new(0.0, 1e-4, 0.0)) * exact.rotation, exact.translation_mm);
        assert!(misfit(&turned, &points, &base) > FIT_MM);
        assert!(misfit(&exact, &points, &base[1..]).is_infinite());
    }
}
