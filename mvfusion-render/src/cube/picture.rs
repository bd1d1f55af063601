//! Unpacking images. CPU twin: `picture/mod.rs`.

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn_cubecl::CubeBackend;
use mvfusion_kernels::cube::picture::unpack;

use super::gpu::{CUBE, Flat, Gpu};
use crate::picture::op::PictureOps;

impl PictureOps for CubeBackend {
    fn unpack(words: IntTensor<Self>, shape: [usize; 4]) -> FloatTensor<Self> {
        let gpu = Gpu::of(&words);
        let planes = gpu.floats(shape);
        let [_, channels, height, width] = shape;
        let pixels = height * width;
        if pixels > 0 {
            let (cubes, count) = (gpu.units(pixels), pixels as u32);
            unpack::launch(&gpu.client, cubes, CUBE, words.flat(), planes.clone().flat(), count, channels);
        }
        planes
    }
}
