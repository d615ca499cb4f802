//! Compares forward kinematics and Jacobians with PyPI `pin`, which reads the same URDF. (The arms' benchmark compares with `k`.)

use bonemill_robot::Arm;
use bonemill_robot::ur::UrModel;

use super::{ask, least_s, write_f64};
use crate::arms::{Stream, in_metres, random_q};
use crate::{ExperimentError, Table};

const CONFIGURATIONS: usize = 10_000;
const RUNS: usize = 3;

pub(super) fn table() -> Result<Table, ExperimentError> {
    let title = format!(
        "Forward kinematics and Jacobians beside pin (PyPI) on the same URDF: largest difference in {CONFIGURATIONS} random \
         configurations, and times on one thread; pin's include its Python call"
    );
    let columns = [
        "arm",
        "position [nm]",
        "rotation [nrad]",
        "Jacobian [nm/rad]",
        "Jacobian [nrad/rad]",
        "pin [µs]",
        "ours [µs]",
    ];
    let mut table = Table::new("peers-kinematics", title, &columns);
    table.push(row(&Arm::bone_attached()?, "bone-attached", "burr")?);
    for model in UrModel::ALL {
        table.push(row(&Arm::ur(model, None)?, model.name(), "tool0")?);
    }
    Ok(table)
}

fn row(arm: &Arm, name: &str, tip: &str) -> Result<Vec<String>, ExperimentError> {
    let mut stream = Stream(11);
    let all: Vec<Vec<f64>> = (0..CONFIGURATIONS).map(|_| random_q(arm, &mut stream)).collect();
    let (own_s, found) = least_s(RUNS, || {
        all.iter()
            .map(|q| Ok((arm.forward(q)?, arm.jacobian(q)?)))
            .collect::<Result<Vec<_>, ExperimentError>>()
    });
    let found = found.transpose()?.unwrap_or_default();
    let numbers: Vec<f64> =
        all.iter().zip(&found).flat_map(|(q, (pose, jacobian))| in_metres(arm, q, pose, jacobian)).collect();
    let folder = tempfile::tempdir().map_err(ExperimentError::Folder)?;
    write_f64(&folder.path().join("answers"), &numbers)?;
    let urdf = folder.path().join("arm.urdf");
    std::fs::write(urdf, arm.urdf_text()).map_err(ExperimentError::Folder)?;
    std::fs::write(folder.path().join("tip"), tip).map_err(ExperimentError::Folder)?;
    let mut cells = vec![name.to_owned()];
    match ask(include_str!("kinematics.py"), folder.path()).as_deref() {
        Ok([answer]) if answer.len() == 5 => {
            cells.extend(answer[..4].iter().map(|worst| format!("{:.1e}", worst * 1e9)));
            cells.push(format!("{:.2}", answer[4] * 1e6 / CONFIGURATIONS as f64));
        }
        Ok(_) => cells.extend(["not measured", "-", "-", "-", "-"].map(String::from)),
        Err(why) => cells.extend([why.as_str(), "-", "-", "-", "-"].map(String::from)),
    }
    cells.push(format!("{:.2}", own_s * 1e6 / CONFIGURATIONS as f64));
    Ok(cells)
}
