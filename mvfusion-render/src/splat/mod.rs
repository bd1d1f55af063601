//! The differentiable Gaussian splat op: raw parameters and a camera in, a picture out.
//!
//! ```text
//! means, quaternions, log-scales, opacity logits, SH, features, background, camera
//!   ─► project ─► bin into tiles by depth ─► blend front to back ─► colour, features, alpha, depth
//! ```
//! The picture comes in two equal copies, so that two losses can be told apart in one backward pass: the gradients
//! of the parameters take both, the statistic that leaves through the probe takes `main` alone (METHOD §4.4, §4.7).

mod autodiff;
pub(crate) mod cpu;
mod diagnose;
mod error;
pub(crate) mod op;
mod settings;

use burn::backend::Dispatch;
use burn::tensor::{DType, Int, Tensor};
use mvfusion_data::Camera;
use mvfusion_kernels::sh::{MAX_DEGREE, coefficient_count};
use mvfusion_kernels::splat::{COLOUR_CHANNELS, PROJECTED_LEN};

pub use diagnose::{SplatDiagnosis, diagnose};
pub use error::SplatError;
pub use settings::{Antialias, ClampGradient, Extent, SplatRules, SplatSettings, Statistic, Stop, TangentClamp};

use crate::device::{blends, buffer_limit, takes};
use op::{SplatOps, SplatPlan, SplatPrimitives};

/// Raw parameters of `N` Gaussians, all of one dtype (`f32`, or `f64` on CPU backends) and on one device.
///
/// Activations happen inside the op: quaternions are normalised, scales are `exp`, opacities are logistic.
/// A Gaussian with a number that is not finite or with a zero quaternion is culled.
#[derive(Clone, Debug)]
pub struct SplatInputs {
    /// Centres in the world, `[N, 3]`.
    pub means: Tensor<2>,
    /// Rotations w, x, y, z of any length, `[N, 4]`.
    pub quaternions: Tensor<2>,
    /// Logarithms of the standard deviations along the axes, `[N, 3]`.
    pub log_scales: Tensor<2>,
    /// Opacities before the logistic function, `[N]`.
    pub opacity_logits: Tensor<1>,
    /// Coefficients of the colours, `[N, K, 3]`; `K` may be larger than the degree asks for.
    pub sh: Tensor<3>,
    /// Further channels to blend as they are, `[N, F]`.
    pub features: Option<Tensor<2>>,
    /// What shows where no Gaussian does, `[3 + F]`.
    pub background: Tensor<1>,
}

/// A rendered picture.
#[derive(Clone, Debug)]
pub struct SplatPicture {
    /// Two equal copies, `[2, 3 + F + 2, H, W]`: colour, features, alpha, depth.
    pub packed: Tensor<4>,
    /// Radius of each Gaussian in pixels, the larger of the two axes, `[N]`; 0 where it is culled.
    pub radii: Tensor<1, Int>,
}

/// The layers of one copy of a picture.
#[derive(Clone, Debug)]
pub struct SplatLayers {
    /// `[3, H, W]`, background included.
    pub colour: Tensor<3>,
    /// `[F, H, W]`, background included; `None` if there are no features.
    pub features: Option<Tensor<3>>,
    /// One minus the light that is left behind the last Gaussian, `[1, H, W]`.
    pub alpha: Tensor<3>,
    /// Sum of `alpha T z` with z in camera coordinates, `[1, H, W]`: not divided by alpha, without background.
    pub depth: Tensor<3>,
}

impl SplatPicture {
    /// The copy whose gradients feed the statistic.
    pub fn main(&self) -> SplatLayers {
        self.layers(0)
    }

    /// The copy whose gradients do not.
    pub fn light(&self) -> SplatLayers {
        self.layers(1)
    }

    fn layers(&self, copy: usize) -> SplatLayers {
        let [_, channels, height, width] = self.packed.dims();
        let copy: Tensor<3> = self.packed.clone().narrow(0, copy, 1).reshape([channels, height, width]);
        let planes = |begin: usize, end: usize| copy.clone().narrow(0, begin, end - begin);
        let features_end = channels - 2;
        SplatLayers {
            colour: planes(0, COLOUR_CHANNELS),
            features: (features_end > COLOUR_CHANNELS).then(|| planes(COLOUR_CHANNELS, features_end)),
            alpha: planes(channels - 2, channels - 1),
            depth: planes(channels - 1, channels),
        }
    }
}

/// Renders Gaussians (METHOD §8).
///
/// `probe` is a leaf with `require_grad`, of shape `[1, 2]`, or rows selected of one, `[N, 2]`: after the backward pass its
/// gradient is `[N, 2]`, that of the `main`
/// picture with respect to the projected centres, in normalised device coordinates (per pixel times half the picture's
/// width, height). Several calls with one probe add up. Which channels count is [`SplatSettings::statistic`].
///
/// # Errors
/// If shapes or dtypes do not fit together, the degree is above 3, the near plane lies behind the camera, the camera has no
/// pixels, or a GPU is handed more than it holds: features, or a picture, coefficients, projected Gaussians or tile lists
/// that are larger than its buffers.
pub fn splat(
    inputs: SplatInputs,
    probe: Option<Tensor<2>>,
    camera: &Camera,
    settings: &SplatSettings,
) -> Result<SplatPicture, SplatError> {
    let feature_count = check(&inputs, probe.as_ref(), camera, settings)?;
    let (device, dtype) = (inputs.means.device(), inputs.means.dtype());
    if let Some(limit) = buffer_limit(&device) {
        let [count, stored, _] = inputs.sh.dims();
        BufferSizes { count, stored, features: feature_count }.check(camera, limit)?;
    }
    if !blends(&device, COLOUR_CHANNELS + feature_count + 1) {
        return Err(SplatError::Features(feature_count));
    }
    let stand_in = |shape: [usize; 2]| Tensor::<2>::zeros(shape, (&device, dtype));
    let primitives = SplatPrimitives::<Dispatch> {
        features: inputs.features.filter(|_| feature_count > 0).unwrap_or_else(|| stand_in([1, 1])).into_dispatch(),
        probe: probe.unwrap_or_else(|| stand_in([1, 2])).into_dispatch(),
        means: inputs.means.into_dispatch(),
        quaternions: inputs.quaternions.into_dispatch(),
        log_scales: inputs.log_scales.into_dispatch(),
        opacity_logits: inputs.opacity_logits.into_dispatch(),
        sh: inputs.sh.into_dispatch(),
        background: inputs.background.into_dispatch(),
    };
    let plan = SplatPlan { camera: *camera, settings: *settings, feature_count };
    let output = <Dispatch as SplatOps>::splat(primitives, plan);
    if let Some(error) = output.refused {
        return Err(error);
    }
    Ok(SplatPicture { packed: Tensor::from_dispatch(output.picture), radii: Tensor::from_dispatch(output.radii) })
}

/// Checks the arguments, and returns the number of features.
fn check(
    inputs: &SplatInputs,
    probe: Option<&Tensor<2>>,
    camera: &Camera,
    settings: &SplatSettings,
) -> Result<usize, SplatError> {
    if settings.sh_degree > MAX_DEGREE {
        return Err(SplatError::Degree(settings.sh_degree));
    }
    let near = settings.rules.near;
    if near.is_nan() || near < 0.0 {
        return Err(SplatError::Near(near));
    }
    let (width, height) = (camera.width, camera.height);
    if width == 0 || height == 0 || width.saturating_mul(height) > i32::MAX as usize {
        return Err(SplatError::Size { width, height });
    }
    let count = inputs.means.dims()[0];
    let feature_count = inputs.features.as_ref().map_or(0, |features| features.dims()[1]);
    let dtype = match inputs.means.dtype() {
        dtype if takes(&inputs.means.device(), dtype) => dtype,
        found => return Err(SplatError::Dtype { argument: "means", found, expected: DType::F32 }),
    };
    check_tensor("means", &inputs.means, [count, 3], dtype)?;
    check_tensor("quaternions", &inputs.quaternions, [count, 4], dtype)?;
    check_tensor("log_scales", &inputs.log_scales, [count, 3], dtype)?;
    check_tensor("opacity_logits", &inputs.opacity_logits, [count], dtype)?;
    let (stored, needed) = (inputs.sh.dims()[1], coefficient_count(settings.sh_degree));
    check_tensor("sh", &inputs.sh, [count, stored.max(needed), COLOUR_CHANNELS], dtype)?;
    if let Some(features) = &inputs.features {
        check_tensor("features", features, [count, feature_count], dtype)?;
    }
    check_tensor("background", &inputs.background, [COLOUR_CHANNELS + feature_count], dtype)?;
    if let Some(probe) = probe {
        let rows = if probe.dims()[0] == 1 { 1 } else { count };
        check_tensor("probe", probe, [rows, 2], dtype)?;
    }
    Ok(feature_count)
}

/// What decides how large the largest tensors of known size are.
#[derive(Clone, Copy, Debug)]
struct BufferSizes {
    /// Gaussians.
    count: usize,
    /// Coefficients of a Gaussian.
    stored: usize,
    /// Features of a Gaussian.
    features: usize,
}

impl BufferSizes {
    /// Whether buffers of `limit` bytes hold them.
    fn check(self, camera: &Camera, limit: u64) -> Result<(), SplatError> {
        let Self { count, stored, features } = self;
        for (tensor, numbers) in [
            ("spherical harmonics", COLOUR_CHANNELS * stored * count),
            ("features", features * count),
            ("projected Gaussians", PROJECTED_LEN * count),
            ("picture with its copy", 2 * (COLOUR_CHANNELS + features + 2) * camera.width * camera.height),
        ] {
            let bytes = 4 * numbers as u64;
            if bytes > limit {
                return Err(SplatError::Buffer { tensor, bytes, limit });
            }
        }
        Ok(())
    }
}

fn check_tensor<const D: usize>(
    argument: &'static str,
    tensor: &Tensor<D>,
    expected: [usize; D],
    dtype: DType,
) -> Result<(), SplatError> {
    if tensor.dims() != expected {
        let (found, expected) = (tensor.dims().to_vec(), format!("{expected:?}"));
        return Err(SplatError::Shape { argument, found, expected });
    }
    if tensor.dtype() != dtype {
        return Err(SplatError::Dtype { argument, found: tensor.dtype(), expected: dtype });
    }
    Ok(())
}

#[cfg(test)]
mod tests;
