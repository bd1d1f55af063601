//! The splat op: projection, sorting, blending, and their gradients. CPU twin: `splat/cpu/forward.rs` and
//! `backward.rs`.

use std::sync::Arc;

use burn::backend::TensorMetadata;
use burn::backend::tensor::FloatTensor;
use burn_cubecl::CubeBackend;
use burn_cubecl::tensor::CubeTensor;
use cubecl::CubeDim;
use cubecl::prelude::BufferArg;
use mvfusion_kernels::cube::backward_kind::{
    BlendBackwardKind, CountedChannels, record_bytes, record_numbers, record_vectors,
};
use mvfusion_kernels::cube::blend::blend;
use mvfusion_kernels::cube::blend_backward::blend_backward;
use mvfusion_kernels::cube::project::project;
use mvfusion_kernels::cube::project_backward::project_backward;
use mvfusion_kernels::cube::records::{PIECE, piece_count, sum_pieces};
use mvfusion_kernels::cube::stage::TileShare;
use mvfusion_kernels::splat::{PROJECTED_LEN, TILE_PIXELS, background_channels, plane_count};

use super::batch::Batch;
use super::bins::{Bins, PAIR_BYTES};
use super::frame::{Frame, Projected, ProjectedFrame};
use super::gpu::{CUBE, Flat, single};
use super::shared_memory::fitting;
use crate::splat::Statistic;
use crate::splat::op::{
    Prepared, SplatBatch, SplatForward, SplatKernels, SplatOps, SplatOutput, SplatPlan, SplatPrimitives, SplatSaved,
};
use crate::splat::tensors::SplatTensors;

/// What a frame keeps from its projection to its rendering.
struct PreparedFrame {
    own: Arc<ProjectedFrame>,
    batch: Arc<Batch>,
    /// Its index in the batch.
    index: usize,
}

impl SplatOps for CubeBackend {
    fn prepare(inputs: SplatPrimitives<Self>, plan: SplatPlan, batch: SplatBatch) -> Prepared {
        let frame = Frame::new(inputs, &plan);
        if frame.count() == 0 {
            return Prepared::default();
        }
        let projected = frame.project();
        let own = Arc::new(ProjectedFrame { frame, projected });
        let (batch, index) = (batch.frames.clone(), batch.frames.add(own.clone()));
        Prepared::new(PreparedFrame { own, batch, index })
    }

    fn splat(inputs: SplatPrimitives<Self>, plan: SplatPlan, prepared: Prepared) -> SplatOutput<Self> {
        forward(inputs, &plan, &prepared, PAIR_BYTES).output
    }
}

impl SplatKernels for CubeBackend {
    fn splat_forward(inputs: SplatPrimitives<Self>, plan: SplatPlan, prepared: Prepared) -> SplatForward<Self> {
        // Each piece of records has one of its own.
        let record = record_bytes(plan.sizes.channels()) as u64;
        forward(inputs, &plan, &prepared, PAIR_BYTES.max(record + record.div_ceil(PIECE as u64)))
    }

    fn splat_backward(
        inputs: SplatPrimitives<Self>,
        saved: SplatSaved<Self>,
        v_picture: FloatTensor<Self>,
        plan: SplatPlan,
        statistic: Option<Statistic>,
    ) -> SplatPrimitives<Self> {
        let frame = Frame::new(inputs, &plan);
        let (gradients, background) = frame.blend_backward(&saved, single(v_picture), statistic);
        frame.project_backward(&saved, gradients, background)
    }
}

/// Renders. The largest buffer will have `pair_bytes` per pair of a Gaussian and a tile.
fn forward(
    inputs: SplatPrimitives<CubeBackend>,
    plan: &SplatPlan,
    prepared: &Prepared,
    pair_bytes: u64,
) -> SplatForward<CubeBackend> {
    let empty;
    let (frame, projected, bins) = match prepared.of::<PreparedFrame>() {
        Some(PreparedFrame { own, batch, index }) => {
            (&own.frame, own.projected.clone(), batch.take_lists(own, *index, pair_bytes))
        }
        // Nothing is prepared of no Gaussians.
        None => {
            empty = Frame::new(inputs, plan);
            assert_eq!(empty.count(), 0, "a frame with Gaussians is prepared before it is rendered");
            (&empty, empty.project(), Ok(empty.no_bins()))
        }
    };
    let (bins, refused) = match bins {
        Ok(bins) => (bins, None),
        Err(error) => (frame.no_bins(), Some(error)),
    };
    let mut forward = frame.blend(projected, bins);
    forward.output.refused = refused;
    forward
}

impl Frame {
    fn project(&self) -> Projected {
        let (gpu, count) = (&self.gpu, self.count());
        let projected = Projected {
            records: gpu.floats([count, PROJECTED_LEN]),
            radii: gpu.integers([count, 2]),
            largest: gpu.integers([count]),
            touched: gpu.naturals(count),
        };
        if count > 0 {
            let inputs = arguments(&self.tensors);
            project::launch(
                &gpu.client,
                gpu.units(count),
                CUBE,
                inputs.means,
                inputs.quaternions,
                inputs.log_scales,
                inputs.opacity_logits,
                inputs.sh,
                inputs.features,
                projected.records.clone().flat(),
                projected.radii.clone().flat(),
                projected.largest.clone().flat(),
                projected.touched.clone().flat(),
                self.view(),
                count as u32,
                self.sizes.coefficients as u32,
                self.sizes.features as u32,
                self.kind(),
            );
        }
        projected
    }

    fn blend(&self, projected: Projected, bins: Bins) -> SplatForward<CubeBackend> {
        let (gpu, tiles, view) = (&self.gpu, self.view.tile_count(), &self.view);
        let picture = gpu.floats([2, plane_count(self.channels()), view.height, view.width]);
        let (transmittance, last) = (gpu.floats([tiles, TILE_PIXELS]), gpu.integers([tiles, TILE_PIXELS]));
        // Proof: `splat` checked that the backward pass fits, which needs more memory.
        let share = fitting(gpu.tile_plan(), |span, memory| TileShare::fitting(span, self.channels(), memory))
            .expect("the channels fit");
        let inputs = arguments(&self.tensors);
        // SAFETY: the kernel's indices are within its arguments. Tiles, pixels and channels follow from the sizes of
        // the tensors allocated here, positions in the lists from `starts`. The lists contain projected Gaussians, and
        // the loops end with the lists.
        unsafe {
            blend::launch_unchecked(
                &gpu.client,
                gpu.cubes(tiles),
                CubeDim::new_1d(share.units() as u32),
                projected.records.clone().flat(),
                inputs.features,
                inputs.background,
                bins.sorted.clone().flat(),
                bins.starts.clone().flat(),
                picture.clone().flat(),
                transmittance.clone().flat(),
                last.clone().flat(),
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
                slots: bins.slots,
                transmittance,
                last,
            },
        }
    }

    /// The gradient records of the tile lists, and each tile's part of the background's gradient.
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
        // Proof: `splat` checked that it fits.
        let kind =
            fitting(gpu.tile_plan(), |span, memory| BlendBackwardKind::fitting(span, channels, statistic, memory))
                .expect("the channels fit");
        let pairs = saved.sorted.shape()[0];
        // At least one row: the kernel reads and writes whole vectors, so it needs a buffer of at least one.
        let gradients = gpu.floats([(pairs + piece_count(pairs)).max(1), record_numbers(channels)]);
        let background = gpu.floats([tiles, background_channels(channels)]);
        let inputs = arguments(&self.tensors);
        // SAFETY: as in the forward pass; the gradients have a row for each entry of the lists.
        unsafe {
            blend_backward::launch_unchecked(
                &gpu.client,
                gpu.cubes(tiles),
                CubeDim::new_1d(kind.share.units() as u32),
                saved.records.clone().flat(),
                inputs.features,
                inputs.background,
                saved.sorted.clone().flat(),
                saved.starts.clone().flat(),
                saved.transmittance.clone().flat(),
                saved.last.clone().flat(),
                v_picture.flat(),
                gradients.clone().flat(),
                background.clone().flat(),
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
    ) -> SplatPrimitives<CubeBackend> {
        let (gpu, count) = (&self.gpu, self.count());
        let room = self.sizes.shapes().map(|shape| gpu.floats(shape));
        let result = SplatTensors { background: gpu.sum_rows(background), ..room };
        if count > 0 {
            let (pairs, head) = (saved.sorted.shape()[0], 2 * count);
            let is_pieced = gpu.sums_pieces();
            let pieces = piece_count(pairs);
            if is_pieced && pieces > 0 {
                let vectors = record_vectors(self.channels());
                // SAFETY: excess units do nothing; `slots` has a position for each pair behind its head, and `gradients` a
                // row for each pair and piece.
                unsafe {
                    sum_pieces::launch_unchecked(
                        &gpu.client,
                        gpu.units(pieces * vectors),
                        CUBE,
                        saved.slots.clone().flat(),
                        gradients.clone().flat(),
                        head as u32,
                        pairs as u32,
                        self.channels(),
                    );
                }
            }
            let (inputs, outputs) = (arguments(&self.tensors), arguments(&result));
            // SAFETY: excess units do nothing, and the others read and write their own rows; `slots` refers to rows
            // of `gradients`.
            unsafe {
                project_backward::launch_unchecked(
                    &gpu.client,
                    gpu.units(count),
                    CUBE,
                    inputs.means,
                    inputs.quaternions,
                    inputs.log_scales,
                    inputs.opacity_logits,
                    inputs.sh,
                    saved.records.clone().flat(),
                    saved.slots.clone().flat(),
                    gradients.flat(),
                    outputs.means,
                    outputs.quaternions,
                    outputs.log_scales,
                    outputs.opacity_logits,
                    outputs.sh,
                    outputs.features,
                    outputs.probe,
                    self.view(),
                    count as u32,
                    pairs as u32,
                    self.sizes.coefficients as u32,
                    is_pieced,
                    self.channels(),
                    self.kind(),
                );
            }
        }
        result
    }
}

/// The tensors as kernel arguments.
fn arguments(tensors: &SplatTensors<CubeTensor>) -> SplatTensors<BufferArg> {
    tensors.each_ref().map(|tensor| tensor.clone().flat())
}
