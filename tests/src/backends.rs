//! The backends that were compiled in: the same test bodies run on each.

use burn::tensor::Device;
use mvfusion_model::device;

/// A backend of Burn under its name in test names.
#[derive(Clone, Copy, Debug)]
pub struct Backend {
    /// `flex`, `ndarray`, `wgpu` or `cuda`.
    pub name: &'static str,
    /// Makes its device.
    pub device: fn() -> Device,
}

/// Every CPU backend that this build can test. They know double precision and keep the order of sums.
pub fn backends() -> Vec<Backend> {
    vec![
        #[cfg(feature = "flex")]
        Backend { name: "flex", device: device::flex },
        #[cfg(feature = "ndarray")]
        Backend { name: "ndarray", device: device::ndarray },
    ]
}

/// The GPU backends of this build, whether or not there is such a GPU.
pub fn gpu_backends() -> Vec<Backend> {
    vec![
        // Proof: who asks for the device has asked before whether it is there.
        #[cfg(feature = "wgpu")]
        Backend { name: "wgpu", device: || first("wgpu").expect("a GPU was found before") },
        #[cfg(feature = "cuda")]
        Backend { name: "cuda", device: || first("cuda").expect("a GPU was found before") },
    ]
}

/// Whether a GPU backend has found a device that can run the kernels, a software driver included.
pub fn is_there(backend: Backend) -> bool {
    first(backend.name).is_some()
}

/// The first GPU of a backend.
#[cfg(any(feature = "wgpu", feature = "cuda"))]
fn first(backend: &str) -> Option<Device> {
    device::gpus().iter().find(|gpu| gpu.backend == backend && gpu.properties().is_ok()).map(|gpu| gpu.device.clone())
}

#[cfg(not(any(feature = "wgpu", feature = "cuda")))]
fn first(_: &str) -> Option<Device> {
    None
}

/// Every backend that can be tested here.
pub fn every_backend() -> Vec<Backend> {
    backends().into_iter().chain(gpu_backends().into_iter().filter(|&backend| is_there(backend))).collect()
}
