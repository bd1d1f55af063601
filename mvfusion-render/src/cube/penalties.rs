//! The grid penalties. CPU twin: `grid/regulariser/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::penalties::{PENALTY_BLOCK, TERMS, penalties, penalties_backward};

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::grid::GridLayout;
use crate::grid::regulariser::op::{PenaltyAdjoint, PenaltyOps};

impl PenaltyOps for CubeBackend {
    fn grid_penalties(planes: FloatTensor<Self>, layout: GridLayout) -> FloatTensor<Self> {
        let gpu = Gpu::of(&planes);
        let numbers = planes.shape().num_elements();
        let cubes = numbers.div_ceil(PENALTY_BLOCK);
        let sums = gpu.floats([cubes, TERMS]);
        // SAFETY: values are read within their plane, whose size is in `places`.
        unsafe {
            penalties::launch_unchecked(
                &gpu.client,
                gpu.cubes(cubes),
                CUBE,
                single(planes).flat(),
                places(&gpu, &layout).flat(),
                sums.clone().flat(),
                numbers as u32,
                layout.features as u32,
                cubes as u32,
            );
        }
        gpu.sum_rows(sums)
    }
}

impl PenaltyAdjoint for CubeBackend {
    fn grid_penalties_backward(
        planes: FloatTensor<Self>,
        v_terms: FloatTensor<Self>,
        layout: GridLayout,
    ) -> FloatTensor<Self> {
        let gpu = Gpu::of(&planes);
        let numbers = planes.shape().num_elements();
        let v_planes = gpu.floats(planes.shape());
        // SAFETY: values are read within their plane, whose size is in `places`.
        unsafe {
            penalties_backward::launch_unchecked(
                &gpu.client,
                gpu.units(numbers),
                CUBE,
                single(planes).flat(),
                places(&gpu, &layout).flat(),
                single(v_terms).flat(),
                v_planes.clone().flat(),
                numbers as u32,
                layout.features as u32,
            );
        }
        v_planes
    }
}

/// The layout of each plane, see [`mvfusion_kernels::cube::penalties`].
fn places(gpu: &Gpu, layout: &GridLayout) -> CubeTensor {
    let planes = layout.planes();
    let numbers = planes.iter().flat_map(|plane| {
        [plane.first_cell as u32, plane.width as u32, plane.height as u32, u32::from(plane.is_time())]
    });
    gpu.upload(&numbers.collect::<Vec<_>>())
}
