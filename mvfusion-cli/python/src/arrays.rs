//! Arrays on their way to NumPy.

use mvfusion_data::NamedArray;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

/// Name, shape and bytes of an array. The bytes can be written to, so NumPy's array is, too.
pub type Packed<'py> = (&'static str, Vec<usize>, Bound<'py, PyByteArray>);

/// The bytes of numbers, in the order of this machine.
pub fn packed<'py, T: bytemuck::NoUninit>(
    py: Python<'py>,
    name: &'static str,
    shape: Vec<usize>,
    values: &[T],
) -> Packed<'py> {
    (name, shape, PyByteArray::new(py, bytemuck::cast_slice(values)))
}

/// The same of an array that has its name and shape with it.
pub fn packed_array(py: Python<'_>, array: NamedArray) -> Packed<'_> {
    packed(py, array.name, array.shape, &array.values)
}
