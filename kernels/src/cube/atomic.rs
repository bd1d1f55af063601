//! Sums of floats that many units add to. Portable WebGPU has no atomic for that, so there are two ways, and the host
//! chooses by what the device says it can do.

use cubecl::prelude::*;

/// A way to add to a float that other units add to as well.
#[cube]
pub trait AtomicSum: Send + Sync + 'static {
    /// What the float's four bytes are in the buffer.
    type Cell: CubePrimitive;

    /// Adds.
    fn add(cell: &Atomic<Self::Cell>, value: f32);
}

/// The device's own addition.
pub struct NativeSum;

/// Exchanges of bits: a unit takes what is there, puts the sum back, and goes on with what came in between.
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
