//! `bonemill._native`: the planner for Python.
//!
//! This module only converts arrays and texts to the crates' types, calls the crates, and converts the results back. The
//! user's interface (names, units, defaults, structured arrays) is the package's Python code. Arrays are copied while the GIL
//! is held, so that a change during a call has no effect; results are passed on without a copy. Long work runs without the
//! GIL (`apart`), so that other Python threads continue and Ctrl-C works.

mod apart;
mod arm;
mod arrays;
mod calibrate;
mod case;
mod compare;
mod cutter;
mod errors;
mod fields;
mod finished;
mod force;
mod phantoms;
mod plan;
mod prosthesis;
mod show;
mod simulate;
mod slicer;
mod stream;
mod values;
mod verdict;
mod verify;
mod waypoints;

use pyo3::prelude::*;

/// The module's contents; `bonemill/_native.pyi` holds their types.
#[pymodule(gil_used = true)]
fn _native(m: &Bound<'_, PyModule>) -> PyResult<()> {
    m.add("__version__", env!("CARGO_PKG_VERSION"))?;
    m.add_class::<case::Case>()?;
    m.add_class::<plan::Plan>()?;
    m.add_class::<prosthesis::ProsthesisPlan>()?;
    m.add_class::<arm::Arm>()?;
    m.add_class::<stream::StreamPlan>()?;
    m.add_class::<cutter::Cutter>()?;
    m.add_function(wrap_pyfunction!(cutter::drill_force, m)?)?;
    m.add_function(wrap_pyfunction!(cutter::reamer_force, m)?)?;
    m.add_function(wrap_pyfunction!(case::with_values, m)?)?;
    m.add_function(wrap_pyfunction!(case::draft_case, m)?)?;
    m.add_function(wrap_pyfunction!(compare::compare, m)?)?;
    m.add_function(wrap_pyfunction!(plan::plan, m)?)?;
    m.add_function(wrap_pyfunction!(prosthesis::prosthesis, m)?)?;
    m.add_function(wrap_pyfunction!(simulate::simulate, m)?)?;
    m.add_function(wrap_pyfunction!(verify::verify, m)?)?;
    m.add_function(wrap_pyfunction!(verdict::verified, m)?)?;
    m.add_function(wrap_pyfunction!(calibrate::calibrate, m)?)?;
    m.add_function(wrap_pyfunction!(show::show, m)?)?;
    m.add_function(wrap_pyfunction!(slicer::to_slicer, m)?)?;
    m.add_function(wrap_pyfunction!(slicer::segments, m)?)?;
    m.add_function(wrap_pyfunction!(phantoms::write_phantom, m)?)?;
    m.add_function(wrap_pyfunction!(fields::distance_transform, m)?)?;
    m.add_function(wrap_pyfunction!(fields::ball_volumes, m)?)?;
    m.add_function(wrap_pyfunction!(force::burr_force, m)?)?;
    m.add_function(wrap_pyfunction!(force::engagement_metrics, m)?)?;
    Ok(())
}
