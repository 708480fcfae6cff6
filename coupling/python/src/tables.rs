//! Tables as plain objects: `{name of column: values}`, in their order.

use command::output::tables::Series;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::column;

/// A table over time, `time_s` first.
pub(crate) fn of_series<'py>(py: Python<'py>, series: &Series) -> PyResult<Bound<'py, PyDict>> {
    let table = PyDict::new(py);
    table.set_item("time_s", column(py, &series.time)?)?;
    for (name, values) in &series.columns {
        table.set_item(name, column(py, values)?)?;
    }
    Ok(table)
}

/// A value of Python as TOML has it: words, numbers, truth values and lists of these.
pub(crate) fn to_toml(value: &Bound<'_, PyAny>) -> PyResult<toml::Value> {
    if let Ok(flag) = value.extract::<bool>() {
        return Ok(flag.into());
    }
    if let Ok(count) = value.extract::<i64>() {
        return Ok(count.into());
    }
    if let Ok(number) = value.extract::<f64>() {
        return Ok(number.into());
    }
    if let Ok(word) = value.extract::<String>() {
        return Ok(word.into());
    }
    let list = value.try_iter()?.map(|element| to_toml(&element?)).collect::<PyResult<Vec<_>>>()?;
    Ok(toml::Value::Array(list))
}
