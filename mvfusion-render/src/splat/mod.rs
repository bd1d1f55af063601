//! The differentiable Gaussian splat op: from raw parameters and a camera to an image.
//!
//! ```text
//! means, quaternions, log-scales, opacity logits, SH, features, background, camera
//!   ─► project ─► bin into tiles by depth ─► blend front to back ─► colour, features, alpha, depth
//! ```
//! The image is returned in two equal copies, so that one backward pass can separate two losses. The gradients of the
//! parameters include both. The statistic, which is the gradient of the probe, includes only `main` (METHOD §4.4,
//! §4.7).

mod autodiff;
pub(crate) mod cpu;
mod diagnose;
mod error;
pub(crate) mod op;
mod settings;
pub(crate) mod tensors;

use burn::backend::{Dispatch, DispatchDevice, DispatchTensor, TensorMetadata};
use burn::tensor::{DType, Int, Tensor};
use mvfusion_data::Camera;
use mvfusion_kernels::sh::{MAX_DEGREE, coefficient_count};
use mvfusion_kernels::splat::{COLOUR_CHANNELS, PROJECTED_LEN, alpha_plane, plane_count};

pub use diagnose::{SplatDiagnosis, diagnose};
pub use error::SplatError;
pub use settings::{Antialias, ClampGradient, Extent, SplatRules, SplatSettings, Statistic, Stop, TangentClamp};

use crate::device::{blends, buffer_limit, takes};
use op::{SplatBatch, SplatOps, SplatPlan};
use tensors::{SplatSizes, SplatTensors};

/// Raw parameters of `N` Gaussians, all with the same dtype (`f32`, or `f64` on CPU backends) and on the same device.
///
/// The op applies the activations: it normalises quaternions, takes `exp` of the scales and the sigmoid of the
/// opacities. A Gaussian with a non-finite value is culled; only a log-scale of minus infinity counts as a scale of zero.
#[derive(Clone, Debug)]
pub struct SplatInputs {
    /// Centres in world coordinates, `[N, 3]`.
    pub means: Tensor<2>,
    /// Rotations w, x, y, z, `[N, 4]`. A norm below 1e-12, or one whose square overflows, culls the Gaussian.
    pub quaternions: Tensor<2>,
    /// Logarithms of the standard deviations along the axes, `[N, 3]`.
    pub log_scales: Tensor<2>,
    /// Opacities before the sigmoid, `[N]`.
    pub opacity_logits: Tensor<1>,
    /// SH coefficients of the colours, `[N, K, 3]`; `K` may be larger than the degree needs.
    pub sh: Tensor<3>,
    /// Extra channels to blend unchanged, `[N, F]`.
    pub features: Option<Tensor<2>>,
    /// Background, `[3 + F]`.
    pub background: Tensor<1>,
}

/// A rendered image.
#[derive(Clone, Debug)]
pub struct SplatPicture {
    /// Two equal copies, `[2, 3 + F + 2, H, W]`, in the dtype of the inputs: colour, features, alpha, depth.
    pub packed: Tensor<4>,
    /// Radius of each Gaussian in pixels, the larger of the two axes, `[N]`, as i32; 0 where it is culled. A Gaussian
    /// that is too transparent to be drawn has a radius.
    pub radii: Tensor<1, Int>,
}

/// The layers of one copy of an image.
#[derive(Clone, Debug)]
pub struct SplatPlanes {
    /// `[3, H, W]`, background included.
    pub colour: Tensor<3>,
    /// `[F, H, W]`, background included; `None` if there are no features.
    pub features: Option<Tensor<3>>,
    /// One minus the transmittance behind the last Gaussian, `[1, H, W]`.
    pub alpha: Tensor<3>,
    /// Sum of `alpha T z` with z in camera coordinates, `[1, H, W]`: not divided by alpha, without background.
    pub depth: Tensor<3>,
}

impl SplatPicture {
    /// The copy whose gradients enter the statistic.
    pub fn main(&self) -> SplatPlanes {
        self.layers(0)
    }

    /// The copy whose gradients do not enter the statistic.
    pub fn light(&self) -> SplatPlanes {
        self.layers(1)
    }

    fn layers(&self, copy: usize) -> SplatPlanes {
        let [_, count, height, width] = self.packed.dims();
        let copy: Tensor<3> = self.packed.clone().narrow(0, copy, 1).reshape([count, height, width]);
        let planes = |begin: usize, end: usize| copy.clone().narrow(0, begin, end - begin);
        // All planes except alpha are blended channels.
        let alpha = alpha_plane(count - 1);
        SplatPlanes {
            colour: planes(0, COLOUR_CHANNELS),
            features: (alpha > COLOUR_CHANNELS).then(|| planes(COLOUR_CHANNELS, alpha)),
            alpha: planes(alpha, alpha + 1),
            depth: planes(alpha + 1, count),
        }
    }
}

/// An image to render.
#[derive(Clone, Debug)]
pub struct SplatFrame {
    /// The Gaussians.
    pub inputs: SplatInputs,
    /// A leaf with `require_grad` of shape `[1, 2]`, or rows selected from one, `[N, 2]`. After the backward pass, it has
    /// the gradient `[N, 2]` of the `main` image with respect to the projected centres. The unit is normalised device
    /// coordinates: the gradient per pixel times half the image's width and height. Several frames with one probe add
    /// up; a leaf `[1, 2]` needs the same N in all of them. [`SplatSettings::statistic`] selects the channels.
    pub probe: Option<Tensor<2>>,
    /// The camera.
    pub camera: Camera,
    /// The rules.
    pub settings: SplatSettings,
}

/// The real spherical harmonics up to degree 3 at a unit direction, in the order and with the signs of 3DGS. The colour
/// of a Gaussian is 0.5 plus the sum of its coefficients times these values, at least 0 (METHOD §1.1).
pub fn sh_basis(direction: [f64; 3]) -> [f64; coefficient_count(MAX_DEGREE)] {
    cpu::sh::basis(MAX_DEGREE, direction)
}

/// Renders Gaussians (METHOD §8). `probe` is that of a [`SplatFrame`].
///
/// # Errors
/// If shapes, dtypes or devices do not match, the degree is above 3, a rule is out of its range, the camera has no
/// pixels, or there are 2^31 or more pairs of a Gaussian and a tile. On a GPU, also if there are too many features, if
/// the image, coefficients, projected Gaussians or tile lists do not fit into a buffer, or if the device fails.
pub fn splat(
    inputs: SplatInputs,
    probe: Option<Tensor<2>>,
    camera: &Camera,
    settings: &SplatSettings,
) -> Result<SplatPicture, SplatError> {
    let frame = SplatFrame { inputs, probe, camera: *camera, settings: *settings };
    // Proof: there is a picture for each frame.
    splat_all(vec![frame]).map(|mut pictures| pictures.pop().expect("one"))
}

/// Renders several frames of one device. A GPU is waited for once, because it tells the lengths of all tile lists
/// together.
///
/// # Errors
/// As [`splat`], or if the frames are on different devices.
pub fn splat_all(frames: Vec<SplatFrame>) -> Result<Vec<SplatPicture>, SplatError> {
    let devices = frames.iter().map(|frame| frame.inputs.means.device());
    if let Some(other) = devices.clone().position(|device| Some(device) != devices.clone().next()) {
        return Err(SplatError::Devices(other));
    }
    let batch = SplatBatch::default();
    let prepare = |frame: SplatFrame| {
        let (primitives, plan) = checked(frame)?;
        let prepared = <Dispatch as SplatOps>::prepare(primitives.clone(), plan, batch.clone());
        Ok((primitives, plan, prepared))
    };
    let prepared = frames.into_iter().map(prepare).collect::<Result<Vec<_>, SplatError>>()?;
    batch.start();
    let render = |(primitives, plan, prepared)| {
        let output = <Dispatch as SplatOps>::splat(primitives, plan, prepared);
        if let Some(error) = output.refused {
            return Err(error);
        }
        Ok(SplatPicture { packed: Tensor::from_dispatch(output.picture), radii: Tensor::from_dispatch(output.radii) })
    };
    prepared.into_iter().map(render).collect()
}

/// The op's arguments for a frame.
fn checked(frame: SplatFrame) -> Result<(SplatTensors<DispatchTensor>, SplatPlan), SplatError> {
    let SplatFrame { inputs, probe, camera, settings } = frame;
    let (device, dtype) = (inputs.means.device(), inputs.means.dtype());
    let (tensors, sizes) = check(inputs, probe, &camera, &settings)?;
    if let Some(limit) = buffer_limit(&device) {
        check_buffers(sizes, &camera, limit)?;
    }
    if !blends(&device, sizes.channels()) {
        return Err(SplatError::Features(sizes.features));
    }
    // A placeholder replaces missing tensors and features without channels, because no device binds an empty buffer.
    let tensors = SplatTensors { features: tensors.features.filter(|_| sizes.features > 0), ..tensors };
    let stand_in = || Tensor::<2>::zeros([1, 2], (&device, dtype)).into_dispatch();
    Ok((tensors.map(|tensor| tensor.unwrap_or_else(stand_in)), SplatPlan { camera, settings, sizes }))
}

/// Checks the arguments. Returns the tensors and their sizes; `features` and `probe` may be missing.
fn check(
    inputs: SplatInputs,
    probe: Option<Tensor<2>>,
    camera: &Camera,
    settings: &SplatSettings,
) -> Result<(SplatTensors<Option<DispatchTensor>>, SplatSizes), SplatError> {
    check_picture(camera, settings)?;
    let device = inputs.means.device();
    let dtype = match inputs.means.dtype() {
        dtype if takes(&device, dtype) => dtype,
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
            check_tensor(argument, tensor, &shape, dtype, device.as_dispatch())?;
        }
    }
    Ok((tensors, sizes))
}

/// Checks the settings and the size of the image.
fn check_picture(camera: &Camera, settings: &SplatSettings) -> Result<(), SplatError> {
    if settings.sh_degree > MAX_DEGREE {
        return Err(SplatError::Degree(settings.sh_degree));
    }
    settings.rules.check()?;
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
    device: &DispatchDevice,
) -> Result<(), SplatError> {
    let shape = tensor.shape();
    if shape[..] != *expected {
        return Err(SplatError::Shape { argument, found: shape.to_vec(), expected: format!("{expected:?}") });
    }
    if tensor.dtype() != dtype {
        return Err(SplatError::Dtype { argument, found: tensor.dtype(), expected: dtype });
    }
    // Devices are equal with and without autodiff.
    if tensor.device() != *device {
        return Err(SplatError::OtherDevice { argument });
    }
    Ok(())
}

/// Checks that the largest tensors of known size fit into buffers of `limit` bytes.
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
