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
pub(crate) mod tensors;

use burn::backend::{Dispatch, DispatchTensor, TensorMetadata};
use burn::tensor::{DType, Int, Tensor};
use mvfusion_data::Camera;
use mvfusion_kernels::sh::{MAX_DEGREE, coefficient_count};
use mvfusion_kernels::splat::{COLOUR_CHANNELS, PROJECTED_LEN, alpha_plane, plane_count};

pub use diagnose::{SplatDiagnosis, diagnose};
pub use error::SplatError;
pub use settings::{Antialias, ClampGradient, Extent, SplatRules, SplatSettings, Statistic, Stop, TangentClamp};

use crate::device::{blends, buffer_limit, takes};
use op::{SplatOps, SplatPlan};
use tensors::{SplatSizes, SplatTensors};

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
pub struct SplatPlanes {
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
    pub fn main(&self) -> SplatPlanes {
        self.layers(0)
    }

    /// The copy whose gradients do not.
    pub fn light(&self) -> SplatPlanes {
        self.layers(1)
    }

    fn layers(&self, copy: usize) -> SplatPlanes {
        let [_, count, height, width] = self.packed.dims();
        let copy: Tensor<3> = self.packed.clone().narrow(0, copy, 1).reshape([count, height, width]);
        let planes = |begin: usize, end: usize| copy.clone().narrow(0, begin, end - begin);
        // All planes but alpha's are blended channels.
        let alpha = alpha_plane(count - 1);
        SplatPlanes {
            colour: planes(0, COLOUR_CHANNELS),
            features: (alpha > COLOUR_CHANNELS).then(|| planes(COLOUR_CHANNELS, alpha)),
            alpha: planes(alpha, alpha + 1),
            depth: planes(alpha + 1, count),
        }
    }
}

/// Renders Gaussians (METHOD §8).
///
/// `probe` is a leaf with `require_grad`, of shape `[1, 2]`, or rows selected of one, `[N, 2]`: after the backward pass its
/// gradient is `[N, 2]`, that of the `main` picture with respect to the projected centres, in normalised device coordinates
/// (per pixel times half the picture's width, height). Several calls with one probe add up. Which channels count is [`SplatSettings::statistic`].
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
    let (device, dtype) = (inputs.means.device(), inputs.means.dtype());
    let (tensors, sizes) = check(inputs, probe, camera, settings)?;
    if let Some(limit) = buffer_limit(&device) {
        check_buffers(sizes, camera, limit)?;
    }
    if !blends(&device, sizes.channels()) {
        return Err(SplatError::Features(sizes.features));
    }
    // A missing tensor gets a stand-in, and so do features without channels, because no device binds an empty buffer.
    let tensors = SplatTensors { features: tensors.features.filter(|_| sizes.features > 0), ..tensors };
    let stand_in = || Tensor::<2>::zeros([1, 2], (&device, dtype)).into_dispatch();
    let primitives = tensors.map(|tensor| tensor.unwrap_or_else(stand_in));
    let plan = SplatPlan { camera: *camera, settings: *settings, sizes };
    let output = <Dispatch as SplatOps>::splat(primitives, plan);
    if let Some(error) = output.refused {
        return Err(error);
    }
    Ok(SplatPicture { packed: Tensor::from_dispatch(output.picture), radii: Tensor::from_dispatch(output.radii) })
}

/// Checks the arguments. Returns the tensors, of which `features` and `probe` may be missing, and their sizes.
fn check(
    inputs: SplatInputs,
    probe: Option<Tensor<2>>,
    camera: &Camera,
    settings: &SplatSettings,
) -> Result<(SplatTensors<Option<DispatchTensor>>, SplatSizes), SplatError> {
    check_picture(camera, settings)?;
    let dtype = match inputs.means.dtype() {
        dtype if takes(&inputs.means.device(), dtype) => dtype,
        found => return Err(SplatError::Dtype { argument: "means", found, expected: DType::F32 }),
    };
    let sizes = SplatSizes {
        count: inputs.means.dims()[0],
        coefficients: inputs.sh.dims()[1].max(coefficient_count(settings.sh_degree)),
        features: inputs.features.as_ref().map_or(0, |features| features.dims()[1]),
    };
    let mut shapes = sizes.shapes();
    if probe.as_ref().is_some_and(|probe| probe.dims()[0] == 1) {
        shapes.probe[0] = 1;
    }
    let tensors = SplatTensors {
        means: Some(inputs.means.into_dispatch()),
        quaternions: Some(inputs.quaternions.into_dispatch()),
        log_scales: Some(inputs.log_scales.into_dispatch()),
        opacity_logits: Some(inputs.opacity_logits.into_dispatch()),
        sh: Some(inputs.sh.into_dispatch()),
        features: inputs.features.map(Tensor::into_dispatch),
        background: Some(inputs.background.into_dispatch()),
        probe: probe.map(Tensor::into_dispatch),
    };
    for ((argument, tensor), shape) in SplatTensors::NAMES.zip(tensors.each_ref()).zip(shapes).into_array() {
        if let Some(tensor) = tensor {
            check_tensor(argument, tensor, &shape, dtype)?;
        }
    }
    Ok((tensors, sizes))
}

/// Checks the settings and the size of the picture.
fn check_picture(camera: &Camera, settings: &SplatSettings) -> Result<(), SplatError> {
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
    Ok(())
}

fn check_tensor(
    argument: &'static str,
    tensor: &DispatchTensor,
    expected: &[usize],
    dtype: DType,
) -> Result<(), SplatError> {
    let shape = tensor.shape();
    if shape[..] != *expected {
        return Err(SplatError::Shape { argument, found: shape.to_vec(), expected: format!("{expected:?}") });
    }
    if tensor.dtype() != dtype {
        return Err(SplatError::Dtype { argument, found: tensor.dtype(), expected: dtype });
    }
    Ok(())
}

/// Whether buffers of `limit` bytes hold the largest tensors of known size.
fn check_buffers(sizes: SplatSizes, camera: &Camera, limit: u64) -> Result<(), SplatError> {
    let SplatSizes { count, coefficients, features } = sizes;
    for (tensor, numbers) in [
        ("spherical harmonics", COLOUR_CHANNELS * coefficients * count),
        ("features", features * count),
        ("projected Gaussians", PROJECTED_LEN * count),
        ("picture with its copy", 2 * plane_count(sizes.channels()) * camera.width * camera.height),
    ] {
        let bytes = 4 * numbers as u64;
        if bytes > limit {
            return Err(SplatError::Buffer { tensor, bytes, limit });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests;
