//! Window sums and similarities. CPU twin: `window/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Shape;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::similarity::{
    Derivatives, MOST_RADIUS, SimilarityConstantsLaunch, SimilarityKind, similarity, similarity_adjoint, tile_count,
};
use mvfusion_kernels::cube::window::{PlaneSizeLaunch, blur_columns, blur_rows};

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
        let (map, _) = pass.similarity(Pair { a, b }, kind, Derivatives::None);
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
        let (map, slopes) = pass.similarity(pair, kind, Derivatives::Both);
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
        pass.adjoint(pair, slopes, v_map, true)
    }
}

/// The similarity of two images, and the adjoint of the first for the cotangent `v_map`.
pub(super) fn similarity_and_adjoint(
    pair: Pair<CubeBackend>,
    v_map: CubeTensor,
    window: &Window,
    kind: Similarity,
) -> (CubeTensor, CubeTensor) {
    let pass = Pass::new(&pair.a, window);
    let (map, slopes) = pass.similarity(pair.clone(), kind, Derivatives::First);
    (map, pass.adjoint(pair, slopes, v_map, false).a)
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

    /// Tiles of the planes.
    fn tiles(&self) -> usize {
        tile_count(self.shape[0] * self.shape[1], self.shape[2], self.shape[3])
    }

    /// The radius of a window over which pictures are compared.
    ///
    /// # Panics
    /// If its sums do not fit into the shared memory of a GPU.
    fn radius(&self) -> usize {
        let radius = self.weights.meta.num_elements() / 2;
        assert!(radius <= MOST_RADIUS, "a GPU compares windows of at most {} pixels", 2 * MOST_RADIUS + 1);
        radius
    }

    /// The map and its slopes.
    fn similarity(
        &self,
        pair: Pair<CubeBackend>,
        kind: Similarity,
        derivatives: Derivatives,
    ) -> (CubeTensor, CubeTensor) {
        // A kernel has an argument for slopes that are not wanted, too.
        let (map, slopes) = (self.map(), self.gpu.floats([(derivatives.maps() * self.pixels()).max(1)]));
        let kind = match kind {
            Similarity::Ssim => SimilarityKind::Ssim,
            Similarity::Structure => SimilarityKind::Structure,
        };
        if self.pixels() > 0 {
            // SAFETY: taps stay within their plane, excess units do nothing, and the slopes have their maps.
            unsafe {
                similarity::launch_unchecked(
                    &self.gpu.client,
                    self.gpu.cubes(self.tiles()),
                    CUBE,
                    single(pair.a).flat(),
                    single(pair.b).flat(),
                    self.weights.clone().flat(),
                    map.clone().flat(),
                    slopes.clone().flat(),
                    self.size(),
                    SimilarityConstantsLaunch::new(C1 as f32, C2 as f32, C3 as f32, STRUCTURE_MAX as f32),
                    self.tiles() as u32,
                    self.radius(),
                    kind,
                    derivatives,
                );
            }
        }
        (map, slopes)
    }

    /// The adjoints of the images; without `both`, that of the first.
    fn adjoint(&self, pair: Pair<CubeBackend>, slopes: CubeTensor, v_map: CubeTensor, both: bool) -> Pair<CubeBackend> {
        let adjoints = Pair::<CubeBackend> { a: self.map(), b: if both { self.map() } else { self.gpu.floats([1]) } };
        if self.pixels() > 0 {
            // SAFETY: taps stay within their plane, excess units do nothing, and the slopes have their maps.
            unsafe {
                similarity_adjoint::launch_unchecked(
                    &self.gpu.client,
                    self.gpu.cubes(self.tiles()),
                    CUBE,
                    single(v_map).flat(),
                    slopes.flat(),
                    single(pair.a).flat(),
                    single(pair.b).flat(),
                    self.weights.clone().flat(),
                    adjoints.a.clone().flat(),
                    adjoints.b.clone().flat(),
                    self.size(),
                    self.tiles() as u32,
                    self.radius(),
                    both,
                );
            }
        }
        adjoints
    }
}
