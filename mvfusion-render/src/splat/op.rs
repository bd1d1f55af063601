//! The splat op as a Burn backend extension: what a backend implements, and the CPU backends' implementation.

use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::{Backend, ExtensionType, TensorMetadata, backend_extension};
use mvfusion_data::Camera;
use mvfusion_kernels::splat::{PROJECTED_LEN, TILE_PIXELS};

use super::cpu::backward::{Saved, backward};
use super::cpu::cloud::Cloud;
use super::cpu::forward::forward;
use super::cpu::lanes::Lane;
use super::cpu::view::View;
use super::error::SplatError;
use super::settings::{SplatSettings, Statistic};
use crate::host::HostBackend;
use crate::real::with_real;

/// Arguments of the op that are no tensors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SplatPlan {
    pub camera: Camera,
    pub settings: SplatSettings,
    /// Extra features a Gaussian; with none, the tensor of the features is a stand-in of one number.
    pub feature_count: usize,
}

/// The tensors that go into the op, shaped as [`super::SplatInputs`].
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct SplatPrimitives<B: Backend> {
    pub means: FloatTensor<B>,
    pub quaternions: FloatTensor<B>,
    pub log_scales: FloatTensor<B>,
    pub opacity_logits: FloatTensor<B>,
    pub sh: FloatTensor<B>,
    pub features: FloatTensor<B>,
    pub background: FloatTensor<B>,
    /// `[1, 2]`; its value is not read.
    pub probe: FloatTensor<B>,
}

/// What the op gives.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct SplatOutput<B: Backend> {
    /// `[2, 3 + features + 2, height, width]`.
    pub picture: FloatTensor<B>,
    /// `[N]`.
    pub radii: IntTensor<B>,
    /// Why the device cannot hold the tile lists, whose length is known on the way only; the picture is an empty one
    /// then.
    pub refused: Option<SplatError>,
}

/// What the forward pass leaves for the backward pass. Plain tensors, so that every backend can fill them;
/// what they mean in detail is between a backend's forward and its backward.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct SplatSaved<B: Backend> {
    /// `[N, PROJECTED_LEN]`, rows of [`mvfusion_kernels::splat::Projected`].
    pub records: FloatTensor<B>,
    /// `[intersections]`, Gaussians by tile and depth.
    pub sorted: IntTensor<B>,
    /// `[tiles + 1]`, where each tile starts in `sorted`.
    pub starts: IntTensor<B>,
    /// `[N, 2]`, where each Gaussian's entries start in `slots`, and how many they are.
    pub spans: IntTensor<B>,
    /// `[intersections]`, places in `sorted` by Gaussian and tile.
    pub slots: IntTensor<B>,
    /// `[tiles, TILE_PIXELS]`, what light is left behind the last Gaussian.
    pub transmittance: FloatTensor<B>,
    /// `[tiles, TILE_PIXELS]`, one more than the place of the last Gaussian in the tile's list.
    pub last: IntTensor<B>,
}

/// The op with what it leaves for its backward pass.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct SplatForward<B: Backend> {
    #[extension_type]
    pub output: SplatOutput<B>,
    #[extension_type]
    pub saved: SplatSaved<B>,
}

/// Gradients of the op's tensors, shaped as [`SplatPrimitives`], but for the statistic.
#[derive(ExtensionType, Clone, Debug)]
pub(crate) struct SplatGradients<B: Backend> {
    pub means: FloatTensor<B>,
    pub quaternions: FloatTensor<B>,
    pub log_scales: FloatTensor<B>,
    pub opacity_logits: FloatTensor<B>,
    pub sh: FloatTensor<B>,
    pub features: FloatTensor<B>,
    pub background: FloatTensor<B>,
    /// `[N, 2]`, the probe's gradient.
    pub statistic: FloatTensor<B>,
}

/// The op, for plain backends and for `Autodiff`.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait SplatOps: Backend {
    /// Renders.
    fn splat(#[extension_type] inputs: SplatPrimitives<Self>, plan: SplatPlan) -> SplatOutput<Self>;
}

/// The two halves of the op that `Autodiff` puts together; for plain backends only.
pub(crate) trait SplatKernels: SplatOps {
    /// Renders, and keeps what the backward pass needs.
    fn splat_forward(inputs: SplatPrimitives<Self>, plan: SplatPlan) -> SplatForward<Self>;

    /// Pulls the cotangent of the packed picture back; `statistic` is what the probe counts, if there is one.
    fn splat_backward(
        inputs: SplatPrimitives<Self>,
        saved: SplatSaved<Self>,
        v_picture: FloatTensor<Self>,
        plan: SplatPlan,
        statistic: Option<Statistic>,
    ) -> SplatGradients<Self>;
}

impl<B: HostBackend> SplatOps for B {
    fn splat(inputs: SplatPrimitives<Self>, plan: SplatPlan) -> SplatOutput<Self> {
        Self::splat_forward(inputs, plan).output
    }
}

impl<B: HostBackend> SplatKernels for B {
    fn splat_forward(inputs: SplatPrimitives<Self>, plan: SplatPlan) -> SplatForward<Self> {
        with_real!(inputs.means.dtype(), T => forward_on_host::<B, T>(inputs, plan))
    }

    fn splat_backward(
        inputs: SplatPrimitives<Self>,
        saved: SplatSaved<Self>,
        v_picture: FloatTensor<Self>,
        plan: SplatPlan,
        statistic: Option<Statistic>,
    ) -> SplatGradients<Self> {
        with_real!(v_picture.dtype(), T => {
            backward_on_host::<B, T>(inputs, saved, &B::values::<T>(v_picture), plan, statistic)
        })
    }
}

/// The numbers of the inputs, held while the twin works on them.
struct HostCloud<B: HostBackend, T: Lane> {
    means: B::Values<T>,
    quaternions: B::Values<T>,
    log_scales: B::Values<T>,
    opacity_logits: B::Values<T>,
    sh: B::Values<T>,
    features: B::Values<T>,
    background: B::Values<T>,
    coefficients: usize,
    feature_count: usize,
}

impl<B: HostBackend, T: Lane> HostCloud<B, T> {
    fn new(inputs: SplatPrimitives<B>, plan: &SplatPlan) -> Self {
        Self {
            coefficients: inputs.sh.shape()[1],
            means: B::values(inputs.means),
            quaternions: B::values(inputs.quaternions),
            log_scales: B::values(inputs.log_scales),
            opacity_logits: B::values(inputs.opacity_logits),
            sh: B::values(inputs.sh),
            features: B::values(inputs.features),
            background: B::values(inputs.background),
            feature_count: plan.feature_count,
        }
    }

    fn cloud(&self) -> Cloud<'_, T> {
        Cloud {
            means: &self.means,
            quaternions: &self.quaternions,
            log_scales: &self.log_scales,
            opacity_logits: &self.opacity_logits,
            sh: &self.sh,
            features: if self.feature_count == 0 { &[] } else { &self.features },
            background: &self.background,
            coefficients: self.coefficients,
            feature_count: self.feature_count,
        }
    }
}

fn forward_on_host<B: HostBackend, T: Lane>(inputs: SplatPrimitives<B>, plan: SplatPlan) -> SplatForward<B> {
    let host = HostCloud::<B, T>::new(inputs, &plan);
    let (cloud, view) = (host.cloud(), View::new(&plan.camera, &plan.settings));
    let result = forward::<T, ()>(&cloud, &view);
    let (count, tiles, pairs) = (cloud.len(), view.tile_count(), result.bins.sorted.len());
    SplatForward {
        output: SplatOutput {
            picture: B::tensor(result.picture, [2, cloud.channels() + 1, view.height, view.width]),
            radii: B::index_tensor(result.radii, [count]),
            refused: None,
        },
        saved: SplatSaved {
            records: B::tensor(result.projections.records, [count, PROJECTED_LEN]),
            sorted: B::index_tensor(result.bins.sorted, [pairs]),
            starts: B::index_tensor(result.bins.starts, [tiles + 1]),
            spans: B::index_tensor(result.bins.spans, [count, 2]),
            slots: B::index_tensor(result.bins.slots, [pairs]),
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
) -> SplatGradients<B> {
    let host = HostCloud::<B, T>::new(inputs, &plan);
    let (cloud, view) = (host.cloud(), View::new(&plan.camera, &plan.settings));
    let (records, transmittance) = (B::values::<T>(saved.records), B::values::<T>(saved.transmittance));
    let (sorted, starts) = (B::indices(saved.sorted), B::indices(saved.starts));
    let (spans, slots, last) = (B::indices(saved.spans), B::indices(saved.slots), B::indices(saved.last));
    let saved = Saved {
        records: &records,
        sorted: &sorted,
        starts: &starts,
        spans: &spans,
        slots: &slots,
        transmittance: &transmittance,
        last: &last,
    };
    let result = backward(&cloud, &view, saved, v_picture, statistic);
    let (count, gradients) = (cloud.len(), result.cloud);
    SplatGradients {
        means: B::tensor(gradients.means, [count, 3]),
        quaternions: B::tensor(gradients.quaternions, [count, 4]),
        log_scales: B::tensor(gradients.log_scales, [count, 3]),
        opacity_logits: B::tensor(gradients.opacity_logits, [count]),
        sh: B::tensor(gradients.sh, [count, cloud.coefficients, 3]),
        features: B::tensor(gradients.features, [count, cloud.feature_count]),
        background: B::tensor(result.background, [cloud.background.len()]),
        statistic: B::tensor(gradients.statistic, [count, 2]),
    }
}
