//! Attention. CPU twin: `attention/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use mvfusion_kernels::cube::attention::{attention, attention_backward};
use mvfusion_kernels::cube::stage::FOUR;

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::attention::op::{Arguments, AttentionAdjoint, AttentionOps};

impl AttentionOps for CubeBackend {
    fn attention_forward(queries: FloatTensor<Self>, memory: FloatTensor<Self>, heads: usize) -> FloatTensor<Self> {
        let gpu = Gpu::of(&queries);
        let arguments = Arguments::<Self> { queries: single(queries), memory: single(memory) };
        let (rows, layout) = (arguments.queries.shape()[0], arguments.layout(heads));
        let found = gpu.floats(arguments.queries.shape());
        if rows > 0 {
            attention::launch(
                &gpu.client,
                gpu.units(rows * layout.queries * heads),
                CUBE,
                vector(layout.width, heads),
                arguments.queries.flat(),
                arguments.memory.flat(),
                found.clone().flat(),
                rows as u32,
                layout.width as u32,
                heads,
                layout.queries,
                layout.keys,
            );
        }
        found
    }
}

impl AttentionAdjoint for CubeBackend {
    fn attention_backward(
        arguments: Arguments<Self>,
        v_found: FloatTensor<Self>,
        heads: usize,
    ) -> [FloatTensor<Self>; 2] {
        let gpu = Gpu::of(&v_found);
        let (rows, layout) = (arguments.queries.shape()[0], arguments.layout(heads));
        let adjoints = [gpu.floats(arguments.queries.shape()), gpu.floats(arguments.memory.shape())];
        if rows > 0 {
            let [v_queries, v_memory] = adjoints.clone();
            attention_backward::launch(
                &gpu.client,
                gpu.units(rows * heads),
                CUBE,
                vector(layout.width, heads),
                single(arguments.queries).flat(),
                single(arguments.memory).flat(),
                single(v_found).flat(),
                v_queries.flat(),
                v_memory.flat(),
                rows as u32,
                layout.width as u32,
                heads,
                layout.queries,
                layout.keys,
            );
        }
        adjoints
    }
}

/// Numbers of a head that are read and written together.
fn vector(width: usize, heads: usize) -> usize {
    if (width / heads).is_multiple_of(FOUR) { FOUR } else { 1 }
}
