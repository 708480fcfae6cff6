//! Numbers as NumPy has them. Its own crate would bring a second library of arrays, whose features would have the whole workspace compiled twice.

use pyo3::prelude::*;
use pyo3::types::PyByteArray;

/// A number that NumPy knows.
pub(crate) trait Element: Copy {
    /// Its type in the words of NumPy.
    const TYPE: &'static str;
    /// Its bytes, as they lie in memory.
    fn bytes(self) -> impl IntoIterator<Item = u8>;
}

impl Element for f64 {
    const TYPE: &'static str = "=f8";
    fn bytes(self) -> impl IntoIterator<Item = u8> {
        self.to_ne_bytes()
    }
}

impl Element for u32 {
    const TYPE: &'static str = "=u4";
    fn bytes(self) -> impl IntoIterator<Item = u8> {
        self.to_ne_bytes()
    }
}

/// An array of its own with these numbers, row by row.
pub(crate) fn array<'py, T: Element, const N: usize>(
    py: Python<'py>,
    values: &[T],
    shape: [usize; N],
) -> PyResult<Bound<'py, PyAny>> {
    let bytes: Vec<u8> = values.iter().flat_map(|v| v.bytes()).collect();
    // Of a `bytearray`, so that it can be written to.
    let flat = py.import("numpy")?.call_method1("frombuffer", (PyByteArray::new(py, &bytes), T::TYPE))?;
    flat.call_method1("reshape", (shape,))
}

/// The same of one axis.
pub(crate) fn column<'py>(py: Python<'py>, values: &[f64]) -> PyResult<Bound<'py, PyAny>> {
    array(py, values, [values.len()])
}

/// The same of rows of `width`.
pub(crate) fn rows<'py>(py: Python<'py>, values: &[f64], width: usize) -> PyResult<Bound<'py, PyAny>> {
    array(py, values, [values.len() / width.max(1), width])
}
