//! Arms: tables of kinematics for a comparison with other libraries, and the inverse on a million poses, including singular
//! ones.
//!
//! `kinematics_<arm>.csv` holds joint vectors with the pose and Jacobian that this project computes, in m and rad as in other
//! libraries. Any library that reads the arm's URDF (`Arm::urdf_text`, or `robot.urdf` of a plan) can be compared with them.
//! The table of the inverse needs no other library, because forward kinematics checks it.

use std::f64::consts::{PI, TAU};

use bonemill_geometry::{Base, Flange, Rigid};
use bonemill_planner::Progress;
use bonemill_robot::ur::{UrModel, UrSolutions};
use bonemill_robot::{Arm, JointKind};
use nalgebra::Matrix6xX;
use rayon::prelude::*;

use crate::{ExperimentError, Size, Table};

/// Number of joint vectors in a table for other libraries, and of inverted poses per seed.
const VECTORS: u64 = 10_000;
const POSES: u64 = 1_000_000;

/// Number of poses per arm that are also solved by damped least squares from many starts.
const SEARCHED: u64 = 1000;

/// Slowest direction of the tool below which a pose counts as singular, mm/s.
const SINGULAR_MM_S: f64 = 0.05;

/// A fixed stream of numbers in 0..1 (SplitMix64).
pub(crate) struct Stream(pub(crate) u64);

impl Stream {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// Joint vectors with their poses and Jacobians: long tables, meant for `--out` with `--quiet`.
///
/// # Errors
/// [`ExperimentError::Robot`] if a supplied arm cannot be made, which a test excludes.
pub fn run_kinematics(_: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    progress.stage("forward kinematics");
    let mut tables = vec![kinematics(&Arm::bone_attached()?, "bone-attached")?];
    for model in UrModel::ALL {
        tables.push(kinematics(&Arm::ur(model, None)?, model.name())?);
    }
    Ok(tables)
}

/// The inverse on a million poses of every UR.
///
/// # Errors
/// As [`run_kinematics`].
pub fn run_inverse(_: Size, progress: &dyn Progress) -> Result<Vec<Table>, ExperimentError> {
    let columns = [
        "arm",
        "poses",
        "branches found",
        "largest error [mm]",
        "largest error [rad]",
        "asked-for joints missing",
        "poses searched",
        "joints found by search",
        "of these missing",
    ];
    let mut table =
        Table::new("inverse", "UR inverse, every tenth pose singular or within 1e-3 rad of it", &columns);
    for model in UrModel::ALL {
        progress.stage("inverse kinematics");
        table.push(inverse(model)?);
    }
    Ok(vec![table])
}

/// A joint vector within the arm's limits.
pub(crate) fn random_q(arm: &Arm, stream: &mut Stream) -> Vec<f64> {
    let within = |joint: &bonemill_robot::Joint| joint.lower + stream.next() * (joint.upper - joint.lower);
    arm.joints().iter().map(within).collect()
}

/// Joint vectors, poses and Jacobians, in m and rad.
fn kinematics(arm: &Arm, name: &str) -> Result<Table, ExperimentError> {
    let mut columns: Vec<String> = (1..=arm.dof()).map(|j| format!("q{j}")).collect();
    columns.extend(["x", "y", "z"].map(String::from));
    columns.extend((0..9).map(|k| format!("r{}{}", k / 3 + 1, k % 3 + 1)));
    columns.extend((0..6 * arm.dof()).map(|k| format!("j{}{}", k / arm.dof() + 1, k % arm.dof() + 1)));
    let columns: Vec<&str> = columns.iter().map(String::as_str).collect();
    let title = format!("{name}: flange and its Jacobian in base, m and rad");
    let mut table = Table::new(&format!("kinematics_{name}"), title, &columns);
    let mut stream = Stream(11);
    for _ in 0..VECTORS {
        let q = random_q(arm, &mut stream);
        let row = in_metres(arm, &q, &arm.forward(&q)?, &arm.jacobian(&q)?);
        table.push(row.iter().map(|v| format!("{v:?}")).collect());
    }
    Ok(table)
}

/// Joints, the flange's position, its rotation by rows and the Jacobian by rows, in m and rad as in other libraries.
pub(crate) fn in_metres(
    arm: &Arm,
    q: &[f64],
    pose: &Rigid<Base, Flange>,
    jacobian: &Matrix6xX<f64>,
) -> Vec<f64> {
    let of_joint =
        |joint: &bonemill_robot::Joint| if joint.kind == JointKind::Prismatic { 1e-3 } else { 1.0 };
    let metres: Vec<f64> = arm.joints().iter().map(of_joint).collect();
    let mut row: Vec<f64> = q.iter().zip(&metres).map(|(q, m)| q * m).collect();
    row.extend((pose.translation_mm * 1e-3).iter());
    row.extend(pose.rotation.matrix().transpose().iter());
    for k in 0..6 {
        let lengths = if k < 3 { 1e-3 } else { 1.0 };
        row.extend(metres.iter().enumerate().map(|(j, m)| jacobian[(k, j)] * lengths / m));
    }
    row
}

/// Statistics of poses inverted in closed form.
#[derive(Debug, Clone, Copy, Default)]
struct InverseTally {
    branches: u64,
    worst_mm: f64,
    worst_rad: f64,
    missing: u64,
}

/// Results of a search, and how many of them the closed form lacks.
#[derive(Debug, Clone, Copy, Default)]
struct Searched {
    found: u64,
    missing: u64,
}

fn inverse(model: UrModel) -> Result<Vec<String>, ExperimentError> {
    let arm = Arm::ur(model, None)?;
    let portions: Result<Vec<InverseTally>, ExperimentError> =
        (0..POSES / 1000).into_par_iter().map(|portion| inverse_portion(&arm, model, portion)).collect();
    let sum = portions?.into_iter().fold(InverseTally::default(), |a, b| InverseTally {
        branches: a.branches + b.branches,
        worst_mm: a.worst_mm.max(b.worst_mm),
        worst_rad: a.worst_rad.max(b.worst_rad),
        missing: a.missing + b.missing,
    });
    let numeric = Arm::from_urdf(arm.urdf_text(), model.name())?;
    let searches: Result<Vec<Searched>, ExperimentError> =
        (0..SEARCHED).into_par_iter().map(|k| search(&numeric, model, k)).collect();
    let searched = searches?.into_iter().fold(Searched::default(), |a, b| Searched {
        found: a.found + b.found,
        missing: a.missing + b.missing,
    });
    Ok(vec![
        model.name().into(),
        POSES.to_string(),
        sum.branches.to_string(),
        format!("{:.2e}", sum.worst_mm),
        format!("{:.2e}", sum.worst_rad),
        sum.missing.to_string(),
        SEARCHED.to_string(),
        searched.found.to_string(),
        searched.missing.to_string(),
    ])
}

/// Searches a random pose from many starts, without use of branches. The closed form must contain every solution found.
fn search(numeric: &Arm, model: UrModel, pose: u64) -> Result<Searched, ExperimentError> {
    let mut stream = Stream(!pose);
    let q: [f64; 6] = std::array::from_fn(|_| (stream.next() - 0.5) * TAU);
    let closed = model.geometry().inverse(&numeric.forward(&q)?, q[5]);
    let mut searched = Searched::default();
    for q in &numeric.inverse(&numeric.burr(&q)?)?.q {
        searched.found += 1;
        let six = <[f64; 6]>::try_from(&q[..]).is_ok_and(|q| is_among(&closed, &q));
        searched.missing += u64::from(!six && numeric.slowest_mm_s(q)? >= SINGULAR_MM_S);
    }
    Ok(searched)
}

fn inverse_portion(arm: &Arm, model: UrModel, portion: u64) -> Result<InverseTally, ExperimentError> {
    let mut stream = Stream(1 + portion);
    let mut found = InverseTally::default();
    for k in 0..1000 {
        let mut q: [f64; 6] = std::array::from_fn(|_| (stream.next() - 0.5) * TAU);
        let near = [0.0, 1e-12, 1e-9, 1e-6, 1e-3][k / 10 % 5] * (stream.next() - 0.5);
        match k % 30 {
            0 => q[4] = near,
            10 => q[2] = near,
            20 => q[4] = PI + near,
            _ => {}
        }
        let pose = arm.forward(&q)?;
        let solutions = model.geometry().inverse(&pose, q[5]);
        found.branches += solutions.len() as u64;
        for (_, solution) in solutions.iter() {
            let (mm, rad) = apart(&arm.forward(solution)?, &pose);
            found.worst_mm = found.worst_mm.max(mm);
            found.worst_rad = found.worst_rad.max(rad);
        }
        // near a singularity joints may differ for the same pose, so only the pose is compared there
        let is_singular = k % 10 == 0 || arm.slowest_mm_s(&q)? < SINGULAR_MM_S;
        found.missing += u64::from(solutions.is_empty() || !(is_singular || is_among(&solutions, &q)));
    }
    Ok(found)
}

fn apart(a: &Rigid<Base, Flange>, b: &Rigid<Base, Flange>) -> (f64, f64) {
    let turn = a.rotation.matrix() - b.rotation.matrix();
    // |R − R'| of a small turn is √2 of its angle
    ((a.translation_mm - b.translation_mm).norm(), turn.norm() / 2f64.sqrt())
}

fn is_among(solutions: &UrSolutions, q: &[f64; 6]) -> bool {
    let near = |a: &f64, b: &f64| {
        let turned = (a - b).rem_euclid(TAU);
        turned.min(TAU - turned) < 1e-5
    };
    solutions.iter().any(|(_, found)| found.iter().zip(q).all(|(a, b)| near(a, b)))
}
