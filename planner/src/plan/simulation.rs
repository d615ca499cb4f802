//! The files of a simulation: `simulation.csv`, and its part of `report.html`; each written whole or not at all.

use std::io::Write;
use std::path::{Path, PathBuf};

use super::PlanFileError;
use super::addition::{ReportPart, add_to_report, replace};
use crate::case::Case;
use crate::simulate::{Simulation, SimulationRow};

/// The table's name in a plan's directory.
pub const SIMULATION: &str = "simulation.csv";

/// The columns, in order; ct frame.
const COLUMNS: [&str; 14] = [
    "time_s",
    "x_mm",
    "y_mm",
    "z_mm",
    "fx_n",
    "fy_n",
    "fz_n",
    "torque_nmm",
    "power_w",
    "mrr_mm3_s",
    "force_toward_n",
    "structure",
    "distance_mm",
    "deflection_um",
];

/// Writes a simulation into its plan's directory; one that stands there is replaced. Without a report, none is made.
///
/// # Errors
/// [`PlanFileError`] for a value that is not finite, a structure that the case lacks, or a file that cannot be written.
pub fn save_simulation(dir: &Path, simulation: &Simulation, case: &Case) -> Result<PathBuf, PlanFileError> {
    let path = dir.join(SIMULATION);
    let mut text = COLUMNS.join(",").into_bytes();
    text.push(b'\n');
    for (index, row) in simulation.rows.iter().enumerate() {
        push_row(&mut text, index, row, case)?;
    }
    replace(dir, SIMULATION, &text)?;
    add_to_report(dir, ReportPart::Simulation, &crate::report::simulation::section(simulation, case))?;
    Ok(path)
}

fn push_row(out: &mut Vec<u8>, index: usize, row: &SimulationRow, case: &Case) -> Result<(), PlanFileError> {
    let (p, f) = (row.position.coords, row.force_n);
    let always = [row.time_s, p.x, p.y, p.z, f.x, f.y, f.z, row.torque_nmm, row.power_w, row.mrr_mm3_s];
    let structure = match row.structure {
        None => "",
        Some(n) => match case.structures.get(n) {
            Some(structure) => structure.name.as_str(),
            None => {
                return Err(PlanFileError::NoSuchStructure {
                    index,
                    structure: n,
                    count: case.structures.len(),
                });
            }
        },
    };
    let values =
        always.map(Some).into_iter().chain([row.force_toward_n, None, row.distance_mm, row.deflection_um]);
    for (n, (value, column)) in values.zip(COLUMNS).enumerate() {
        if n > 0 {
            out.push(b',');
        }
        match value {
            Some(v) if !v.is_finite() => {
                return Err(PlanFileError::NotFinite {
                    what: format!("`{column}` of simulation row {index}"),
                    value: v,
                });
            }
            // + 0.0 makes −0 a plain 0; writing to a Vec cannot fail
            Some(v) => drop(write!(out, "{:?}", v + 0.0)),
            None if column == "structure" => out.extend_from_slice(structure.as_bytes()),
            None => {}
        }
    }
    out.push(b'\n');
    Ok(())
}
