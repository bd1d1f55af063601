//! Atomic addition of floats. Portable WebGPU has no such instruction, so there are two implementations. The host
//! selects one from the features that the device reports.

use cubecl::prelude::*;

/// An atomic addition to a float.
#[cube]
pub trait AtomicSum: Send + Sync + 'static {
    /// The type of the float's four bytes in the buffer.
    type Cell: CubePrimitive;

    /// Adds.
    fn add(cell: &Atomic<Self::Cell>, value: f32);
}

/// The device's atomic addition.
pub struct NativeSum;

/// Atomic exchanges of bits. A unit takes the value, stores the sum, and repeats with any value that arrived in
/// between.
pub struct ExchangedSum;

#[cube]
impl AtomicSum for NativeSum {
    type Cell = f32;

    fn add(cell: &Atomic<f32>, value: f32) {
        cell.fetch_add(value);
    }
}

#[cube]
impl AtomicSum for ExchangedSum {
    type Cell = u32;

    fn add(cell: &Atomic<u32>, value: f32) {
        let mut left = value;
        while left != 0.0f32 {
            let sum = f32::reinterpret(cell.exchange(0u32)) + left;
            left = f32::reinterpret(cell.exchange(u32::reinterpret(sum)));
        }
    }
}
