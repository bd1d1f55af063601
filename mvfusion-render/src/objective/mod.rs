//! The picture terms of the training objective as one op: both branches' packed renders and the photo in, one scalar out.
//!
//! The blend of the branches, a dozen losses over pixels and four similarity maps would otherwise be a hundred tensor
//! operations, each with a backward pass over the whole picture. The objective is a scalar, so its gradients are computed
//! with it; the backward pass only scales them.

mod cpu;
mod error;
pub(crate) mod op;
mod pixel;
mod terms;

use burn::tensor::Tensor;

pub use error::ObjectiveError;
/// Constants of the terms.
pub use mvfusion_kernels::objective as constants;
pub use terms::{GeometryTerms, MaskNormalisation, ObjectiveTerms};

/// Bytes per pixel of the largest buffer on a GPU: three derivatives of SSIM for three images of three channels.
pub const SLOPE_BYTES: usize = 4 * 27;

/// A view: its renders, its photo and its masks. All tensors have one dtype (f32, or f64 on a CPU) and one device. The
/// two copies of a render must be equal: values are read of the first alone, and the copies only part the gradients.
#[derive(Clone, Debug)]
pub struct ObjectiveInputs {
    /// Packed render of the dynamic branch, `[2, 8, H, W]`: colour, mask channels (static, brightness, dynamic), alpha and
    /// depth. The gradients of the main terms reach the first copy, those of the light terms the second.
    pub dynamic: Tensor<4>,
    /// Packed render of the static branch, `[2, 5, H, W]`: colour, alpha, depth.
    pub static_: Tensor<4>,
    /// Affine colour map of the camera, `[3, 4]`, applied to the colours of both branches; `None` for the identity.
    pub exposure: Option<Tensor<2>>,
    /// The photo, black at invalid pixels: `[3, H, W]` in `[0, 1]`, without gradient.
    pub photo: Tensor<3>,
    /// The masks, without gradient.
    pub masks: ObjectiveMasks,
}

/// Masks of a view, `[1, H, W]` each.
#[derive(Clone, Debug, Default)]
pub struct ObjectiveMasks {
    /// 1 at valid pixels; `None` if all are valid. Renders are black and in no mask at the others.
    pub valid: Option<Tensor<3>>,
    /// 1 at moving pixels, within the valid ones; `None` if no motion is known.
    pub moving: Option<Tensor<3>>,
    /// The same with its surroundings.
    pub around: Option<Tensor<3>>,
}

/// The results for a view.
#[derive(Clone, Debug)]
pub struct Objective {
    /// Weighted sum of the terms: `[1]`.
    pub loss: Tensor<1>,
    /// Mean squared error of the composed render over all pixels, without gradient: `[1]`.
    pub squared_error: Tensor<1>,
}

/// The weighted sum of the terms (METHOD §4.4) and its gradients with respect to both renders and the exposure.
///
/// # Errors
/// If a shape, dtype or device does not match, `extent` is not above 0, or a weight is negative or not finite. On a
/// GPU, also if the pictures are too large for a buffer, or are compared over a window of more than 193 pixels.
pub fn objective(inputs: ObjectiveInputs, terms: &ObjectiveTerms) -> Result<Objective, ObjectiveError> {
    error::check(&inputs, terms)?;
    let values = op::objective(inputs, terms);
    Ok(Objective { loss: values.clone().narrow(0, 0, 1), squared_error: values.inner().narrow(0, 1, 1) })
}
