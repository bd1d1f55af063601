//! Sums with offsets, one launch for each set of attributes. CPU twin: `offsets/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::offsets::{ATTRIBUTES, EachAttributeLaunch, add_offsets, join_cotangents};

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::list::Floats;
use crate::offsets::MOST_ATTRIBUTES;
use crate::offsets::op::{Division, OffsetAdjoint, OffsetOps};

const _: () = assert!(MOST_ATTRIBUTES == ATTRIBUTES);

impl OffsetOps for CubeBackend {
    fn add_offsets(offsets: FloatTensor<Self>, attributes: Floats<Self>, division: Division) -> Floats<Self> {
        let gpu = Gpu::of(&offsets);
        let offsets = single(offsets);
        let mut attributes = attributes.0.into_iter().map(single);
        let (mut sums, mut first) = (Vec::new(), 0);
        for &height in &division.heights {
            let own: Vec<CubeTensor> = attributes.by_ref().take(division.widths.len()).collect();
            let own_sums: Vec<CubeTensor> = own.iter().map(|attribute| gpu.floats(attribute.shape())).collect();
            let [a, b, c, d, e, f] = padded(&gpu, own);
            let [sum_a, sum_b, sum_c, sum_d, sum_e, sum_f] = padded(&gpu, own_sums.clone());
            // SAFETY: an offset is read in the rows from `first` on, of which there are `height`. Attributes are read and
            // sums written below that height and their width; what pads them has the width 0.
            unsafe {
                add_offsets::launch_unchecked(
                    &gpu.client,
                    gpu.units(height * division.columns()),
                    CUBE,
                    offsets.clone().flat(),
                    a.flat(),
                    b.flat(),
                    c.flat(),
                    d.flat(),
                    e.flat(),
                    f.flat(),
                    sum_a.flat(),
                    sum_b.flat(),
                    sum_c.flat(),
                    sum_d.flat(),
                    sum_e.flat(),
                    sum_f.flat(),
                    of_each(&division.blocks),
                    of_each(&division.widths),
                    first as u32,
                    height as u32,
                );
            }
            first += height;
            sums.extend(own_sums);
        }
        Floats(sums)
    }
}

impl OffsetAdjoint for CubeBackend {
    fn join_cotangents(v_sums: Vec<Option<FloatTensor<Self>>>, division: &Division) -> FloatTensor<Self> {
        // Proof: see the trait.
        let gpu = Gpu::of(v_sums.iter().flatten().next().expect("a cotangent"));
        let v_offsets = gpu.floats([division.rows(), division.columns()]);
        let mut v_sums = v_sums.into_iter();
        let mut first = 0;
        for &height in &division.heights {
            let own: Vec<Option<CubeTensor>> = v_sums.by_ref().take(division.widths.len()).collect();
            let widths = own.iter().zip(&division.widths).map(|(v, &width)| if v.is_some() { width } else { 0 });
            let widths: Vec<usize> = widths.collect();
            let own = own.into_iter().map(|v| v.map_or_else(|| nothing(&gpu), single)).collect();
            let [a, b, c, d, e, f] = padded(&gpu, own);
            // SAFETY: cotangents are read below `height` and their width, which is 0 where there are none. The rows of the
            // adjoint from `first` on are written, of which there are `height`.
            unsafe {
                join_cotangents::launch_unchecked(
                    &gpu.client,
                    gpu.units(height * division.columns()),
                    CUBE,
                    a.flat(),
                    b.flat(),
                    c.flat(),
                    d.flat(),
                    e.flat(),
                    f.flat(),
                    v_offsets.clone().flat(),
                    of_each(&division.blocks),
                    of_each(&widths),
                    first as u32,
                    height as u32,
                );
            }
            first += height;
        }
        v_offsets
    }
}

/// As many matrices as the kernels take.
fn padded(gpu: &Gpu, matrices: Vec<CubeTensor>) -> [CubeTensor; ATTRIBUTES] {
    let mut matrices = matrices.into_iter();
    // A buffer that is written must not be bound twice, so each has its own.
    std::array::from_fn(|_| matrices.next().unwrap_or_else(|| nothing(gpu)))
}

/// A matrix without columns.
fn nothing(gpu: &Gpu) -> CubeTensor {
    gpu.floats([0, 0])
}

/// A number for each attribute; 0 for those that are not there.
fn of_each(numbers: &[usize]) -> EachAttributeLaunch {
    let [a, b, c, d, e, f] = std::array::from_fn::<u32, ATTRIBUTES, _>(|i| numbers.get(i).map_or(0, |&n| n as u32));
    EachAttributeLaunch::new(a, b, c, d, e, f)
}
