//! The splat op: projection, sorting, blending, and back. CPU twin: `splat/cpu/forward.rs` and `backward.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::tensor::CubeTensor;
use burn_cubecl::{CubeBackend, CubeDevice};
use cubecl::CubeDim;
use mvfusion_kernels::cube::blend::blend;
use mvfusion_kernels::cube::blend_backward::{BlendBackwardKind, CountedChannels, blend_backward, record_vectors};
use mvfusion_kernels::cube::maths::{PairLaunch, TripleLaunch};
use mvfusion_kernels::cube::project::project;
use mvfusion_kernels::cube::project_backward::project_backward;
use mvfusion_kernels::cube::stage::TileShare;
use mvfusion_kernels::cube::view::{BlendRulesLaunch, ProjectionKind, ViewLaunch};
use mvfusion_kernels::splat::{COLOUR_CHANNELS, PROJECTED_LEN, TILE_PIXELS};

use super::bins::{Bins, PAIR_BYTES};
use super::gpu::{CUBE, Gpu, TilePlan, single};
use crate::splat::cpu::view::View;
use crate::splat::op::{
    SplatForward, SplatGradients, SplatKernels, SplatOps, SplatOutput, SplatPlan, SplatPrimitives, SplatSaved,
};
use crate::splat::{Antialias, Extent, Statistic};

impl SplatOps for CubeBackend {
    fn splat(inputs: SplatPrimitives<Self>, plan: SplatPlan) -> SplatOutput<Self> {
        forward(inputs, &plan, PAIR_BYTES).output
    }
}

impl SplatKernels for CubeBackend {
    fn splat_forward(inputs: SplatPrimitives<Self>, plan: SplatPlan) -> SplatForward<Self> {
        let channels = COLOUR_CHANNELS + plan.feature_count + 1;
        forward(inputs, &plan, PAIR_BYTES.max(record_bytes(channels)))
    }

    fn splat_backward(
        inputs: SplatPrimitives<Self>,
        saved: SplatSaved<Self>,
        v_picture: FloatTensor<Self>,
        plan: SplatPlan,
        statistic: Option<Statistic>,
    ) -> SplatGradients<Self> {
        let frame = Frame::new(inputs, &plan);
        let (gradients, background) = frame.blend_backward(&saved, single(v_picture), statistic);
        frame.project_backward(&saved, gradients, background)
    }
}

/// Renders. Each pair of a Gaussian and a tile will take `pair_bytes` in the largest of its buffers.
fn forward(inputs: SplatPrimitives<CubeBackend>, plan: &SplatPlan, pair_bytes: u64) -> SplatForward<CubeBackend> {
    let frame = Frame::new(inputs, plan);
    let projected = frame.project();
    let (bins, refused) = match frame.bin(&projected, pair_bytes) {
        Ok(bins) => (bins, None),
        Err(error) => (frame.no_bins(), Some(error)),
    };
    let mut forward = frame.blend(projected, bins);
    forward.output.refused = refused;
    forward
}

/// Bytes of the gradient record of a pair of a Gaussian and a tile.
fn record_bytes(channels: usize) -> u64 {
    16 * record_vectors(channels) as u64
}

/// One picture to render, or to pull back.
pub(super) struct Frame {
    pub gpu: Gpu,
    means: CubeTensor,
    quaternions: CubeTensor,
    log_scales: CubeTensor,
    opacity_logits: CubeTensor,
    sh: CubeTensor,
    features: CubeTensor,
    background: CubeTensor,
    pub view: View<f32>,
    feature_count: usize,
}

/// Projected Gaussians.
pub(super) struct Projected {
    /// `[N, PROJECTED_LEN]`.
    pub records: CubeTensor,
    /// `[N, 2]`.
    pub radii: CubeTensor,
    /// `[N]`, the larger radius.
    largest: CubeTensor,
    /// `[N]`, tiles that each touches.
    pub touched: CubeTensor,
}

impl Frame {
    fn new(inputs: SplatPrimitives<CubeBackend>, plan: &SplatPlan) -> Self {
        Self {
            gpu: Gpu::of(&inputs.means),
            means: single(inputs.means),
            quaternions: single(inputs.quaternions),
            log_scales: single(inputs.log_scales),
            opacity_logits: single(inputs.opacity_logits),
            sh: single(inputs.sh),
            features: single(inputs.features),
            background: single(inputs.background),
            view: View::new(&plan.camera, &plan.settings),
            feature_count: plan.feature_count,
        }
    }

    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        self.opacity_logits.shape()[0]
    }

    /// Coefficients of a Gaussian.
    fn stored(&self) -> usize {
        self.sh.shape()[1]
    }

    /// Blended channels: colour, features, depth.
    fn channels(&self) -> usize {
        COLOUR_CHANNELS + self.feature_count + 1
    }

    fn kind(&self) -> ProjectionKind {
        ProjectionKind {
            square: self.is_square(),
            compensated: self.view.antialias == Antialias::Compensated,
            degree: self.view.sh_degree,
        }
    }

    /// Whether tiles are reckoned by one radius.
    pub fn is_square(&self) -> bool {
        matches!(self.view.extent, Extent::Square { .. })
    }

    /// The camera and the rules of projection, for a kernel.
    pub fn view(&self) -> ViewLaunch {
        let view = &self.view;
        let pair = |[x, y]: [f32; 2]| PairLaunch::new(x, y);
        let triple = |[x, y, z]: [f32; 3]| TripleLaunch::new(x, y, z);
        let [right, down, forward] = view.rotation;
        let sigmas = match view.extent {
            Extent::Square { sigmas } | Extent::PerAxis { sigmas } => sigmas as f32,
        };
        ViewLaunch::new(
            view.width as u32,
            view.height as u32,
            pair(view.focal),
            pair(view.principal),
            triple(right),
            triple(down),
            triple(forward),
            triple(view.translation),
            triple(view.centre),
            pair(view.tangent_low),
            pair(view.tangent_high),
            view.near,
            finite(view.far),
            view.depth_guard,
            view.dilation,
            sigmas,
        )
    }

    fn rules(&self) -> BlendRulesLaunch {
        let view = &self.view;
        BlendRulesLaunch::new(view.alpha_clamp, finite(view.gradient_clamp), view.stop)
    }

    fn project(&self) -> Projected {
        let (gpu, count) = (&self.gpu, self.count());
        let projected = Projected {
            records: gpu.floats([count, PROJECTED_LEN]),
            radii: gpu.integers([count, 2]),
            largest: gpu.integers([count]),
            touched: gpu.naturals(count),
        };
        if count > 0 {
            project::launch(
                &gpu.client,
                gpu.units(count),
                CUBE,
                self.means.clone().into_buffer_arg(),
                self.quaternions.clone().into_buffer_arg(),
                self.log_scales.clone().into_buffer_arg(),
                self.opacity_logits.clone().into_buffer_arg(),
                self.sh.clone().into_buffer_arg(),
                self.features.clone().into_buffer_arg(),
                projected.records.clone().into_buffer_arg(),
                projected.radii.clone().into_buffer_arg(),
                projected.largest.clone().into_buffer_arg(),
                projected.touched.clone().into_buffer_arg(),
                self.view(),
                count as u32,
                self.stored() as u32,
                self.feature_count as u32,
                self.kind(),
            );
        }
        projected
    }

    fn blend(&self, projected: Projected, bins: Bins) -> SplatForward<CubeBackend> {
        let (gpu, tiles, view) = (&self.gpu, self.view.tile_count(), &self.view);
        let picture = gpu.floats([2, self.channels() + 1, view.height, view.width]);
        let (transmittance, last) = (gpu.floats([tiles, TILE_PIXELS]), gpu.integers([tiles, TILE_PIXELS]));
        // Proof: `splat` has made sure that the backward pass fits, which needs more.
        let share = fitting(gpu.tile_plan(), |span, memory| TileShare::fitting(span, self.channels(), memory))
            .expect("the channels fit");
        // SAFETY: the kernel's indices lie within its arguments: tiles, pixels and channels by the sizes of the tensors
        // made here, the places in the lists by `starts`, and the lists name projected Gaussians. Its loops end with
        // the lists.
        unsafe {
            blend::launch_unchecked(
                &gpu.client,
                gpu.cubes(tiles),
                CubeDim::new_1d(share.units() as u32),
                projected.records.clone().into_buffer_arg(),
                self.features.clone().into_buffer_arg(),
                self.background.clone().into_buffer_arg(),
                bins.sorted.clone().into_buffer_arg(),
                bins.starts.clone().into_buffer_arg(),
                picture.clone().into_buffer_arg(),
                transmittance.clone().into_buffer_arg(),
                last.clone().into_buffer_arg(),
                view.width as u32,
                view.height as u32,
                self.rules(),
                share,
            );
        }
        SplatForward {
            output: SplatOutput { picture, radii: projected.largest, refused: None },
            saved: SplatSaved {
                records: projected.records,
                sorted: bins.sorted,
                starts: bins.starts,
                spans: bins.spans,
                slots: bins.slots,
                transmittance,
                last,
            },
        }
    }

    /// The gradient records of the tile lists, and the tiles' shares of the background's gradient.
    fn blend_backward(
        &self,
        saved: &SplatSaved<CubeBackend>,
        v_picture: CubeTensor,
        statistic: Option<Statistic>,
    ) -> (CubeTensor, CubeTensor) {
        let (gpu, tiles, channels) = (&self.gpu, self.view.tile_count(), self.channels());
        let statistic = statistic.map(|statistic| match statistic {
            Statistic::ColourAndDepth => CountedChannels::ColourAndDepth,
            Statistic::AllChannels => CountedChannels::All,
        });
        // Proof: `splat` has made sure of it.
        let kind =
            fitting(gpu.tile_plan(), |span, memory| BlendBackwardKind::fitting(span, channels, statistic, memory))
                .expect("the channels fit");
        // One row at least: the kernel reads and writes vectors, for which no device binds less.
        let gradients = gpu.floats([saved.sorted.shape()[0].max(1), 4 * record_vectors(channels)]);
        let background = gpu.floats([tiles, channels - 1]);
        // SAFETY: as for the forward pass; the gradients have a row for each entry of the lists.
        unsafe {
            blend_backward::launch_unchecked(
                &gpu.client,
                gpu.cubes(tiles),
                CubeDim::new_1d(kind.share.units() as u32),
                saved.records.clone().into_buffer_arg(),
                self.features.clone().into_buffer_arg(),
                self.background.clone().into_buffer_arg(),
                saved.sorted.clone().into_buffer_arg(),
                saved.starts.clone().into_buffer_arg(),
                saved.transmittance.clone().into_buffer_arg(),
                saved.last.clone().into_buffer_arg(),
                v_picture.into_buffer_arg(),
                gradients.clone().into_buffer_arg(),
                background.clone().into_buffer_arg(),
                self.view.width as u32,
                self.view.height as u32,
                self.rules(),
                kind,
            );
        }
        (gradients, background)
    }

    fn project_backward(
        &self,
        saved: &SplatSaved<CubeBackend>,
        gradients: CubeTensor,
        background: CubeTensor,
    ) -> SplatGradients<CubeBackend> {
        let (gpu, count) = (&self.gpu, self.count());
        let result = SplatGradients::<CubeBackend> {
            means: gpu.floats([count, 3]),
            quaternions: gpu.floats([count, 4]),
            log_scales: gpu.floats([count, 3]),
            opacity_logits: gpu.floats([count]),
            sh: gpu.floats([count, self.stored(), COLOUR_CHANNELS]),
            features: gpu.floats([count, self.feature_count]),
            background: gpu.sum_rows(background),
            statistic: gpu.floats([count, 2]),
        };
        if count > 0 {
            // SAFETY: units beyond the Gaussians do nothing, and the others read and write their own rows; `spans` and
            // `slots` name rows of `gradients`.
            unsafe {
                project_backward::launch_unchecked(
                    &gpu.client,
                    gpu.units(count),
                    CUBE,
                    self.means.clone().into_buffer_arg(),
                    self.quaternions.clone().into_buffer_arg(),
                    self.log_scales.clone().into_buffer_arg(),
                    self.opacity_logits.clone().into_buffer_arg(),
                    self.sh.clone().into_buffer_arg(),
                    saved.records.clone().into_buffer_arg(),
                    saved.spans.clone().into_buffer_arg(),
                    saved.slots.clone().into_buffer_arg(),
                    gradients.into_buffer_arg(),
                    result.means.clone().into_buffer_arg(),
                    result.quaternions.clone().into_buffer_arg(),
                    result.log_scales.clone().into_buffer_arg(),
                    result.opacity_logits.clone().into_buffer_arg(),
                    result.sh.clone().into_buffer_arg(),
                    result.features.clone().into_buffer_arg(),
                    result.statistic.clone().into_buffer_arg(),
                    self.view(),
                    count as u32,
                    self.stored() as u32,
                    self.channels(),
                    self.kind(),
                );
            }
        }
        result
    }
}

/// Whether the units of a device share enough memory to blend so many channels, there and back.
pub(crate) fn fits_shared_memory(device: &CubeDevice, channels: usize) -> bool {
    let statistic = Some(CountedChannels::All);
    let kind = |span, memory| BlendBackwardKind::fitting(span, channels, statistic, memory);
    fitting(TilePlan::of(device), kind).is_some()
}

/// The first of the plan's sizes of memory in which something fits.
fn fitting<T>(plan: TilePlan, kind: impl Fn(usize, usize) -> Option<T>) -> Option<T> {
    plan.memory.into_iter().find_map(|memory| kind(plan.span, memory))
}

/// The largest number for one without end: a shader may take floats to be finite.
fn finite(number: f32) -> f32 {
    number.min(f32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sixteen_kibibytes_hold_the_blending_of_47_features_on_hardware() {
        let hardware = TilePlan { span: 4, memory: [16 << 10; 2] };
        let fits = |features: usize| {
            let channels = COLOUR_CHANNELS + features + 1;
            let kind = |span, memory| BlendBackwardKind::fitting(span, channels, Some(CountedChannels::All), memory);
            fitting(hardware, kind).is_some()
        };
        assert!((0..=47).all(fits) && !fits(48));
    }
}
