//! A device for launches: its buffers, its limits, and the folding of launches into two dimensions.

use std::cell::Cell;
use std::ops::Range;
use std::thread::LocalKey;

use burn::backend::ops::{FloatTensorOps, IntTensorOps};
use burn::tensor::{DType, FloatDType, IntDType, Shape, Slice};
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
use mvfusion_kernels::cube::grid::GPU_LANES;
use mvfusion_kernels::cube::product_kind::ProductPlan;
use mvfusion_kernels::cube::sort::STAGED_BYTES;
use mvfusion_kernels::cube::stage::{GPU_MEMORY, GPU_SPAN};
use mvfusion_kernels::cube::sums::{SumPlan, sum_rows};
use mvfusion_kernels::splat::TILE;

/// Largest number of cubes along one axis of a launch: the limit that WebGPU guarantees.
pub(crate) const MAX_CUBES: u32 = 65_535;

thread_local! {
    /// The limit for launches of this thread; tests lower it.
    static LIMIT: Cell<u32> = const { Cell::new(MAX_CUBES) };

    /// Most keys of several frames that this thread sorts together; tests lower it.
    static TOGETHER: Cell<usize> = const { Cell::new(MOST_TOGETHER) };

    /// Whether this thread treats every device as hardware without an atomic addition of floats; for tests.
    static IMITATES: Cell<bool> = const { Cell::new(false) };

    /// Whether this thread fills new buffers with NaN; for tests.
    static DIRTY: Cell<bool> = const { Cell::new(false) };
}

/// Most keys of several frames that are sorted together: their buffers then take a third of a GB.
const MOST_TOGETHER: usize = 1 << 24;

/// Largest buffer of the sums of a look-up's units, in bytes.
const MOST_LANE_SUMS: usize = 128 << 20;

/// The cube size of all kernels except those for blending and products.
pub(super) const CUBE: CubeDim = CubeDim::new_1d(UNITS as u32);

/// How the pixels of a tile are divided among the units of a cube.
#[derive(Clone, Copy, Debug)]
pub(super) struct TilePlan {
    /// Neighbouring pixels per unit. On a CPU it is a whole row, because reading a Gaussian costs as much as computing
    /// a pixel.
    pub span: usize,
    /// Preferred and largest number of bytes of shared memory.
    pub memory: [usize; 2],
}

/// A device for launches.
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

    /// Allocates an uninitialised tensor.
    ///
    /// # Panics
    /// If the device cannot bind a buffer of that size.
    pub fn room(&self, shape: impl Into<Shape>, dtype: DType) -> CubeTensor {
        let shape = shape.into();
        // No device binds an empty buffer.
        let bytes = (shape.num_elements() * dtype.size()).max(4);
        let limit = self.buffer_limit();
        assert!(
            bytes as u64 <= limit,
            "a buffer of {shape:?} needs {bytes} bytes, but this device binds {limit} at most: use fewer Gaussians or \
             smaller images, or the CPU (`--device cpu`)"
        );
        let handle =
            if DIRTY.get() { self.client.create_from_slice(&vec![0xFF; bytes]) } else { self.client.empty(bytes) };
        CubeTensor::new_contiguous(self.client.clone(), self.device.clone(), shape, handle, dtype)
    }

    /// Allocates floats.
    pub fn floats(&self, shape: impl Into<Shape>) -> CubeTensor {
        self.room(shape, DType::F32)
    }

    /// Allocates signed integers, which may leave the op.
    pub fn integers(&self, shape: impl Into<Shape>) -> CubeTensor {
        self.room(shape, DType::I32)
    }

    /// Allocates `count` unsigned integers for use within the op.
    pub fn naturals(&self, count: usize) -> CubeTensor {
        self.room([count], DType::U32)
    }

    /// Uploads integers.
    pub fn upload(&self, numbers: &[u32]) -> CubeTensor {
        self.upload_words(numbers.iter().map(|number| number.to_le_bytes()), DType::U32)
    }

    /// Uploads floats.
    pub fn upload_floats(&self, numbers: &[f32]) -> CubeTensor {
        self.upload_words(numbers.iter().map(|number| number.to_le_bytes()), DType::F32)
    }

    fn upload_words(&self, words: impl ExactSizeIterator<Item = [u8; 4]>, dtype: DType) -> CubeTensor {
        let shape = Shape::from([words.len()]);
        let handle = self.client.create_from_slice(&words.flatten().collect::<Vec<u8>>());
        CubeTensor::new_contiguous(self.client.clone(), self.device.clone(), shape, handle, dtype)
    }

    /// Integer zeros.
    pub fn zeros(&self, shape: impl Into<Shape>) -> CubeTensor {
        let shape = shape.into();
        let flat = Shape::from([shape.num_elements()]);
        self.shaped(CubeBackend::int_zeros(flat, &self.device, IntDType::I32), shape)
    }

    /// Float zeros.
    pub fn zero_floats(&self, shape: impl Into<Shape>) -> CubeTensor {
        let shape = shape.into();
        let flat = Shape::from([shape.num_elements()]);
        self.shaped(CubeBackend::float_zeros(flat, &self.device, FloatDType::F32), shape)
    }

    /// Neighbouring numbers of a tensor of rank 1, in another shape. They are not copied if they begin where the device
    /// may bind a buffer.
    pub fn part(&self, joined: &CubeTensor, range: Range<usize>, shape: Shape) -> CubeTensor {
        let bytes = |numbers: usize| (numbers * joined.dtype.size()) as u64;
        if !range.start.is_multiple_of(self.alignment(joined.dtype)) {
            let slice = Slice::new(range.start as isize, Some(range.end as isize), 1);
            return self.shaped(CubeBackend::float_slice(joined.clone(), &[slice]), shape);
        }
        let after = joined.meta.num_elements() - range.end;
        let handle = joined.handle.clone().offset_start(bytes(range.start)).offset_end(bytes(after));
        CubeTensor::new_contiguous(self.client.clone(), self.device.clone(), shape, handle, joined.dtype)
    }

    /// Numbers between two places where a buffer may be bound.
    pub fn alignment(&self, dtype: DType) -> usize {
        (self.client.properties().memory.alignment as usize).div_ceil(dtype.size()).max(1)
    }

    /// A tensor of rank 1 in another shape. A runtime may pad the rows of tensors of higher rank, as CUDA's does; that
    /// of rank 1 is always dense.
    fn shaped(&self, flat: CubeTensor, shape: Shape) -> CubeTensor {
        CubeTensor::new_contiguous(self.client.clone(), self.device.clone(), shape, flat.handle, flat.dtype)
    }

    /// The sum of the rows of `[rows, columns]`: `[columns]`.
    // Burn adds the rows of a column one after another in one unit: 8 ms for 300,000.
    pub fn sum_rows(&self, tensor: CubeTensor) -> CubeTensor {
        let [rows, columns] = tensor.meta.shape().dims();
        let plan = SumPlan::new(rows, columns);
        let sums = self.floats([plan.slabs, columns]);
        // SAFETY: values are read below `rows` and `columns`, and there is a row of sums for each slab.
        unsafe {
            sum_rows::launch_unchecked(
                &self.client,
                self.cubes(plan.cubes),
                CUBE,
                single(tensor).flat(),
                sums.clone().flat(),
                rows as u32,
                columns as u32,
                plan.slab as u32,
                plan.cubes as u32,
                plan.across,
            );
        }
        if plan.slabs > 1 {
            return self.sum_rows(sums);
        }
        self.shaped(sums, Shape::from([columns]))
    }

    /// How the pixels of a tile are divided among units.
    pub fn tile_plan(&self) -> TilePlan {
        TilePlan::of(&self.device)
    }

    /// Bytes of shared memory that a cube can have.
    pub fn shared_memory(&self) -> usize {
        self.client.properties().hardware.max_shared_memory_size
    }

    /// How a matrix product with this many rows and columns is divided among units.
    pub fn product_plan(&self, size: [usize; 2]) -> ProductPlan {
        if computes_on_cpu(&self.device) { ProductPlan::SOFTWARE } else { ProductPlan::of_gpu(size) }
    }

    /// Units that share the features of a point in the adjoint of a look-up of `rows` points and scales: one on a CPU,
    /// where they take turns, and fewer than [`GPU_LANES`] if the buffer of their sums would be too large.
    pub fn lanes(&self, features: usize, rows: usize) -> usize {
        if computes_on_cpu(&self.device) {
            return 1;
        }
        let most = MOST_LANE_SUMS / (rows * size_of::<[f32; 4]>()).max(1);
        features.min(most).clamp(1, GPU_LANES)
    }

    /// Whether a block of keys is sorted in shared memory before it is written: not on a CPU, which has caches.
    pub fn stages_keys(&self) -> bool {
        !computes_on_cpu(&self.device) && self.shared_memory() >= STAGED_BYTES
    }

    /// Whether the records of a Gaussian are summed in pieces first: not on a CPU, where no unit waits for another.
    pub fn sums_pieces(&self) -> bool {
        !computes_on_cpu(&self.device)
    }

    /// A launch of `cubes` cubes, folded into two dimensions if necessary; there may be a few excess cubes.
    pub fn cubes(&self, cubes: usize) -> CubeCount {
        let [x, y] = fold(cubes, LIMIT.get());
        CubeCount::Static(x, y, 1)
    }

    /// A launch with at least `units` units.
    pub fn units(&self, units: usize) -> CubeCount {
        self.cubes(units.div_ceil(UNITS))
    }
}

/// A tensor as an argument of a kernel that indexes it flat.
pub(super) trait Flat {
    /// The buffer.
    ///
    /// # Panics
    /// If the rows are not dense. Kernels would read the gaps, unchecked.
    fn flat(self) -> BufferArg;
}

impl Flat for CubeTensor {
    fn flat(self) -> BufferArg {
        let meta = &self.meta;
        assert!(
            self.is_contiguous(),
            "a kernel that indexes flat was given a tensor of shape {:?} with strides {:?}",
            meta.shape(),
            meta.strides()
        );
        self.into_buffer_arg()
    }
}

/// A tensor in the format of the kernels: single precision, row-major, dense.
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

/// Bytes of the largest buffer that kernels can use on a device. Kernels index values with 32 bits.
pub(crate) fn buffer_limit(client: &Client) -> u64 {
    client.properties().memory.max_page_size.min(4 * u64::from(u32::MAX))
}

/// Whether work is divided as for a software driver.
fn computes_on_cpu(device: &CubeDevice) -> bool {
    !IMITATES.get() && is_software(device)
}

/// Whether a device was explicitly chosen as a software driver. wgpu does not report what its default device is.
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

/// Factors `cubes` into `[x, y]`, both as small as the limit on `x` allows.
fn fold(cubes: usize, limit: u32) -> [u32; 2] {
    let rows = cubes.div_ceil(limit as usize).max(1);
    [cubes.div_ceil(rows).max(1) as u32, rows as u32]
}

/// See [`crate::device::fold_launches`].
pub(crate) fn limit_cubes<T>(limit: u32, body: impl FnOnce() -> T) -> T {
    with(&LIMIT, limit.clamp(1, MAX_CUBES), body)
}

/// Most keys of several frames that are sorted together.
pub(super) fn most_sorted_together() -> usize {
    TOGETHER.get()
}

/// See [`crate::device::sort_apart`].
pub(crate) fn sort_apart<T>(most: usize, body: impl FnOnce() -> T) -> T {
    with(&TOGETHER, most, body)
}

/// See [`crate::device::imitate_hardware`].
pub(crate) fn imitate_hardware<T>(body: impl FnOnce() -> T) -> T {
    with(&IMITATES, true, body)
}

/// See [`crate::device::imitate_dirt`].
pub(crate) fn imitate_dirt<T>(body: impl FnOnce() -> T) -> T {
    with(&DIRTY, true, body)
}

/// Runs `body` while a switch of this thread has a value; the switch is reset even after a panic.
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
