//! Named values of a plan as Python's own: dict, list, float, int, str, bool.

use bonemill_planner::plan::{Metrics, Value};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};

/// A table of a plan.
pub fn dict<'py>(py: Python<'py>, entries: &[(String, Value)]) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (name, value) in entries {
        dict.set_item(name, to_python(py, value)?)?;
    }
    Ok(dict)
}

/// The figures under the names that they have in `plan.toml`.
pub fn metrics<'py>(py: Python<'py>, metrics: &Metrics) -> PyResult<Bound<'py, PyDict>> {
    let all = PyDict::new(py);
    for (name, value) in [
        ("removed_mm3", metrics.removed_mm3),
        ("reachable_mm3", metrics.reachable_mm3),
        ("target_mm3", metrics.target_mm3),
        ("removed_material_mm3", metrics.removed_material_mm3),
        ("removed_bone_mm3", metrics.removed_bone_mm3),
        ("total_time_s", metrics.total_time_s),
    ] {
        all.set_item(name, value)?;
    }
    all.update(dict(py, &metrics.more)?.as_mapping())?;
    Ok(all)
}

fn to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::Number(v) => v.into_pyobject(py)?.into_any(),
        Value::Integer(v) => v.into_pyobject(py)?.into_any(),
        Value::Text(v) => v.into_pyobject(py)?.into_any(),
        Value::Flag(v) => v.into_pyobject(py)?.to_owned().into_any(),
        Value::List(items) => {
            let items: Vec<_> = items.iter().map(|v| to_python(py, v)).collect::<PyResult<_>>()?;
            PyList::new(py, items)?.into_any()
        }
        Value::Table(entries) => dict(py, entries)?.into_any(),
    })
}
