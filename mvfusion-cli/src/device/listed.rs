//! The devices for scripts: `mvfusion devices --json`.

use serde::Serialize;

/// The devices that `--device` accepts, and the features of this build.
#[derive(Debug, Serialize)]
pub struct Listed {
    devices: Vec<ListedDevice>,
    /// The cargo features that name a device.
    features: Vec<&'static str>,
}

/// A device.
#[derive(Debug, Serialize)]
struct ListedDevice {
    /// For `--device`.
    name: String,
    kind: Kind,
    /// CPU threads that it uses; absent for a GPU.
    #[serde(skip_serializing_if = "Option::is_none")]
    threads: Option<usize>,
    /// The GPU, if it can be used.
    #[serde(skip_serializing_if = "Option::is_none")]
    card: Option<ListedCard>,
    /// Why it cannot be used.
    #[serde(skip_serializing_if = "Option::is_none")]
    error: Option<String>,
}

#[derive(Clone, Copy, Debug, Serialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    Cpu,
    #[cfg_attr(not(any(feature = "wgpu", feature = "cuda")), allow(dead_code, reason = "this build has no GPUs"))]
    Gpu,
    /// A driver that computes on the CPU.
    #[cfg_attr(not(any(feature = "wgpu", feature = "cuda")), allow(dead_code, reason = "this build has no GPUs"))]
    SoftwareGpu,
}

#[derive(Debug, Serialize)]
struct ListedCard {
    name: String,
    /// Bytes of the largest buffer.
    largest_buffer: u64,
    /// Bytes of shared memory of a workgroup.
    shared_memory: usize,
    /// The most threads of a workgroup.
    workgroup_threads: u32,
    atomic_float_addition: bool,
    /// What the kernels are compiled to.
    kernel_language: &'static str,
}

/// The compiled backends and the detected devices.
pub fn listed() -> Listed {
    let cpu = |name: &str| ListedDevice {
        name: name.to_owned(),
        kind: Kind::Cpu,
        threads: Some(rayon::current_num_threads()),
        card: None,
        error: None,
    };
    let cpus = [("flex", cfg!(feature = "flex")), ("ndarray", cfg!(feature = "ndarray"))];
    let cpus = cpus.into_iter().filter(|(_, is_built)| *is_built).map(|(name, _)| cpu(name));
    Listed { devices: cpus.chain(gpus()).collect(), features: super::features() }
}

#[cfg(any(feature = "wgpu", feature = "cuda"))]
fn gpus() -> impl Iterator<Item = ListedDevice> {
    use mvfusion_model::device::{Gpu, GpuProperties, gpus};

    let listed = |gpu: &Gpu| {
        let (card, error) = match gpu.properties() {
            Ok(GpuProperties { name, buffer, shared_memory, units, adds_floats, language }) => {
                let card = ListedCard {
                    name,
                    largest_buffer: buffer,
                    shared_memory,
                    workgroup_threads: units,
                    atomic_float_addition: adds_floats,
                    kernel_language: language,
                };
                (Some(card), None)
            }
            Err(error) => (None, Some(error.to_string())),
        };
        let kind = if gpu.is_software { Kind::SoftwareGpu } else { Kind::Gpu };
        ListedDevice { name: gpu.label(), kind, threads: None, card, error }
    };
    gpus().iter().map(listed)
}

#[cfg(not(any(feature = "wgpu", feature = "cuda")))]
fn gpus() -> impl Iterator<Item = ListedDevice> {
    std::iter::empty()
}
