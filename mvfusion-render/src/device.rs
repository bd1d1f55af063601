//! The devices that were compiled in: one constructor for each CPU backend, and a list of the GPUs that were found.

use burn::tensor::{DType, Device};

#[cfg(feature = "cube")]
pub use found::{Card, Gpu, GpuError, fold_launches, gpus, imitate_hardware};

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
        DType::F64 => !is_gpu(device),
        _ => false,
    }
}

/// Whether a device is a GPU, or a driver that imitates one.
pub fn is_gpu(device: &Device) -> bool {
    buffer_limit(device).is_some()
}

/// Bytes of the largest buffer of a device; `None` for a CPU, which has no such limit.
#[cfg(not(feature = "cube"))]
pub(crate) fn buffer_limit(_: &Device) -> Option<u64> {
    None
}

/// Whether a device can blend so many channels, there and back.
#[cfg(not(feature = "cube"))]
pub(crate) fn blends(_: &Device, _: usize) -> bool {
    true
}

#[cfg(feature = "cube")]
pub(crate) use found::{blends, buffer_limit};

#[cfg(feature = "cube")]
mod found {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::OnceLock;

    use burn::backend::DispatchDevice;
    use burn::tensor::{Device, DeviceType};
    use burn_cubecl::CubeDevice;
    #[cfg(feature = "wgpu")]
    use cubecl::wgpu::WgpuDeviceKind;
    use mvfusion_kernels::cube::MOST_BUFFERS;
    use thiserror::Error;

    use crate::cube::gpu::{self, adds_floats, is_software};
    use crate::cube::shared_memory::fits_shared_memory;

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

    /// A GPU that was found but cannot be used.
    #[derive(Debug, Clone, PartialEq, Eq, Error)]
    pub enum GpuError {
        /// Its driver does not open it.
        #[error("{0} was found, but its driver does not open it")]
        Closed(String),
        /// It binds fewer buffers than the kernels need.
        #[error("{label} binds {found} storage buffers to a kernel, and {needed} are needed", needed = MOST_BUFFERS)]
        Buffers {
            /// Its name on the command line.
            label: String,
            /// How many it binds.
            found: u32,
        },
    }

    /// Folds the launches of this thread that are of more than `cubes` cubes in two dimensions, while `body` runs. Results
    /// do not depend on it: it is there to test what otherwise only a launch of more than 65 535 cubes would.
    #[doc(hidden)]
    pub fn fold_launches<T>(cubes: u32, body: impl FnOnce() -> T) -> T {
        gpu::limit_cubes(cubes, body)
    }

    /// Shares the work of this thread out among units as on hardware, and adds floats as where that is no atomic operation,
    /// on drivers that compute on the CPU as well, while `body` runs. Results do not depend on it but for the order of
    /// sums: it is there to test on such a driver what runs on hardware.
    #[doc(hidden)]
    pub fn imitate_hardware<T>(body: impl FnOnce() -> T) -> T {
        gpu::imitate_hardware(body)
    }

    /// The GPUs of every backend in this build: CUDA's first, and among wgpu's the discrete ones before the integrated ones,
    /// software last. None is opened by it: that takes time, and memory of the GPU.
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

    /// Whether a device can blend so many channels, there and back.
    pub(crate) fn blends(device: &Device, channels: usize) -> bool {
        as_cube(&device.clone().inner()).is_none_or(|cube| fits_shared_memory(&cube, channels))
    }

    fn found(backend: &'static str, kind: DeviceType) -> Vec<Gpu> {
        let mut devices: Vec<(Device, CubeDevice)> = Device::enumerate(kind)
            .into_iter()
            .filter_map(|device| as_cube(&device).map(|cube| (device, cube)))
            .collect();
        devices.sort_by_key(|(_, cube)| rank(cube));
        let gpu = |(index, (device, cube)): (usize, (Device, CubeDevice))| Gpu {
            backend,
            index,
            is_software: is_software(&cube),
            device,
            cube,
        };
        devices.into_iter().enumerate().map(gpu).collect()
    }

    /// The place of a device's kind among the others: those that are faster first.
    fn rank(device: &CubeDevice) -> usize {
        match device {
            #[cfg(feature = "wgpu")]
            CubeDevice::Wgpu(wgpu) => match wgpu.kind {
                WgpuDeviceKind::DiscreteGpu(_) => 0,
                WgpuDeviceKind::IntegratedGpu(_) => 1,
                WgpuDeviceKind::VirtualGpu(_) => 2,
                WgpuDeviceKind::Cpu => 4,
                _ => 3,
            },
            #[allow(unreachable_patterns, reason = "with wgpu alone there is no other")]
            _ => 0,
        }
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
        ///
        /// # Errors
        /// If its driver fails, or it cannot run the kernels.
        pub fn card(&self) -> Result<Card, GpuError> {
            // CubeCL panics where a driver fails.
            let opened = catch_unwind(AssertUnwindSafe(|| self.cube.client()));
            let client = opened.map_err(|_| GpuError::Closed(self.label()))?;
            let properties = client.properties();
            // CubeCL keeps one of wgpu's for numbers that are no buffers, which ours get as a uniform.
            let bindings = properties.hardware.max_bindings.saturating_add(1);
            if bindings < MOST_BUFFERS {
                return Err(GpuError::Buffers { label: self.label(), found: bindings });
            }
            Ok(Card {
                name: properties.identity.name.clone(),
                buffer: gpu::buffer_limit(&client),
                shared_memory: properties.hardware.max_shared_memory_size,
                units: properties.hardware.max_units_per_cube,
                adds_floats: adds_floats(&client),
            })
        }
    }
}
