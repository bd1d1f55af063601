//! The devices that were compiled in: one constructor for each CPU backend, and a list of the GPUs that were found.

use burn::tensor::Device;

#[cfg(feature = "cube")]
pub use gpu::{Gpu, Limits, fold_launches, gpus, imitate_hardware};

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

/// The GPU that wgpu takes where none is named; a software driver where there is nothing else.
#[cfg(feature = "wgpu")]
pub fn wgpu() -> Device {
    Device::wgpu(burn::tensor::DeviceKind::DefaultDevice)
}

/// The first NVIDIA GPU, by CUDA.
#[cfg(feature = "cuda")]
pub fn cuda() -> Device {
    Device::cuda(0)
}

/// Bytes of the largest buffer of a device; `None` for a CPU, which has no such limit.
#[cfg(not(feature = "cube"))]
pub(crate) fn buffer_limit(_: &Device) -> Option<u64> {
    None
}

#[cfg(feature = "cube")]
pub(crate) use gpu::buffer_limit;

#[cfg(feature = "cube")]
mod gpu {
    use std::sync::OnceLock;

    use burn::backend::DispatchDevice;
    use burn::tensor::{Device, DeviceType};
    use burn_cubecl::CubeDevice;
    #[cfg(feature = "wgpu")]
    use cubecl::wgpu::WgpuDeviceKind;

    use crate::cube::gpu::adds_floats;

    /// A GPU that a backend of this build has found.
    #[derive(Clone, Debug)]
    pub struct Gpu {
        /// `cuda` or `wgpu`.
        pub backend: &'static str,
        /// Its number among those of the backend.
        pub index: usize,
        /// As it names itself.
        pub name: String,
        /// Whether it is a driver that computes on the CPU.
        pub is_software: bool,
        /// What it can hold and launch.
        pub limits: Limits,
        /// For Burn.
        pub device: Device,
    }

    /// What a GPU can hold and launch.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Limits {
        /// Bytes of the largest buffer.
        pub buffer: u64,
        /// Bytes that the units of a cube share.
        pub shared_memory: usize,
        /// Units of a cube.
        pub units: u32,
        /// Whether it adds floats atomically, or has to exchange them.
        pub adds_floats: bool,
    }

    /// Folds launches of more than `cubes` cubes in two dimensions, in the whole process. Results do not depend on it:
    /// it is there to test what otherwise only a launch of more than 65 535 cubes would.
    #[doc(hidden)]
    pub fn fold_launches(cubes: u32) {
        crate::cube::gpu::limit_cubes(cubes);
    }

    /// Shares work out among units as on hardware, and adds floats as where that is no atomic operation, on drivers
    /// that compute on the CPU as well, in the whole process. Results do not depend on it but for the order of sums: it
    /// is there to test on such a driver what runs on hardware.
    #[doc(hidden)]
    pub fn imitate_hardware(on: bool) {
        crate::cube::gpu::imitate_hardware(on);
    }

    /// The GPUs of every backend in this build, CUDA's first. The first call opens each of them.
    pub fn gpus() -> &'static [Gpu] {
        static GPUS: OnceLock<Vec<Gpu>> = OnceLock::new();
        GPUS.get_or_init(|| {
            let mut gpus = Vec::new();
            #[cfg(feature = "cuda")]
            gpus.extend(found("cuda", DeviceType::Cuda));
            #[cfg(feature = "wgpu")]
            gpus.extend(found("wgpu", DeviceType::Wgpu));
            gpus
        })
    }

    /// Bytes of the largest buffer of a device; `None` for a CPU, which has no such limit.
    pub(crate) fn buffer_limit(device: &Device) -> Option<u64> {
        match device.clone().inner().as_dispatch() {
            DispatchDevice::Cube(cube) => Some(cube.client().properties().memory.max_page_size),
            _ => None,
        }
    }

    fn found(backend: &'static str, kind: DeviceType) -> Vec<Gpu> {
        let devices = Device::enumerate(kind);
        devices.into_iter().enumerate().filter_map(|(index, device)| Gpu::open(backend, index, device)).collect()
    }

    /// Whether a device is a driver that computes on the CPU.
    fn is_software(device: &CubeDevice) -> bool {
        match device {
            #[cfg(feature = "wgpu")]
            CubeDevice::Wgpu(wgpu) => wgpu.kind == WgpuDeviceKind::Cpu,
            #[allow(unreachable_patterns, reason = "with wgpu alone there is no other")]
            _ => false,
        }
    }

    impl Gpu {
        fn open(backend: &'static str, index: usize, device: Device) -> Option<Self> {
            let name = device.identity()?.name;
            let DispatchDevice::Cube(cube) = device.as_dispatch() else { return None };
            let is_software = is_software(cube);
            let client = cube.client();
            let properties = client.properties();
            let limits = Limits {
                buffer: properties.memory.max_page_size,
                shared_memory: properties.hardware.max_shared_memory_size,
                units: properties.hardware.max_units_per_cube,
                adds_floats: adds_floats(&client),
            };
            Some(Self { backend, index, name, is_software, limits, device })
        }
    }
}
