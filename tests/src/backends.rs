//! The CPU backends that were compiled in: the same test bodies run on each.

use burn::tensor::Device;
use mvfusion_model::device;

/// A backend of Burn under its name in test names.
#[derive(Clone, Copy, Debug)]
pub struct Backend {
    /// `flex` or `ndarray`.
    pub name: &'static str,
    /// Makes its device.
    pub device: fn() -> Device,
}

/// Every backend that this build can test.
pub fn backends() -> Vec<Backend> {
    vec![
        #[cfg(feature = "flex")]
        Backend { name: "flex", device: device::flex },
        #[cfg(feature = "ndarray")]
        Backend { name: "ndarray", device: device::ndarray },
    ]
}
