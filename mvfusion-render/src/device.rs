//! The devices that were compiled in: one constructor for each CPU backend, and a list of the GPUs that were found.

use burn::tensor::{DType, Device};

#[cfg(feature = "cube")]
pub use gpu::{Card, Gpu, fold_launches, gpus, imitate_hardware};

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

/// Whether the ops of a device take numbers of a type: single precision, and double precision on a CPU.
pub(crate) fn takes(device: &Device, dtype: DType) -> bool {
    match dtype {
        DType::F32 => true,
        DType::F64 => buffer_limit(device).is_none(),
        _ => false,
    }
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

    use crate::cube::gpu::{self, adds_floats, is_software};

    /// A GPU that a backend of this build has found.
    #[derive(Clone, Debug)]
    pub struct Gpu {
        /// `cuda` or `wgpu`.
        pub backend: &'static str,
        /// Its number among those of the backend.
        pub index: usize,
        /// Whether it is a driver that computes on the CPU.
        pub is_software: bool,
        /// For Burn, which opens it when it is first used.
        pub device: Device,
        cube: CubeDevice,
    }

    /// What an opened GPU says of itself.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct Card {
        /// Its name.
        pub name: String,
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

    /// The GPUs of every backend in this build, CUDA's first. None is opened by it: that takes time, and memory of the
    /// GPU.
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
        Some(gpu::buffer_limit(&as_cube(&device.clone().inner())?.client()))
    }

    fn found(backend: &'static str, kind: DeviceType) -> Vec<Gpu> {
        let devices = Device::enumerate(kind).into_iter().enumerate();
        devices
            .filter_map(|(index, device)| {
                let cube = as_cube(&device)?;
                Some(Gpu { backend, index, is_software: is_software(&cube), device, cube })
            })
            .collect()
    }

    fn as_cube(device: &Device) -> Option<CubeDevice> {
        match device.as_dispatch() {
            DispatchDevice::Cube(cube) => Some(cube.clone()),
            _ => None,
        }
    }

    impl Gpu {
        /// Its name on the command line: backend and number.
        pub fn label(&self) -> String {
            format!("{}:{}", self.backend, self.index)
        }

        /// Opens the GPU and asks it what it is.
        pub fn card(&self) -> Card {
            let client = self.cube.client();
            let properties = client.properties();
            Card {
                name: properties.identity.name.clone(),
                buffer: gpu::buffer_limit(&client),
                shared_memory: properties.hardware.max_shared_memory_size,
                units: properties.hardware.max_units_per_cube,
                adds_floats: adds_floats(&client),
            }
        }
    }
}
