//! `[robot]` from text: the arm, its limits, and where the patient is.

use std::path::PathBuf;

use bonemill_arm::ur::Branches;
use bonemill_geometry::{Base, Ct, NotARotation, Rigid};
use nalgebra::{Matrix3, Quaternion, Rotation3, UnitQuaternion, Vector3};

use toml::de::DeValue;

use super::error::CaseFault;
use super::keys::{self as k, Number};
use super::parse::BONE_ATTACHED;
use super::walker::{Walk, as_number};
use super::{Registration, RobotSpec, RoomSpec};

pub(super) fn read_robot(t: Walk<'_, '_>) -> RobotSpec {
    let base_from_ct = t.table("base_from_ct");
    let flange_from_burr = t.table("flange_from_burr");
    let model = t.text(&k::MODEL).unwrap_or_else(|| BONE_ATTACHED.into());
    let robot = RobotSpec {
        room: RoomSpec::read(&t, &model),
        model,
        calibration: t.text(&k::CALIBRATION).map(PathBuf::from),
        branch: read_branch(&t),
        base_from_ct: read_registration(base_from_ct),
        flange_from_burr: read_mount(flange_from_burr),
        joint_stiffness: read_joints(&t, &k::STIFFNESS),
        velocity_limits: read_joints(&t, &k::VELOCITY),
        acceleration_limits: read_joints(&t, &k::ACCELERATION),
        jerk_limits: read_joints(&t, &k::JERK),
        rate_hz: t.number(&k::RATE),
    };
    t.finish();
    robot
}

fn read_branch(t: &Walk<'_, '_>) -> Option<Branches> {
    let value = t.raw(&k::BRANCH)?;
    let found = match value {
        DeValue::String(words) => Branches::named(words),
        DeValue::Integer(_) => as_number(value).filter(|n| *n >= 0.0).and_then(|n| Branches::one(n as u8)),
        _ => None,
    };
    if found.is_none() {
        t.refuse(&k::BRANCH, value);
    }
    found
}

fn read_joints(t: &Walk<'_, '_>, of: &Number) -> Option<Vec<f64>> {
    let list = t.list(of)?;
    if list.is_empty() {
        let name = k::name_of(of.path);
        let expected = "one per joint, or the key left out".into();
        t.note(name, CaseFault::Length { key: t.key(name), found: 0, expected });
    }
    Some(list)
}

fn read_mount(t: Walk<'_, '_>) -> Option<([f64; 3], [f64; 3])> {
    if !t.is_present() {
        return None;
    }
    let mount = (t.required_vector(&k::FLANGE_TRANSLATION).into(), t.required_vector(&k::FLANGE_RPY).into());
    t.finish();
    Some(mount)
}

fn read_registration(t: Walk<'_, '_>) -> Registration {
    if !t.is_present() {
        return Registration::Assumed;
    }
    let fiducials = t.table("fiducials");
    if fiducials.is_present() {
        let also: Vec<_> = ["rotation", "quaternion_wxyz", "rpy_rad", "translation_mm"]
            .into_iter()
            .filter(|name| t.has(name))
            .collect();
        if !also.is_empty() {
            let found = std::iter::once("fiducials").chain(also).collect();
            let options = vec!["fiducials", "rotation with translation_mm"];
            t.note("", CaseFault::ExactlyOne { table: t.path().into(), found, options });
            t.accept(&["rotation", "quaternion_wxyz", "rpy_rad", "translation_mm"]);
        }
        let registration = read_fiducials(fiducials);
        t.finish();
        return registration;
    }
    let options = vec!["rotation", "quaternion_wxyz", "rpy_rad"];
    let found: Vec<_> = options.iter().copied().filter(|o| t.has(o)).collect();
    if found.len() != 1 {
        t.note("", CaseFault::ExactlyOne { table: t.path().into(), found, options });
    }
    let given = [read_matrix(&t), read_quaternion(&t), read_rpy(&t)];
    let rotation = given.into_iter().flatten().next().unwrap_or_else(Rotation3::identity);
    let translation_mm = t.required_vector(&k::TRANSLATION);
    t.finish();
    Registration::Given { rotation, translation_mm }
}

fn read_fiducials(t: Walk<'_, '_>) -> Registration {
    let points = |of: &Number| {
        let name = k::name_of(of.path);
        if !t.has(name) {
            t.note(
                name,
                CaseFault::Missing { key: t.key(name), expected: "a list of points [x, y, z], mm".into() },
            );
        }
        t.rows::<3>(of).unwrap_or_default()
    };
    let (ct_mm, base_mm) = (points(&k::FIDUCIALS_CT), points(&k::FIDUCIALS_BASE));
    if ct_mm.len() != base_mm.len() || ct_mm.len() < 3 {
        let expected = format!("as many points as ct_mm has ({}), at least three", ct_mm.len());
        t.note("base_mm", CaseFault::Length { key: t.key("base_mm"), found: base_mm.len(), expected });
    }
    t.finish();
    Registration::Fiducials { ct_mm, base_mm }
}

fn read_matrix(t: &Walk<'_, '_>) -> Option<Rotation3<f64>> {
    let rows = t.rows::<3>(&k::ROTATION)?;
    let key = t.key("rotation");
    let found = rows.len();
    let Ok([a, b, c]) = <[[f64; 3]; 3]>::try_from(rows) else {
        t.note("rotation", CaseFault::Length { key, found, expected: "3 rows".into() });
        return None;
    };
    let matrix = Matrix3::from_rows(&[a.into(), b.into(), c.into()]);
    rotation_from_matrix(&matrix)
        .map_err(|problem| t.note("rotation", CaseFault::NotARotation { key, problem }))
        .ok()
}

/// The rotation nearest to a matrix; a rotation stays as it is, so that a written one reads back bit for bit.
pub fn rotation_from_matrix(matrix: &Matrix3<f64>) -> Result<Rotation3<f64>, NotARotation> {
    let nearest = Rigid::<Base, Ct>::from_matrix(matrix, Vector3::zeros())?;
    let error = (matrix.transpose() * matrix - Matrix3::identity()).amax();
    Ok(if error < 1e-14 { Rotation3::from_matrix_unchecked(*matrix) } else { nearest.rotation })
}

fn read_quaternion(t: &Walk<'_, '_>) -> Option<Rotation3<f64>> {
    let [w, x, y, z] = t.exactly::<4>(&k::QUATERNION)?;
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    if (norm - 1.0).abs() > 1e-3 {
        let key = t.key("quaternion_wxyz");
        t.note("quaternion_wxyz", CaseFault::NotAUnitQuaternion { key, norm });
        return None;
    }
    Some(UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix())
}

fn read_rpy(t: &Walk<'_, '_>) -> Option<Rotation3<f64>> {
    let [roll, pitch, yaw] = t.exactly::<3>(&k::RPY)?;
    Some(Rotation3::from_euler_angles(roll, pitch, yaw))
}
