//! The splat op: projection, sorting, blending, and back. CPU twin: `splat/cpu/forward.rs` and `backward.rs`.

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::CubeDim;
use mvfusion_kernels::cube::blend::blend;
use mvfusion_kernels::cube::blend_backward::{BlendBackwardKind, CountedChannels, blend_backward, record_vectors};
use mvfusion_kernels::cube::maths::{PairLaunch, TripleLaunch};
use mvfusion_kernels::cube::project::project;
use mvfusion_kernels::cube::project_backward::project_backward;
use mvfusion_kernels::cube::stage::TileShare;
use mvfusion_kernels::cube::tiles::{
    collect_visible, counts_by_depth, emit_pairs, find_starts, list_pairs, mark_visible,
};
use mvfusion_kernels::cube::view::{BlendRulesLaunch, ProjectionKind, ViewLaunch};
use mvfusion_kernels::splat::{COLOUR_CHANNELS, PROJECTED_LEN, TILE_PIXELS};

use super::gpu::{CUBE, Gpu, TilePlan, single};
use super::scan::running_sums;
use super::sort::{Keyed, sort};
use crate::splat::cpu::view::View;
use crate::splat::op::{
    SplatForward, SplatGradients, SplatKernels, SplatOps, SplatOutput, SplatPlan, SplatPrimitives, SplatSaved,
};
use crate::splat::{Antialias, Extent, SplatError, Statistic};

/// Bits of a depth's sort key.
const DEPTH_BITS: usize = 32;

/// Bytes that a pair of a Gaussian and a tile takes in each of the lists.
const PAIR_BYTES: u64 = 4;

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
struct Frame {
    gpu: Gpu,
    means: CubeTensor,
    quaternions: CubeTensor,
    log_scales: CubeTensor,
    opacity_logits: CubeTensor,
    sh: CubeTensor,
    features: CubeTensor,
    background: CubeTensor,
    view: View<f32>,
    feature_count: usize,
}

/// Projected Gaussians.
struct Projected {
    /// `[N, PROJECTED_LEN]`.
    records: CubeTensor,
    /// `[N, 2]`.
    radii: CubeTensor,
    /// `[N]`, the larger radius.
    largest: CubeTensor,
    /// `[N]`, tiles that each touches.
    touched: CubeTensor,
}

/// The tile lists, as [`SplatSaved`] names them.
struct Bins {
    sorted: CubeTensor,
    starts: CubeTensor,
    spans: CubeTensor,
    slots: CubeTensor,
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
    fn count(&self) -> usize {
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

    fn is_square(&self) -> bool {
        matches!(self.view.extent, Extent::Square { .. })
    }

    fn view(&self) -> ViewLaunch {
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
            view.far,
            view.depth_guard,
            view.dilation,
            sigmas,
        )
    }

    fn rules(&self) -> BlendRulesLaunch {
        let view = &self.view;
        // A shader may take floats to be finite, and the largest one stands for "no clamp" as well.
        BlendRulesLaunch::new(view.alpha_clamp, view.gradient_clamp.min(f32::MAX), view.stop)
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

    /// Lists the Gaussians of each tile by depth. Here is the one place where the host waits for the device: the lists'
    /// length is not known before.
    ///
    /// # Errors
    /// If a buffer of `pair_bytes` for each entry of the lists is larger than the device has.
    fn bin(&self, projected: &Projected, pair_bytes: u64) -> Result<Bins, SplatError> {
        let (gpu, count, tiles) = (&self.gpu, self.count(), self.view.tile_count());
        if count == 0 {
            return Ok(self.no_bins());
        }
        let marks = gpu.naturals(count);
        mark_visible::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            projected.touched.clone().into_buffer_arg(),
            marks.clone().into_buffer_arg(),
            count as u32,
        );
        let ranks = running_sums(gpu, &marks, count);
        let visible = ranks.total;
        let by_index = Keyed { keys: gpu.naturals(count), numbers: gpu.naturals(count) };
        collect_visible::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            projected.records.clone().into_buffer_arg(),
            projected.touched.clone().into_buffer_arg(),
            ranks.before.into_buffer_arg(),
            by_index.keys.clone().into_buffer_arg(),
            by_index.numbers.clone().into_buffer_arg(),
            count as u32,
        );
        let ids = sort(gpu, by_index, &visible, count, DEPTH_BITS).numbers;
        let counts = marks;
        counts_by_depth::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            ids.clone().into_buffer_arg(),
            projected.touched.clone().into_buffer_arg(),
            visible.clone().into_buffer_arg(),
            counts.clone().into_buffer_arg(),
            count as u32,
        );
        let offsets = running_sums(gpu, &counts, count);
        let pairs = gpu.read(&offsets.total);
        if pairs == 0 {
            return Ok(self.no_bins());
        }
        check_pairs(pairs, pair_bytes, gpu.buffer_limit())?;
        let pairs = pairs as usize;

        let by_depth = Keyed { keys: gpu.naturals(pairs), numbers: gpu.naturals(pairs) };
        let owners = gpu.naturals(pairs);
        let spans = gpu.zeros([count, 2]);
        emit_pairs::launch(
            &gpu.client,
            gpu.units(count),
            CUBE,
            projected.records.clone().into_buffer_arg(),
            projected.radii.clone().into_buffer_arg(),
            ids.into_buffer_arg(),
            projected.touched.clone().into_buffer_arg(),
            offsets.before.into_buffer_arg(),
            visible.into_buffer_arg(),
            by_depth.keys.clone().into_buffer_arg(),
            owners.clone().into_buffer_arg(),
            by_depth.numbers.clone().into_buffer_arg(),
            spans.clone().into_buffer_arg(),
            self.view(),
            self.is_square(),
        );
        let by_tile = sort(gpu, by_depth, &offsets.total, pairs, bits_of(tiles + 1));
        let (sorted, slots) = (gpu.integers([pairs]), gpu.integers([pairs]));
        list_pairs::launch(
            &gpu.client,
            gpu.units(pairs),
            CUBE,
            owners.into_buffer_arg(),
            by_tile.numbers.into_buffer_arg(),
            sorted.clone().into_buffer_arg(),
            slots.clone().into_buffer_arg(),
            pairs as u32,
        );
        let starts = gpu.integers([tiles + 1]);
        find_starts::launch(
            &gpu.client,
            gpu.units(tiles + 1),
            CUBE,
            by_tile.keys.into_buffer_arg(),
            starts.clone().into_buffer_arg(),
            pairs as u32,
            tiles as u32,
        );
        Ok(Bins { sorted, starts, spans, slots })
    }

    /// The lists of a picture that shows nothing.
    fn no_bins(&self) -> Bins {
        let gpu = &self.gpu;
        Bins {
            sorted: gpu.integers([0]),
            starts: gpu.zeros([self.view.tile_count() + 1]),
            spans: gpu.zeros([self.count(), 2]),
            slots: gpu.integers([0]),
        }
    }

    fn blend(&self, projected: Projected, bins: Bins) -> SplatForward<CubeBackend> {
        let (gpu, tiles, view) = (&self.gpu, self.view.tile_count(), &self.view);
        let picture = gpu.floats([2, self.channels() + 1, view.height, view.width]);
        let (transmittance, last) = (gpu.floats([tiles, TILE_PIXELS]), gpu.integers([tiles, TILE_PIXELS]));
        let TilePlan { span, memory } = gpu.tile_plan();
        let share = memory.into_iter().find_map(|memory| TileShare::fitting(span, self.channels(), memory));
        let share = share.unwrap_or_else(|| self.refuse(memory));
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
        let TilePlan { span, memory } = gpu.tile_plan();
        let kind = memory
            .into_iter()
            .find_map(|memory| BlendBackwardKind::fitting(span, channels, statistic, memory))
            .unwrap_or_else(|| self.refuse(memory));
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

    /// For a device whose cubes share too little memory.
    fn refuse(&self, [_, memory]: [usize; 2]) -> ! {
        panic!(
            "{} blended channels do not fit into the {memory} bytes that units of this device share; take `--device cpu`",
            self.channels()
        )
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

/// Bits of the numbers below `count`.
fn bits_of(count: usize) -> usize {
    (usize::BITS - (count - 1).leading_zeros()) as usize
}

/// Whether buffers of `limit` bytes hold `bytes` for each of `pairs`, and tensors' indices count them. A number that 32
/// bits do not hold comes as their largest.
fn check_pairs(pairs: u32, bytes: u64, limit: u64) -> Result<(), SplatError> {
    let limit = limit.min(bytes * i32::MAX as u64);
    let bytes = bytes * u64::from(pairs);
    if bytes > limit { Err(SplatError::Buffer { tensor: "tile lists", bytes, limit }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_refused_beyond_the_buffer_and_beyond_the_index() {
        assert_eq!(check_pairs(1000, 48, 48_000), Ok(()));
        let refused = SplatError::Buffer { tensor: "tile lists", bytes: 48_048, limit: 48_000 };
        assert_eq!(check_pairs(1001, 48, 48_000), Err(refused));
        assert_eq!(check_pairs(i32::MAX as u32, 4, u64::MAX), Ok(()));
        assert!(check_pairs(u32::MAX, 4, u64::MAX).is_err());
    }
}
