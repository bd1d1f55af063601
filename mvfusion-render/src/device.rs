//! The devices that were compiled in, one constructor each.

use burn::tensor::Device;

/// Burn's pure-Rust CPU backend.
#[cfg(feature = "flex")]
pub fn flex() -> Device {
    Device::flex()
}

/// Burn's CPU backend on the `ndarray` crate.
#[cfg(feature = "ndarray")]
pub fn ndarray() -> Device {
    crate::host::ndarray::device()
}
