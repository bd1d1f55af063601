//! The devices of this build: a constructor for each CPU backend, and a list of the GPUs found.

use burn::tensor::{DType, Device};

#[cfg(feature = "cube")]
pub use found::{
    Gpu, GpuError, GpuProperties, fold_launches, gpus, imitate_dirt, imitate_hardware, is_gpu, sort_apart,
};

/// Burn's pure-Rust CPU backend.
#[cfg(feature = "flex")]
pub fn flex() -> Device {
    Device::flex()
}

/// Burn's CPU backend based on the `ndarray` crate.
#[cfg(feature = "ndarray")]
pub fn ndarray() -> Device {
    crate::host::ndarray::device()
}

/// Whether the ops of a device support a dtype: single precision, and double precision on a CPU.
pub(crate) fn takes(device: &Device, dtype: DType) -> bool {
    match dtype {
        DType::F32 => true,
        DType::F64 => !is_gpu(device),
        _ => false,
    }
}

/// Whether a device is a GPU or a software driver. Does not open it.
#[cfg(not(feature = "cube"))]
pub fn is_gpu(_: &Device) -> bool {
    false
}

/// Bytes of the largest buffer of a device; `None` for a CPU, which has no such limit.
#[cfg(not(feature = "cube"))]
pub(crate) fn buffer_limit(_: &Device) -> Option<u64> {
    None
}

/// Whether a device can blend this many channels, forward and backward.
#[cfg(not(feature = "cube"))]
pub(crate) fn blends(_: &Device, _: usize) -> bool {
    true
}

/// Pixels of the widest window over which a device compares pictures, along an axis; `None` for a CPU, which has no
/// such limit.
#[cfg(not(feature = "cube"))]
pub(crate) fn window_limit(_: &Device) -> Option<usize> {
    None
}

#[cfg(feature = "cube")]
pub(crate) use found::{blends, buffer_limit, window_limit};

#[cfg(feature = "cube")]
mod found {
    use std::panic::{AssertUnwindSafe, catch_unwind};
    use std::sync::OnceLock;

    use burn::backend::DispatchDevice;
    use burn::tensor::{Device, DeviceType};
    use burn_cubecl::CubeDevice;
    #[cfg(feature = "wgpu")]
    use cubecl::wgpu::{WgpuDeviceKind, wgpu};
    use mvfusion_kernels::cube::MOST_BUFFERS;
    use thiserror::Error;

    use crate::cube::gpu::{self, adds_floats, is_software};
    use crate::cube::shared_memory::fits_shared_memory;
    use crate::cube::window::MOST_PIXELS;

    /// The language of Vulkan.
    const SPIR_V: &str = "SPIR-V";

    /// A GPU found by a backend of this build.
    #[derive(Clone, Debug)]
    pub struct Gpu {
        /// `cuda` or `wgpu`.
        pub backend: &'static str,
        /// Index among the GPUs of the backend.
        pub index: usize,
        /// Whether it is a software driver, which computes on the CPU.
        pub is_software: bool,
        /// Burn's handle, which is opened on first use.
        pub device: Device,
        cube: CubeDevice,
    }

    /// The properties that an opened GPU reports.
    #[derive(Clone, Debug, PartialEq, Eq)]
    pub struct GpuProperties {
        /// Its name.
        pub name: String,
        /// Bytes of the largest buffer.
        pub buffer: u64,
        /// Bytes of shared memory per cube.
        pub shared_memory: usize,
        /// Largest number of units per cube.
        pub units: u32,
        /// Whether it has an atomic addition of floats. Otherwise, atomic exchanges replace it.
        pub adds_floats: bool,
        /// The language that CubeCL compiles the kernels to: `WGSL`, `SPIR-V`, `MSL`, `CUDA C++`, or `PTX` through LLVM.
        pub language: &'static str,
    }

    /// A GPU that was found but cannot be used.
    #[derive(Debug, Clone, PartialEq, Eq, Error)]
    pub enum GpuError {
        /// The driver cannot open the GPU.
        #[error("{0} was found, but its driver does not open it")]
        Closed(String),
        /// The GPU binds fewer buffers than the kernels need.
        #[error("{label} binds {found} storage buffers to a kernel, and {needed} are needed", needed = MOST_BUFFERS)]
        Buffers {
            /// Name on the command line.
            label: String,
            /// Number of buffers that it binds.
            found: u32,
        },
        /// Its compiler may crash on CubeCL's SPIR-V: CubeCL 0.11 gets the types of shared memory wrong where its layout
        /// is not explicit.
        #[error(
            "the driver of {0} lacks VK_KHR_workgroup_memory_explicit_layout, so it cannot compile the SPIR-V that the \
             feature `vulkan` makes of the kernels; build with `wgpu` and without `vulkan`"
        )]
        SpirV(String),
    }

    /// While `body` runs, folds this thread's launches of more than `cubes` cubes into two dimensions. Results do not
    /// depend on it. It tests a path that otherwise needs a launch of more than 65 535 cubes.
    #[doc(hidden)]
    pub fn fold_launches<T>(cubes: u32, body: impl FnOnce() -> T) -> T {
        gpu::limit_cubes(cubes, body)
    }

    /// While `body` runs, makes this thread treat software drivers like hardware without an atomic addition of floats.
    /// Results differ only in the order of sums. It tests the hardware path on a software driver.
    #[doc(hidden)]
    pub fn imitate_hardware<T>(body: impl FnOnce() -> T) -> T {
        gpu::imitate_hardware(body)
    }

    /// While `body` runs, fills this thread's new buffers with NaN, or -1 as integers. wgpu clears buffers, which other
    /// runtimes do not. Results do not depend on it.
    #[doc(hidden)]
    pub fn imitate_dirt<T>(body: impl FnOnce() -> T) -> T {
        gpu::imitate_dirt(body)
    }

    /// While `body` runs, sorts the frames that this thread renders together one by one if they have more than `most`
    /// Gaussians, or pairs of one and a tile. Results do not depend on it. It tests a path that otherwise needs millions.
    #[doc(hidden)]
    pub fn sort_apart<T>(most: usize, body: impl FnOnce() -> T) -> T {
        gpu::sort_apart(most, body)
    }

    /// The GPUs of all backends in this build. CUDA comes first, then wgpu with discrete before integrated GPUs and
    /// software last. No GPU is opened, because that takes time and GPU memory.
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

    /// Whether a device can blend this many channels, forward and backward.
    pub(crate) fn blends(device: &Device, channels: usize) -> bool {
        as_cube(&device.clone().inner()).is_none_or(|cube| fits_shared_memory(&cube, channels))
    }

    /// Pixels of the widest window over which a device compares pictures, along an axis; `None` for a CPU, which has no
    /// such limit. Does not open it.
    pub(crate) fn window_limit(device: &Device) -> Option<usize> {
        is_gpu(device).then_some(MOST_PIXELS)
    }

    /// Whether a device is a GPU or a software driver. Does not open it.
    pub fn is_gpu(device: &Device) -> bool {
        as_cube(&device.clone().inner()).is_some()
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

    /// The rank of a device's kind; faster kinds come first.
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

    /// The first answer of an adapter with a name. CubeCL keeps the name alone.
    #[cfg(feature = "wgpu")]
    fn of_adapter<T>(name: &str, ask: impl Fn(&wgpu::Adapter) -> Option<T>) -> Option<T> {
        let answer = || {
            let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
                backends: wgpu::Backends::PRIMARY,
                ..wgpu::InstanceDescriptor::new_without_display_handle()
            });
            let adapters = cubecl::future::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
            adapters.iter().filter(|adapter| adapter.get_info().name == name).find_map(ask)
        };
        // wgpu panics if a driver fails.
        catch_unwind(AssertUnwindSafe(answer)).ok()?
    }

    /// Whether the driver of the adapter with a name compiles the SPIR-V of CubeCL. A driver that does not answer is
    /// tried.
    #[cfg(feature = "vulkan")]
    fn compiles_spirv(name: &str) -> bool {
        let lays_out_shared_memory = |adapter: &wgpu::Adapter| {
            // SAFETY: what belongs to the driver is only read, and dropped before the adapter.
            let adapter = unsafe { adapter.as_hal::<wgpu::hal::api::Vulkan>() }?;
            let found = adapter.physical_device_capabilities();
            Some(found.supports_extension(c"VK_KHR_workgroup_memory_explicit_layout"))
        };
        of_adapter(name, lays_out_shared_memory).unwrap_or(true)
    }

    /// Without SPIR-V, there is nothing to compile.
    #[cfg(not(feature = "vulkan"))]
    fn compiles_spirv(_: &str) -> bool {
        true
    }

    /// The driver of the adapter with a name.
    #[cfg(feature = "wgpu")]
    fn driver_of_adapter(name: &str) -> Option<String> {
        let info = of_adapter(name, |adapter| Some(adapter.get_info()))?;
        let words = [info.driver, info.driver_info].into_iter().filter(|word| !word.is_empty()).collect::<Vec<_>>();
        (!words.is_empty()).then(|| words.join(" "))
    }

    /// The driver in what NVIDIA's kernel module says about itself.
    #[allow(dead_code, reason = "only CUDA asks")]
    fn driver_of_nvidia(text: &str) -> Option<String> {
        let is_version = |word: &&str| word.starts_with(|c: char| c.is_ascii_digit()) && word.contains('.');
        Some(format!("NVIDIA {}", text.lines().next()?.split_whitespace().find(is_version)?))
    }

    impl Gpu {
        /// Name on the command line: backend and index.
        pub fn label(&self) -> String {
            format!("{}:{}", self.backend, self.index)
        }

        /// Its driver with the version, as far as the system tells.
        pub fn driver(&self) -> Option<String> {
            match &self.cube {
                #[cfg(feature = "wgpu")]
                CubeDevice::Wgpu(_) => driver_of_adapter(&self.properties().ok()?.name),
                #[allow(unreachable_patterns, reason = "with wgpu alone there is no other")]
                _ => driver_of_nvidia(&std::fs::read_to_string("/proc/driver/nvidia/version").ok()?),
            }
        }

        /// Opens the GPU and reads its properties.
        ///
        /// # Errors
        /// If the driver fails, or the GPU cannot run the kernels.
        pub fn properties(&self) -> Result<GpuProperties, GpuError> {
            // CubeCL panics if a driver fails.
            let opened = catch_unwind(AssertUnwindSafe(|| self.cube.client()));
            let client = opened.map_err(|_| GpuError::Closed(self.label()))?;
            let properties = client.properties();
            // Without the one in which CubeCL passes numbers.
            let bindings = properties.hardware.max_bindings;
            if bindings < MOST_BUFFERS {
                return Err(GpuError::Buffers { label: self.label(), found: bindings });
            }
            let language = language(client.name());
            if language == SPIR_V && !compiles_spirv(&properties.identity.name) {
                return Err(GpuError::SpirV(self.label()));
            }
            Ok(GpuProperties {
                name: properties.identity.name.clone(),
                buffer: gpu::buffer_limit(&client),
                shared_memory: properties.hardware.max_shared_memory_size,
                units: properties.hardware.max_units_per_cube,
                adds_floats: adds_floats(&client),
                language,
            })
        }
    }

    /// The language of the kernels on a runtime of CubeCL, by the runtime's name.
    fn language(runtime: &str) -> &'static str {
        match runtime {
            "wgpu<wgsl>" => "WGSL",
            "wgpu<spirv>" => SPIR_V,
            "wgpu<msl>" => "MSL",
            _ if cfg!(feature = "cuda-cpp") => "CUDA C++",
            _ => "PTX",
        }
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn the_driver_of_nvidia_is_the_version_in_the_first_line() {
            for line in [
                "NVRM version: NVIDIA UNIX x86_64 Kernel Module  535.183.01  Sun May 12 19:39:15 UTC 2024",
                "NVRM version: NVIDIA UNIX Open Kernel Module for x86_64  535.183.01  Release Build",
            ] {
                assert_eq!(driver_of_nvidia(line).as_deref(), Some("NVIDIA 535.183.01"));
            }
            assert_eq!(driver_of_nvidia(""), None);
        }
    }
}
