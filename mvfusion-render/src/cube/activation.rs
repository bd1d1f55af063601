//! The activations of logits. CPU twin: `activation/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use mvfusion_kernels::cube::activation::{ShareKindLaunch, foreground_share, logistic, logistic_backward};

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::activation::op::{LogitAdjoint, LogitOps};
use crate::activation::{SHARE_EPSILON, SHARE_MARGIN};

impl LogitOps for CubeBackend {
    fn logistic(logits: FloatTensor<Self>) -> FloatTensor<Self> {
        let gpu = Gpu::of(&logits);
        let count = logits.shape().num_elements();
        let probabilities = gpu.floats(logits.shape());
        // SAFETY: numbers are read and written below `count`.
        unsafe {
            logistic::launch_unchecked(
                &gpu.client,
                gpu.units(count),
                CUBE,
                single(logits).flat(),
                probabilities.clone().flat(),
                count as u32,
            );
        }
        probabilities
    }

    fn foreground_share(logits: FloatTensor<Self>, [static_, dynamic]: [usize; 2]) -> FloatTensor<Self> {
        let gpu = Gpu::of(&logits);
        let [count, columns] = logits.shape().dims();
        let shares = gpu.floats([count, 1]);
        let kind = ShareKindLaunch::new(
            columns as u32,
            static_ as u32,
            dynamic as u32,
            SHARE_EPSILON as f32,
            SHARE_MARGIN as f32,
        );
        // SAFETY: rows are read and shares written below `count`; both channels are below the number of columns.
        unsafe {
            foreground_share::launch_unchecked(
                &gpu.client,
                gpu.units(count),
                CUBE,
                single(logits).flat(),
                shares.clone().flat(),
                kind,
                count as u32,
            );
        }
        shares
    }
}

impl LogitAdjoint for CubeBackend {
    fn logistic_backward(probabilities: FloatTensor<Self>, v_probabilities: FloatTensor<Self>) -> FloatTensor<Self> {
        let gpu = Gpu::of(&probabilities);
        let count = probabilities.shape().num_elements();
        let v_logits = gpu.floats(probabilities.shape());
        // SAFETY: numbers are read and written below `count`.
        unsafe {
            logistic_backward::launch_unchecked(
                &gpu.client,
                gpu.units(count),
                CUBE,
                single(probabilities).flat(),
                single(v_probabilities).flat(),
                v_logits.clone().flat(),
                count as u32,
            );
        }
        v_logits
    }
}
