//! Window sums and similarities. CPU twin: `window/cpu.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn::tensor::Shape;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use mvfusion_kernels::cube::similarity::{
    Derivatives, ImageStartsLaunch, MOST_RADIUS, SimilarityConstantsLaunch, SimilarityKind, similarity,
    similarity_adjoint, tile_count,
};
use mvfusion_kernels::cube::window::{PlaneSizeLaunch, blur_columns, blur_rows};

use super::gpu::{CUBE, Flat, Gpu, single};
use crate::window::Window;
use crate::window::op::{Pair, SimilarityAdjoint, Slopes, WindowOps};
use crate::window::similarity::{C1, C2, C3, STRUCTURE_MAX, Similarity};

/// Pixels of the widest window over which pictures are compared, along an axis.
pub(crate) const MOST_PIXELS: usize = 2 * MOST_RADIUS + 1;

impl WindowOps for CubeBackend {
    fn window_blur(images: FloatTensor<Self>, window: Window) -> FloatTensor<Self> {
        let pass = Pass::of(&images, &window);
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
        let pass = Pass::of(&a, &window);
        pass.similarity([a, b].map(Planes::all), kind, Derivatives::None).0
    }
}

impl SimilarityAdjoint for CubeBackend {
    fn window_similarity_tracked(
        pair: Pair<Self>,
        window: Window,
        kind: Similarity,
    ) -> (FloatTensor<Self>, Slopes<Self>) {
        let pass = Pass::of(&pair.a, &window);
        let (map, slopes) = pass.similarity([pair.a, pair.b].map(Planes::all), kind, Derivatives::Both);
        (map, Slopes(vec![slopes]))
    }

    fn window_similarity_backward(
        pair: Pair<Self>,
        slopes: Slopes<Self>,
        v_map: FloatTensor<Self>,
        window: Window,
    ) -> Pair<Self> {
        let pass = Pass::of(&v_map, &window);
        // Proof: the forward pass saved one tensor.
        let slopes = slopes.0.into_iter().next().expect("the slopes");
        pass.adjoint([pair.a, pair.b].map(Planes::all), slopes, Planes::all(v_map), true)
    }
}

/// Planes of a tensor `[1, C, H, W]`, from one on. A slice of it would be a copy where it does not begin and end at
/// multiples of the device's alignment.
#[derive(Clone)]
pub(super) struct Planes {
    pub tensor: CubeTensor,
    /// The first of them.
    pub first: usize,
}

impl Planes {
    fn all(tensor: CubeTensor) -> Self {
        Self { tensor: single(tensor), first: 0 }
    }

    /// The place of their first number.
    fn start(&self) -> u32 {
        let shape = self.tensor.meta.shape();
        (self.first * shape[2] * shape[3]) as u32
    }
}

/// The similarity of two images of so many planes; with a cotangent of it, also the adjoint of the first image.
pub(super) fn similarity_and_adjoint(
    [a, b]: [Planes; 2],
    count: usize,
    v_map: Option<Planes>,
    window: &Window,
    kind: Similarity,
) -> (CubeTensor, Option<CubeTensor>) {
    let mut shape = a.tensor.shape();
    shape[1] = count;
    let pass = Pass::new(Gpu::of(&a.tensor), shape, window);
    let Some(v_map) = v_map else { return (pass.similarity([a, b], kind, Derivatives::None).0, None) };
    let (map, slopes) = pass.similarity([a.clone(), b.clone()], kind, Derivatives::First);
    (map, Some(pass.adjoint([a, b], slopes, v_map, false).a))
}

/// One window over images of one shape.
struct Pass {
    gpu: Gpu,
    weights: CubeTensor,
    /// `[B, C, H, W]`.
    shape: Shape,
}

impl Pass {
    fn of(images: &CubeTensor, window: &Window) -> Self {
        Self::new(Gpu::of(images), images.shape(), window)
    }

    fn new(gpu: Gpu, shape: Shape, window: &Window) -> Self {
        Self { weights: gpu.upload_floats(window.weights()), shape, gpu }
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
        assert!(radius <= MOST_RADIUS, "a GPU compares over windows of at most {MOST_PIXELS} pixels");
        radius
    }

    /// The map and its slopes.
    fn similarity(&self, [a, b]: [Planes; 2], kind: Similarity, derivatives: Derivatives) -> (CubeTensor, CubeTensor) {
        // A kernel has an argument for slopes that are not wanted, too.
        let (map, slopes) = (self.map(), self.gpu.floats([(derivatives.maps() * self.pixels()).max(1)]));
        let kind = match kind {
            Similarity::Ssim => SimilarityKind::Ssim,
            Similarity::Structure => SimilarityKind::Structure,
        };
        if self.pixels() > 0 {
            let starts = ImageStartsLaunch::new(a.start(), b.start(), 0);
            // SAFETY: taps stay within their plane, excess units do nothing, and the slopes have their maps.
            unsafe {
                similarity::launch_unchecked(
                    &self.gpu.client,
                    self.gpu.cubes(self.tiles()),
                    CUBE,
                    a.tensor.flat(),
                    b.tensor.flat(),
                    self.weights.clone().flat(),
                    map.clone().flat(),
                    slopes.clone().flat(),
                    starts,
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
    fn adjoint(&self, [a, b]: [Planes; 2], slopes: CubeTensor, v_map: Planes, both: bool) -> Pair<CubeBackend> {
        let adjoints = Pair::<CubeBackend> { a: self.map(), b: if both { self.map() } else { self.gpu.floats([1]) } };
        if self.pixels() > 0 {
            let starts = ImageStartsLaunch::new(a.start(), b.start(), v_map.start());
            // SAFETY: taps stay within their plane, excess units do nothing, and the slopes have their maps.
            unsafe {
                similarity_adjoint::launch_unchecked(
                    &self.gpu.client,
                    self.gpu.cubes(self.tiles()),
                    CUBE,
                    v_map.tensor.flat(),
                    slopes.flat(),
                    a.tensor.flat(),
                    b.tensor.flat(),
                    self.weights.clone().flat(),
                    adjoints.a.clone().flat(),
                    adjoints.b.clone().flat(),
                    starts,
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
