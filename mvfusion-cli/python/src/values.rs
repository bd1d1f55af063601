//! Values of TOML as Python's own, and back. JSON would lose infinite numbers, which some keys accept.

use mvfusion_cli::failure::UsageError;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString};
use toml::{Table, Value};

use crate::error::raised;

/// A value as Python's own.
///
/// # Errors
/// If Python has no memory.
pub fn to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    match value {
        Value::String(text) => text.into_bound_py_any(py),
        Value::Integer(number) => number.into_bound_py_any(py),
        Value::Float(number) => number.into_bound_py_any(py),
        Value::Boolean(is) => is.into_bound_py_any(py),
        Value::Datetime(time) => time.to_string().into_bound_py_any(py),
        Value::Array(values) => {
            values.iter().map(|value| to_python(py, value)).collect::<PyResult<Vec<_>>>()?.into_bound_py_any(py)
        }
        Value::Table(table) => {
            let dict = PyDict::new(py);
            for (key, value) in table {
                dict.set_item(key, to_python(py, value)?)?;
            }
            Ok(dict.into_any())
        }
    }
}

/// A dict as a table.
///
/// # Errors
/// `UsageError` for a value that TOML does not have.
pub fn table(dict: &Bound<'_, PyDict>) -> PyResult<Table> {
    dict.iter().map(|(key, inner)| Ok((key.extract::<String>()?, value(&inner)?))).collect()
}

fn value(of: &Bound<'_, PyAny>) -> PyResult<Value> {
    let refused = |what: String| Err(raised(&UsageError::new(format!("the configuration holds {what}.")).into()));
    if let Ok(dict) = of.cast::<PyDict>() {
        return Ok(Value::Table(table(dict)?));
    }
    if let Ok(list) = of.cast::<PyList>() {
        return Ok(Value::Array(list.iter().map(|item| value(&item)).collect::<PyResult<_>>()?));
    }
    // In Python, a bool is an int.
    if let Ok(is) = of.cast::<PyBool>() {
        return Ok(Value::Boolean(is.is_true()));
    }
    if of.is_instance_of::<PyInt>() {
        return match of.extract() {
            Ok(number) => Ok(Value::Integer(number)),
            Err(_) => refused(format!("the number {of}, which no key accepts")),
        };
    }
    if of.is_instance_of::<PyFloat>() {
        return Ok(Value::Float(of.extract()?));
    }
    if of.is_instance_of::<PyString>() {
        return Ok(Value::String(of.extract()?));
    }
    refused(format!("a {}, which is no value of a key", of.get_type().name()?))
}
