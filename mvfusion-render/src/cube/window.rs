//! Window sums and similarities. CPU twin: `window/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Shape;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::window::{
    PlaneSizeLaunch, SimilarityConstantsLaunch, SimilarityKind, adjoint_columns, adjoint_rows, blur_columns, blur_rows,
    moment_columns, similarity_rows,
};

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::window::Window;
use crate::window::op::{Pair, SimilarityAdjoint, Slopes, WindowOps};
use crate::window::similarity::{C1, C2, C3, STRUCTURE_MAX, Similarity};

impl WindowOps for CubeBackend {
    fn window_blur(images: FloatTensor<Self>, window: Window) -> FloatTensor<Self> {
        let pass = Pass::new(&images, &window);
        let (sums, blurred) = (pass.map(), pass.map());
        if pass.pixels() > 0 {
            // SAFETY: taps stay within their plane, and every buffer has the size of `Pass::size`.
            unsafe {
                blur_columns::launch_unchecked(
                    &pass.gpu.client,
                    pass.gpu.units(pass.pixels()),
                    CUBE,
                    single(images).flat(),
                    pass.weights.clone().flat(),
                    sums.clone().flat(),
                    pass.size(),
                );
            }
            // SAFETY: taps stay within their plane, and every buffer has the size of `Pass::size`.
            unsafe {
                blur_rows::launch_unchecked(
                    &pass.gpu.client,
                    pass.gpu.units(pass.pixels()),
                    CUBE,
                    sums.flat(),
                    pass.weights.clone().flat(),
                    blurred.clone().flat(),
                    pass.size(),
                );
            }
        }
        blurred
    }

    fn window_similarity(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        window: Window,
        kind: Similarity,
    ) -> FloatTensor<Self> {
        let pass = Pass::new(&a, &window);
        let map = pass.map();
        // The derivatives are not needed, but the kernel has an argument for them.
        let none = pass.gpu.floats([1]);
        pass.similarity(Pair { a, b }, kind, &map, none, false);
        map
    }
}

impl SimilarityAdjoint for CubeBackend {
    fn window_similarity_tracked(
        pair: Pair<Self>,
        window: Window,
        kind: Similarity,
    ) -> (FloatTensor<Self>, Slopes<Self>) {
        let pass = Pass::new(&pair.a, &window);
        let (map, slopes) = (pass.map(), pass.maps());
        pass.similarity(pair, kind, &map, slopes.clone(), true);
        (map, Slopes(vec![slopes]))
    }

    fn window_similarity_backward(
        pair: Pair<Self>,
        slopes: Slopes<Self>,
        v_map: FloatTensor<Self>,
        window: Window,
    ) -> Pair<Self> {
        let pass = Pass::new(&v_map, &window);
        // Proof: the forward pass saved one tensor.
        let slopes = slopes.0.into_iter().next().expect("the slopes");
        let (sums, adjoints) = (pass.maps(), Pair::<Self> { a: pass.map(), b: pass.map() });
        if pass.pixels() > 0 {
            // SAFETY: taps stay within their plane, and every buffer has the size of `Pass::size`.
            unsafe {
                adjoint_columns::launch_unchecked(
                    &pass.gpu.client,
                    pass.gpu.units(pass.pixels()),
                    CUBE,
                    single(v_map).flat(),
                    single(slopes).flat(),
                    pass.weights.clone().flat(),
                    sums.clone().flat(),
                    pass.size(),
                );
            }
            // SAFETY: taps stay within their plane, and every buffer has the size of `Pass::size`.
            unsafe {
                adjoint_rows::launch_unchecked(
                    &pass.gpu.client,
                    pass.gpu.units(pass.pixels()),
                    CUBE,
                    sums.flat(),
                    single(pair.a).flat(),
                    single(pair.b).flat(),
                    pass.weights.clone().flat(),
                    adjoints.a.clone().flat(),
                    adjoints.b.clone().flat(),
                    pass.size(),
                );
            }
        }
        adjoints
    }
}

/// One window over images of one shape.
struct Pass {
    gpu: Gpu,
    weights: CubeTensor,
    /// `[B, C, H, W]`.
    shape: Shape,
}

impl Pass {
    fn new(images: &CubeTensor, window: &Window) -> Self {
        let gpu = Gpu::of(images);
        Self { weights: gpu.upload_floats(window.weights()), shape: images.shape(), gpu }
    }

    fn pixels(&self) -> usize {
        self.shape.num_elements()
    }

    fn size(&self) -> PlaneSizeLaunch {
        PlaneSizeLaunch::new((self.shape[0] * self.shape[1]) as u32, self.shape[2] as u32, self.shape[3] as u32)
    }

    /// Allocates one value per pixel.
    fn map(&self) -> CubeTensor {
        self.gpu.floats(self.shape.clone())
    }

    /// Allocates four values per pixel.
    fn maps(&self) -> CubeTensor {
        self.gpu.floats([4, self.pixels()])
    }

    fn similarity(
        &self,
        pair: Pair<CubeBackend>,
        kind: Similarity,
        map: &CubeTensor,
        slopes: CubeTensor,
        wanted: bool,
    ) {
        if self.pixels() == 0 {
            return;
        }
        let sums = self.maps();
        // SAFETY: taps stay within their plane, and every buffer has the size of `Pass::size`.
        unsafe {
            moment_columns::launch_unchecked(
                &self.gpu.client,
                self.gpu.units(self.pixels()),
                CUBE,
                single(pair.a).flat(),
                single(pair.b).flat(),
                self.weights.clone().flat(),
                sums.clone().flat(),
                self.size(),
            );
        }
        let kind = match kind {
            Similarity::Ssim => SimilarityKind::Ssim,
            Similarity::Structure => SimilarityKind::Structure,
        };
        // SAFETY: taps stay within their plane, and every buffer has the size of `Pass::size`.
        unsafe {
            similarity_rows::launch_unchecked(
                &self.gpu.client,
                self.gpu.units(self.pixels()),
                CUBE,
                sums.flat(),
                self.weights.clone().flat(),
                map.clone().flat(),
                slopes.flat(),
                self.size(),
                SimilarityConstantsLaunch::new(C1 as f32, C2 as f32, C3 as f32, STRUCTURE_MAX as f32),
                kind,
                wanted,
            );
        }
    }
}
