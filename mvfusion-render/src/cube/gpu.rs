//! A device to launch on: its buffers, its limits, and how launches are folded into them.

use std::cell::Cell;
use std::thread::LocalKey;

use burn::backend::ops::{FloatTensorOps, IntTensorOps};
use burn::tensor::{DType, FloatDType, IntDType, Shape};
use burn_cubecl::CubeBackend;
use burn_cubecl::CubeDevice;
use burn_cubecl::kernel::into_contiguous;
use burn_cubecl::tensor::CubeTensor;
use cubecl::client::Client;
use cubecl::ir::features::AtomicUsage;
use cubecl::prelude::*;
#[cfg(feature = "wgpu")]
use cubecl::wgpu::WgpuDeviceKind;
use mvfusion_kernels::cube::UNITS;
use mvfusion_kernels::cube::product::ProductPlan;
use mvfusion_kernels::splat::TILE;

/// The most cubes along one axis of a launch: what WebGPU promises everywhere.
pub(crate) const MAX_CUBES: u32 = 65_535;

thread_local! {
    /// The limit in force for launches of this thread, which tests lower.
    static LIMIT: Cell<u32> = const { Cell::new(MAX_CUBES) };

    /// Whether this thread treats every device as hardware without an atomic addition of floats, for tests.
    static IMITATES: Cell<bool> = const { Cell::new(false) };
}

/// The size of every cube but those that blend and those that multiply.
pub(super) const CUBE: CubeDim = CubeDim::new_1d(UNITS as u32);

/// Pixels of a row that a unit of a GPU blends: what it reads of a Gaussian serves them all, and enough units are left.
const GPU_SPAN: usize = 4;

/// Bytes that the units of a cube share on a GPU, which holds several cubes at once if they take no more.
const GPU_MEMORY: usize = 16 << 10;

/// How the pixels of a tile are shared out among the units of a cube.
#[derive(Clone, Copy, Debug)]
pub(super) struct TilePlan {
    /// Neighbouring pixels of a unit. On a CPU a whole row: there each unit's reading costs as much as what it computes
    /// for a pixel.
    pub span: usize,
    /// Bytes that the units had better share at most, and those that they can.
    pub memory: [usize; 2],
}

/// A device, as launches need it.
#[derive(Clone)]
pub(super) struct Gpu {
    pub client: Client,
    device: CubeDevice,
}

impl Gpu {
    /// The device of a tensor.
    pub fn of(tensor: &CubeTensor) -> Self {
        Self { client: tensor.client.clone(), device: tensor.device.clone() }
    }

    /// See [`buffer_limit`].
    pub fn buffer_limit(&self) -> u64 {
        buffer_limit(&self.client)
    }

    /// Room for a tensor whose numbers are still to be written.
    ///
    /// # Panics
    /// If the device binds no buffer of that size.
    pub fn room(&self, shape: impl Into<Shape>, dtype: DType) -> CubeTensor {
        let shape = shape.into();
        // No device binds a buffer of nothing.
        let bytes = (shape.num_elements() * dtype.size()).max(4);
        let limit = self.buffer_limit();
        assert!(
            bytes as u64 <= limit,
            "a buffer of {shape:?} needs {bytes} bytes, but this device binds {limit} at most: use fewer Gaussians or \
             smaller pictures, or take `--device cpu`"
        );
        let handle = self.client.empty(bytes);
        CubeTensor::new_contiguous(self.client.clone(), self.device.clone(), shape, handle, dtype)
    }

    /// Room for floats.
    pub fn floats(&self, shape: impl Into<Shape>) -> CubeTensor {
        self.room(shape, DType::F32)
    }

    /// Room for whole numbers that leave the op.
    pub fn integers(&self, shape: impl Into<Shape>) -> CubeTensor {
        self.room(shape, DType::I32)
    }

    /// Room for `count` whole numbers within the op.
    pub fn naturals(&self, count: usize) -> CubeTensor {
        self.room([count], DType::U32)
    }

    /// Whole numbers of the host.
    pub fn upload(&self, numbers: &[u32]) -> CubeTensor {
        self.upload_words(numbers.iter().map(|number| number.to_le_bytes()), DType::U32)
    }

    /// Floats of the host.
    pub fn upload_floats(&self, numbers: &[f32]) -> CubeTensor {
        self.upload_words(numbers.iter().map(|number| number.to_le_bytes()), DType::F32)
    }

    fn upload_words(&self, words: impl ExactSizeIterator<Item = [u8; 4]>, dtype: DType) -> CubeTensor {
        let shape = Shape::from([words.len()]);
        let handle = self.client.create_from_slice(&words.flatten().collect::<Vec<u8>>());
        CubeTensor::new_contiguous(self.client.clone(), self.device.clone(), shape, handle, dtype)
    }

    /// Whole numbers that are all zero.
    pub fn zeros(&self, shape: impl Into<Shape>) -> CubeTensor {
        CubeBackend::int_zeros(shape.into(), &self.device, IntDType::I32)
    }

    /// Floats that are all zero.
    pub fn zero_floats(&self, shape: impl Into<Shape>) -> CubeTensor {
        CubeBackend::float_zeros(shape.into(), &self.device, FloatDType::F32)
    }

    /// The sum of the rows of `[rows, columns]`: `[columns]`.
    pub fn sum_rows(&self, tensor: CubeTensor) -> CubeTensor {
        let columns = tensor.meta.shape()[1];
        CubeBackend::float_reshape(CubeBackend::float_sum_dim(tensor, 0), Shape::from([columns]))
    }

    /// How the pixels of a tile are shared out among units.
    pub fn tile_plan(&self) -> TilePlan {
        TilePlan::of(&self.device)
    }

    /// How a product of matrices is shared out: on a CPU in larger blocks, for the same reason.
    pub fn product_plan(&self) -> ProductPlan {
        if computes_on_cpu(&self.device) {
            ProductPlan { units: 16, block: [16, 8] }
        } else {
            ProductPlan { units: 64, block: [8, 8] }
        }
    }

    /// Waits for a whole number of the device.
    ///
    /// # Panics
    /// If the device fails.
    pub fn read(&self, number: &CubeTensor) -> u32 {
        let bytes = self.client.read_one_unchecked(number.handle.clone());
        // Proof: the buffer holds one number of four bytes.
        u32::from_le_bytes(bytes[..4].try_into().expect("four bytes"))
    }

    /// A launch of `cubes` cubes, folded in two dimensions where one does not hold them; some cubes may be too many.
    pub fn cubes(&self, cubes: usize) -> CubeCount {
        let [x, y] = fold(cubes, LIMIT.get());
        CubeCount::Static(x, y, 1)
    }

    /// A launch with a unit for each of `units` things.
    pub fn units(&self, units: usize) -> CubeCount {
        self.cubes(units.div_ceil(UNITS))
    }
}

/// A tensor as kernels read it: single precision, row-major.
pub(super) fn single(tensor: CubeTensor) -> CubeTensor {
    assert_eq!(tensor.dtype, DType::F32, "GPUs work in single precision here");
    into_contiguous(tensor)
}

impl TilePlan {
    /// The plan for a device.
    pub fn of(device: &CubeDevice) -> Self {
        let memory = device.client().properties().hardware.max_shared_memory_size;
        if computes_on_cpu(device) {
            Self { span: TILE, memory: [memory; 2] }
        } else {
            Self { span: GPU_SPAN, memory: [memory.min(GPU_MEMORY), memory] }
        }
    }
}

/// Bytes of the largest buffer that kernels can use on a device: they count numbers with 32 bits.
pub(crate) fn buffer_limit(client: &Client) -> u64 {
    client.properties().memory.max_page_size.min(4 * u64::from(u32::MAX))
}

/// Whether work is shared out as for a driver that computes on the CPU.
fn computes_on_cpu(device: &CubeDevice) -> bool {
    !IMITATES.get() && is_software(device)
}

/// Whether a device is a driver that computes on the CPU, chosen as such: wgpu does not say what its default device is.
pub(crate) fn is_software(device: &CubeDevice) -> bool {
    match device {
        #[cfg(feature = "wgpu")]
        CubeDevice::Wgpu(wgpu) => wgpu.kind == WgpuDeviceKind::Cpu,
        #[allow(unreachable_patterns, reason = "with wgpu alone there is no other")]
        _ => false,
    }
}

/// Whether a device has an atomic addition of floats.
pub(crate) fn adds_floats(client: &Client) -> bool {
    let float = Type::atomic(f32::elem_type_native());
    !IMITATES.get() && client.properties().atomic_type_usage(float).contains(AtomicUsage::Add)
}

/// `cubes` as `x y`, each of the two as small as the limit on `x` allows.
fn fold(cubes: usize, limit: u32) -> [u32; 2] {
    let rows = cubes.div_ceil(limit as usize).max(1);
    [cubes.div_ceil(rows).max(1) as u32, rows as u32]
}

/// See [`crate::device::fold_launches`].
pub(crate) fn limit_cubes<T>(limit: u32, body: impl FnOnce() -> T) -> T {
    with(&LIMIT, limit.clamp(1, MAX_CUBES), body)
}

/// See [`crate::device::imitate_hardware`].
pub(crate) fn imitate_hardware<T>(body: impl FnOnce() -> T) -> T {
    with(&IMITATES, true, body)
}

/// Runs `body` while a switch of this thread has a value; even a panic sets it back.
fn with<S: Copy + 'static, T>(switch: &'static LocalKey<Cell<S>>, value: S, body: impl FnOnce() -> T) -> T {
    struct Reset<S: Copy + 'static>(&'static LocalKey<Cell<S>>, S);
    impl<S: Copy> Drop for Reset<S> {
        fn drop(&mut self) {
            self.0.set(self.1);
        }
    }
    let _reset = Reset(switch, switch.replace(value));
    body()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fold_holds_all_cubes_and_few_more() {
        for (cubes, limit, wanted) in [(0, 4, [1, 1]), (4, 4, [4, 1]), (5, 4, [3, 2]), (65_536, 65_535, [32_768, 2])] {
            assert_eq!(fold(cubes, limit), wanted);
        }
        for cubes in 1..200usize {
            let [x, y] = fold(cubes, 7);
            assert!(x <= 7 && (x * y) as usize >= cubes && ((x * y) as usize) < cubes + y as usize);
        }
    }
}
