//! `simulation.csv`, written whole or not at all.

use std::path::{Path, PathBuf};

use bonemill_case::Case;
use bonemill_planfile::columns::{SIMULATION_ROWS, names};
use bonemill_planfile::{PlanFileError, push_number, replace, structure_name};

use super::{Simulation, SimulationRow};

/// The table's name in a plan's directory.
pub const SIMULATION: &str = "simulation.csv";

/// The columns, in order; ct frame.
const COLUMNS: [&str; 14] = names(&SIMULATION_ROWS);

/// Writes a simulation's rows into its plan's directory; an existing file is replaced.
///
/// # Errors
/// [`PlanFileError`] for a value that is not finite, a structure that the case lacks, or a file that cannot be written.
pub fn save_rows(dir: &Path, simulation: &Simulation, case: &Case) -> Result<PathBuf, PlanFileError> {
    let path = dir.join(SIMULATION);
    let mut text = COLUMNS.join(",").into_bytes();
    text.push(b'\n');
    for (index, row) in simulation.rows.iter().enumerate() {
        push_row(&mut text, index, row, case)?;
    }
    replace(dir, SIMULATION, &text)?;
    Ok(path)
}

fn push_row(out: &mut Vec<u8>, index: usize, row: &SimulationRow, case: &Case) -> Result<(), PlanFileError> {
    let (p, f) = (row.position.coords, row.force_n);
    let always = [row.time_s, p.x, p.y, p.z, f.x, f.y, f.z, row.torque_nmm, row.power_w, row.mrr_mm3_s];
    let structure = row.structure.map_or(Ok(""), |n| structure_name(&case.structures, n, index))?;
    let values =
        always.map(Some).into_iter().chain([row.force_toward_n, None, row.distance_mm, row.deflection_um]);
    for (n, (value, column)) in values.zip(COLUMNS).enumerate() {
        if n > 0 {
            out.push(b',');
        }
        push_number(out, value, || format!("`{column}` of simulation row {index}"))?;
        if column == "structure" {
            out.extend_from_slice(structure.as_bytes());
        }
    }
    out.push(b'\n');
    Ok(())
}
