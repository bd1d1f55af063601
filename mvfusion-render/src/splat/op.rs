//! The splat op as a Burn backend extension: the traits, and their implementation for the CPU backends.

use std::any::Any;
use std::sync::Arc;

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{
    Backend, BackendTensor, Dispatch, DispatchAutodiffContext, DispatchTensor, DispatchTensorKind, ExtensionType,
    TensorMetadata, backend_extension,
};
use mvfusion_data::Camera;
use mvfusion_kernels::splat::{PROJECTED_LEN, TILE_PIXELS, plane_count};

use super::cpu::backward::{Saved, backward};
use super::cpu::cloud::Cloud;
use super::cpu::forward::forward;
use super::cpu::lanes::Lane;
use super::cpu::view::View;
use super::error::SplatError;
use super::settings::{SplatSettings, Statistic};
use super::tensors::{SplatSizes, SplatTensors};
#[cfg(feature = "cube")]
use crate::cube::batch::Batch;
use crate::host::HostBackend;
use crate::real::with_real;

/// Arguments of the op that are not tensors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplatPlan {
    pub camera: Camera,
    pub settings: SplatSettings,
    pub sizes: SplatSizes,
}

/// The input tensors of the op on a backend, or their gradients.
pub(crate) type SplatPrimitives<B> = SplatTensors<FloatTensor<B>>;

// Implemented by hand, because the derive recognises tensors by their field types and here the type is `T`.
impl<B: Backend> ExtensionType<B> for SplatPrimitives<B> {
    type Target = SplatPrimitives<Dispatch>;

    fn map_to_dispatch<F>(self, map_kind: F, autodiff: DispatchAutodiffContext) -> Self::Target
    where
        F: Fn(BackendTensor<B>) -> DispatchTensorKind,
    {
        self.map(|tensor| DispatchTensor { kind: map_kind(BackendTensor::Float(tensor)), autodiff })
    }

    fn map_from_dispatch<F>(target: Self::Target, unwrap_kind: F) -> Self
    where
        F: Fn(DispatchTensor) -> BackendTensor<B>,
    {
        target.map(|tensor| unwrap_kind(tensor).float())
    }

    fn routing_tensor(target: &Self::Target) -> Option<&DispatchTensor> {
        Some(&target.means)
    }

    fn routing_float_tensor(target: &Self::Target) -> Option<&DispatchTensor> {
        Some(&target.means)
    }

    fn autodiff_context(target: &Self::Target) -> DispatchAutodiffContext {
        let contexts = target.each_ref().map(|tensor| tensor.autodiff).into_array();
        contexts.into_iter().fold(DispatchAutodiffContext::Disabled, DispatchAutodiffContext::merge)
    }
}

/// What frames that are rendered together share.
#[derive(Clone, Debug, Default)]
pub(crate) struct SplatBatch {
    /// A GPU makes their tile lists at once.
    #[cfg(feature = "cube")]
    pub frames: Arc<Batch>,
}

impl SplatBatch {
    /// Called when all frames are prepared.
    pub fn start(&self) {
        #[cfg(feature = "cube")]
        self.frames.start();
    }
}

/// What a backend keeps of a frame from its preparation to its rendering. A CPU keeps nothing.
#[derive(Clone, Default)]
pub(crate) struct Prepared(
    #[cfg_attr(not(feature = "cube"), allow(dead_code, reason = "only GPUs keep something"))]
    Option<Arc<dyn Any + Send + Sync>>,
);

#[cfg(feature = "cube")]
impl Prepared {
    pub fn new(frame: impl Any + Send + Sync) -> Self {
        Self(Some(Arc::new(frame)))
    }

    pub fn of<T: Any>(&self) -> Option<&T> {
        self.0.as_ref()?.downcast_ref()
    }
}

/// The output of the op.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct SplatOutput<B: Backend> {
    /// `[2, 3 + features + 2, height, width]`.
    pub picture: FloatTensor<B>,
    /// `[N]`.
    pub radii: IntTensor<B>,
    /// The error if the tile lists do not fit on the device, or an index cannot count their pairs; the image is then
    /// empty. Their length is known only during the call.
    pub refused: Option<SplatError>,
}

/// The state that the forward pass saves for the backward pass. It consists of plain tensors, so that every backend can
/// fill them. Their details may differ between backends.
#[derive(Clone, Debug)]
pub(crate) struct SplatSaved<B: Backend> {
    /// `[N, PROJECTED_LEN]`, rows of [`mvfusion_kernels::splat::Projected`].
    pub records: FloatTensor<B>,
    /// `[intersections]`, Gaussians by tile and depth.
    pub sorted: IntTensor<B>,
    /// `[tiles + 1]`, start of each tile in `sorted`.
    pub starts: IntTensor<B>,
    /// `[2 N + intersections]`: start and number of each Gaussian's positions, then the positions in `sorted`, by Gaussian
    /// and tile. One buffer, because a GPU binds few.
    pub slots: IntTensor<B>,
    /// `[tiles, TILE_PIXELS]`, transmittance behind the last Gaussian.
    pub transmittance: FloatTensor<B>,
    /// `[tiles, TILE_PIXELS]`, one plus the position of the last Gaussian in the tile's list.
    pub last: IntTensor<B>,
}

/// The output with the state for the backward pass.
#[derive(Clone, Debug)]
pub(crate) struct SplatForward<B: Backend> {
    pub output: SplatOutput<B>,
    pub saved: SplatSaved<B>,
}

/// The op, with and without autodiff.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait SplatOps: Backend {
    /// Starts what is needed of a frame before the lengths of its lists are known.
    fn prepare(#[extension_type] inputs: SplatPrimitives<Self>, plan: SplatPlan, batch: SplatBatch) -> Prepared;

    /// Renders what was prepared with the same arguments.
    fn splat(#[extension_type] inputs: SplatPrimitives<Self>, plan: SplatPlan, prepared: Prepared)
    -> SplatOutput<Self>;
}

/// The two passes of the op, which `Autodiff` combines; only on backends without autodiff.
pub(crate) trait SplatKernels: SplatOps {
    /// Renders, and saves the state for the backward pass.
    fn splat_forward(inputs: SplatPrimitives<Self>, plan: SplatPlan, prepared: Prepared) -> SplatForward<Self>;

    /// Backpropagates the cotangent of the packed image to the inputs. The gradient of the probe, `[N, 2]`, is the
    /// statistic. If there is a probe, `statistic` selects its channels.
    fn splat_backward(
        inputs: SplatPrimitives<Self>,
        saved: SplatSaved<Self>,
        v_picture: FloatTensor<Self>,
        plan: SplatPlan,
        statistic: Option<Statistic>,
    ) -> SplatPrimitives<Self>;
}

impl<B: HostBackend> SplatOps for B {
    fn prepare(_: SplatPrimitives<Self>, _: SplatPlan, _: SplatBatch) -> Prepared {
        Prepared::default()
    }

    fn splat(inputs: SplatPrimitives<Self>, plan: SplatPlan, prepared: Prepared) -> SplatOutput<Self> {
        Self::splat_forward(inputs, plan, prepared).output
    }
}

impl<B: HostBackend> SplatKernels for B {
    fn splat_forward(inputs: SplatPrimitives<Self>, plan: SplatPlan, _: Prepared) -> SplatForward<Self> {
        with_real!(inputs.means.dtype(), T => forward_on_host::<B, T>(inputs, plan))
    }

    fn splat_backward(
        inputs: SplatPrimitives<Self>,
        saved: SplatSaved<Self>,
        v_picture: FloatTensor<Self>,
        plan: SplatPlan,
        statistic: Option<Statistic>,
    ) -> SplatPrimitives<Self> {
        with_real!(v_picture.dtype(), T => {
            backward_on_host::<B, T>(inputs, saved, &B::values::<T>(v_picture), plan, statistic)
        })
    }
}

fn forward_on_host<B: HostBackend, T: Lane>(inputs: SplatPrimitives<B>, plan: SplatPlan) -> SplatForward<B> {
    let values = inputs.map(B::values::<T>);
    let cloud = Cloud { values: values.each_ref().map(|values| &**values), sizes: plan.sizes };
    let view = View::new(&plan.camera, &plan.settings);
    let result = forward::<T, ()>(&cloud, &view);
    let (count, tiles, pairs) = (cloud.len(), view.tile_count(), result.bins.sorted.len());
    SplatForward {
        output: SplatOutput {
            picture: B::tensor(result.picture, [2, plane_count(cloud.channels()), view.height, view.width]),
            radii: B::index_tensor(result.radii, [count]),
            refused: result.refused,
        },
        saved: SplatSaved {
            records: B::tensor(result.projections.records, [count, PROJECTED_LEN]),
            sorted: B::index_tensor(result.bins.sorted, [pairs]),
            starts: B::index_tensor(result.bins.starts, [tiles + 1]),
            slots: B::index_tensor(result.bins.slots, [2 * count + pairs]),
            transmittance: B::tensor(
                result.blended.transmittance.into_flattened().into_flattened(),
                [tiles, TILE_PIXELS],
            ),
            last: B::index_tensor(result.blended.last.into_flattened().into_flattened(), [tiles, TILE_PIXELS]),
        },
    }
}

fn backward_on_host<B: HostBackend, T: Lane>(
    inputs: SplatPrimitives<B>,
    saved: SplatSaved<B>,
    v_picture: &[T],
    plan: SplatPlan,
    statistic: Option<Statistic>,
) -> SplatPrimitives<B> {
    let values = inputs.map(B::values::<T>);
    let cloud = Cloud { values: values.each_ref().map(|values| &**values), sizes: plan.sizes };
    let view = View::new(&plan.camera, &plan.settings);
    let (records, transmittance) = (B::values::<T>(saved.records), B::values::<T>(saved.transmittance));
    let (sorted, starts) = (B::indices(saved.sorted), B::indices(saved.starts));
    let (slots, last) = (B::indices(saved.slots), B::indices(saved.last));
    let saved = Saved {
        records: &records,
        sorted: &sorted,
        starts: &starts,
        slots: &slots,
        transmittance: &transmittance,
        last: &last,
    };
    let gradients = backward(&cloud, &view, saved, v_picture, statistic);
    gradients.zip(plan.sizes.shapes()).map(|(numbers, shape)| B::tensor(numbers, shape))
}
