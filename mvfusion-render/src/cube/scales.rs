//! The cost of scales. CPU twin: `scales/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use mvfusion_kernels::cube::scales::{SCALES_BLOCK, ScaleRuleLaunch, scale_cost, scale_cost_backward};

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::scales::ScaleRule;
use crate::scales::op::{ScaleAdjoint, ScaleOps};

impl ScaleOps for CubeBackend {
    fn scale_cost(log_scales: FloatTensor<Self>, rule: ScaleRule) -> FloatTensor<Self> {
        let gpu = Gpu::of(&log_scales);
        let count = log_scales.shape()[0];
        let cubes = count.div_ceil(SCALES_BLOCK).max(1);
        let sums = gpu.floats([cubes, 1]);
        // SAFETY: scales are read below `count`, and there is a sum for each cube.
        unsafe {
            scale_cost::launch_unchecked(
                &gpu.client,
                gpu.cubes(cubes),
                CUBE,
                single(log_scales).flat(),
                sums.clone().flat(),
                launched(&rule),
                count as u32,
                cubes as u32,
            );
        }
        gpu.sum_rows(sums)
    }
}

impl ScaleAdjoint for CubeBackend {
    fn scale_cost_backward(
        log_scales: FloatTensor<Self>,
        v_cost: FloatTensor<Self>,
        rule: ScaleRule,
    ) -> FloatTensor<Self> {
        let gpu = Gpu::of(&log_scales);
        let count = log_scales.shape()[0];
        let v_log_scales = gpu.floats(log_scales.shape());
        // SAFETY: scales are read and written below `count`.
        unsafe {
            scale_cost_backward::launch_unchecked(
                &gpu.client,
                gpu.units(count),
                CUBE,
                single(log_scales).flat(),
                single(v_cost).flat(),
                v_log_scales.clone().flat(),
                launched(&rule),
                count as u32,
            );
        }
        v_log_scales
    }
}

fn launched(rule: &ScaleRule) -> ScaleRuleLaunch {
    let ScaleRule { large, large_above, spiky, spiky_above } = rule;
    let [large, large_above, spiky, spiky_above] = [large, large_above, spiky, spiky_above].map(|&value| value as f32);
    ScaleRuleLaunch::new(large, large_above, spiky, spiky_above)
}
