//! Converts named values of a plan to Python's types: dict, list, float, int, str, bool.

use bonemill_planner::plan::Value;
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
