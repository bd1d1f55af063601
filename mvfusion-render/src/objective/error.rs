//! Errors in the arguments of the op.

use burn::tensor::{DType, Device, Tensor};
use mvfusion_kernels::splat::COLOUR_CHANNELS;
use thiserror::Error;

use super::{ObjectiveInputs, ObjectiveTerms, SLOPE_BYTES};
use crate::device::{buffer_limit, takes, window_limit};

/// Planes of the packed render of the dynamic branch, and of the static branch.
pub(crate) const DYNAMIC_PLANES: usize = 8;
pub(crate) const STATIC_PLANES: usize = 5;

/// An invalid argument of [`objective`](super::objective).
#[derive(Debug, Error)]
pub enum ObjectiveError {
    /// A tensor has another shape.
    #[error("`{argument}` has shape {found:?}; expected {expected:?}")]
    Shape {
        /// Name of the argument.
        argument: &'static str,
        /// The tensor's shape.
        found: Vec<usize>,
        /// The expected one.
        expected: Vec<usize>,
    },
    /// A picture has no pixels.
    #[error("the pictures are {height} pixels high and {width} wide; expected at least one each")]
    Empty {
        /// Rows.
        height: usize,
        /// Columns.
        width: usize,
    },
    /// The scene's extent cannot divide depths.
    #[error("`extent` is {0}; expected a number above 0")]
    Extent(f64),
    /// A weight is no factor of a loss.
    #[error("the weight `{name}` is {value}; expected a finite number that is not below 0")]
    Weight {
        /// Name of the field of [`ObjectiveTerms`], or of [`GeometryTerms`](super::GeometryTerms) behind `geometry.`.
        name: &'static str,
        /// The weight.
        value: f64,
    },
    /// The device does not compare pictures over a window as wide.
    #[error(
        "the window `{name}` has {size} pixels along an axis, but this device compares over {limit} at most: use a \
         narrower window or a CPU"
    )]
    Window {
        /// Name of the field of [`ObjectiveTerms`].
        name: &'static str,
        /// Pixels of the window along an axis.
        size: usize,
        /// Pixels of the widest window.
        limit: usize,
    },
    /// The derivatives of SSIM do not fit into a buffer of the device.
    #[error(
        "pictures of {width} x {height} pixels need a buffer of {bytes} bytes, but the largest one of this device has \
         {limit}: use smaller pictures or a CPU"
    )]
    Buffer {
        /// Columns.
        width: usize,
        /// Rows.
        height: usize,
        /// Bytes of the derivatives.
        bytes: u64,
        /// Bytes of the largest buffer.
        limit: u64,
    },
    /// The device does not support a dtype, or the dtypes differ.
    #[error("`{argument}` has dtype {found:?}; expected f32 in all arguments, or f64 on a CPU")]
    Type {
        /// Name of the argument.
        argument: &'static str,
        /// The tensor's dtype.
        found: DType,
    },
    /// A tensor is on another device than the render of the dynamic branch.
    #[error("`{argument}` is on another device than `dynamic`: move all arguments to one device")]
    OtherDevice {
        /// Name of the argument.
        argument: &'static str,
    },
}

/// Checks all arguments.
pub(super) fn check(inputs: &ObjectiveInputs, terms: &ObjectiveTerms) -> Result<(), ObjectiveError> {
    let [_, _, height, width] = inputs.dynamic.dims();
    if height == 0 || width == 0 {
        return Err(ObjectiveError::Empty { height, width });
    }
    if terms.extent.is_nan() || terms.extent <= 0.0 {
        return Err(ObjectiveError::Extent(terms.extent));
    }
    check_weights(terms)?;
    let device = inputs.dynamic.device();
    if let Some(limit) = window_limit(&device) {
        check_windows(terms, limit)?;
    }
    if let Some(limit) = buffer_limit(&device) {
        let bytes = (SLOPE_BYTES * height * width) as u64;
        if bytes > limit {
            return Err(ObjectiveError::Buffer { width, height, bytes, limit });
        }
    }
    let dtype = inputs.dynamic.dtype();
    check_tensor("dynamic", &inputs.dynamic, [2, DYNAMIC_PLANES, height, width], dtype, &device)?;
    check_tensor("static", &inputs.static_, [2, STATIC_PLANES, height, width], dtype, &device)?;
    check_tensor("photo", &inputs.photo, [COLOUR_CHANNELS, height, width], dtype, &device)?;
    if let Some(exposure) = &inputs.exposure {
        check_tensor("exposure", exposure, [COLOUR_CHANNELS, COLOUR_CHANNELS + 1], dtype, &device)?;
    }
    let masks = &inputs.masks;
    for (name, mask) in [("valid", &masks.valid), ("moving", &masks.moving), ("around", &masks.around)] {
        if let Some(mask) = mask {
            check_tensor(name, mask, [1, height, width], dtype, &device)?;
        }
    }
    Ok(())
}

/// A term with a negative weight would be left out on one device and not on another.
fn check_weights(terms: &ObjectiveTerms) -> Result<(), ObjectiveError> {
    match terms.weights().into_iter().find(|(_, weight)| !(weight.is_finite() && *weight >= 0.0)) {
        Some((name, value)) => Err(ObjectiveError::Weight { name, value }),
        None => Ok(()),
    }
}

/// Checks that no window over which pictures are compared has more than `limit` pixels along an axis.
fn check_windows(terms: &ObjectiveTerms, limit: usize) -> Result<(), ObjectiveError> {
    let mut sizes = terms.windows().into_iter().flatten().map(|(name, window)| (name, window.weights().len()));
    match sizes.find(|&(_, size)| size > limit) {
        Some((name, size)) => Err(ObjectiveError::Window { name, size, limit }),
        None => Ok(()),
    }
}

fn check_tensor<const D: usize>(
    argument: &'static str,
    tensor: &Tensor<D>,
    expected: [usize; D],
    dtype: DType,
    device: &Device,
) -> Result<(), ObjectiveError> {
    let found = tensor.dims();
    if found != expected {
        return Err(ObjectiveError::Shape { argument, found: found.to_vec(), expected: expected.to_vec() });
    }
    if tensor.dtype() != dtype || !takes(device, dtype) {
        return Err(ObjectiveError::Type { argument, found: tensor.dtype() });
    }
    // Devices are equal with and without autodiff.
    if tensor.device() != *device {
        return Err(ObjectiveError::OtherDevice { argument });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    #[cfg(all(feature = "flex", feature = "ndarray"))]
    use super::super::ObjectiveMasks;
    use super::super::{GeometryTerms, MaskNormalisation};
    use super::*;
    use crate::window::Window;

    /// Every weight is 0.
    fn terms() -> ObjectiveTerms {
        ObjectiveTerms {
            normalisation: MaskNormalisation::Geometry,
            extent: 1.0,
            dynamic_region: false,
            static_region: false,
            ssim: Window::gaussian(11, 1.5),
            structure: Window::gaussian(5, 1.5),
            geometry: Some(GeometryTerms { l1: 0.0, dssim: 0.0, mean: true }),
            composed_l1: 0.0,
            depth_back: 0.0,
            depth_back_detached: true,
            depth_forward: 0.0,
            depth_smooth: 0.0,
            likeness: 0.0,
            branch_dssim: 0.0,
            branch_l1: 0.0,
            dynamic_above: 0.51,
            static_above: 0.51,
            composed_dssim: 0.0,
            brightness: 0.0,
            explicit_brightness: 0.0,
            entropy: 0.0,
            mask_motion: 0.0,
            mask_still: 0.0,
        }
    }

    #[test]
    fn a_weight_that_is_negative_or_not_finite_is_refused_by_its_name() {
        type Slot = fn(&mut ObjectiveTerms) -> &mut f64;
        let slots: [(&str, Slot); 3] = [
            ("geometry.dssim", |terms| &mut terms.geometry.as_mut().expect("it is the first stage").dssim),
            ("depth_smooth", |terms| &mut terms.depth_smooth),
            ("mask_still", |terms| &mut terms.mask_still),
        ];
        assert!(check_weights(&terms()).is_ok());
        for (name, slot) in slots {
            for bad in [-0.1, f64::NAN, f64::INFINITY] {
                let mut terms = terms();
                *slot(&mut terms) = bad;
                let said = check_weights(&terms).expect_err("it is refused").to_string();
                assert!(said.starts_with(&format!("the weight `{name}` is {bad}; expected")), "{said}");
            }
            let mut terms = terms();
            *slot(&mut terms) = 1e6;
            assert!(check_weights(&terms).is_ok(), "{name}");
        }
    }

    #[test]
    fn a_window_wider_than_the_device_compares_is_refused_if_it_is_used() {
        let refusal = |terms: &ObjectiveTerms, limit| check_windows(terms, limit).map_err(|error| error.to_string());
        let unused = terms();
        assert_eq!(refusal(&unused, 3), Ok(()));
        let compared = ObjectiveTerms { composed_dssim: 0.1, likeness: 0.1, ..terms() };
        assert_eq!(refusal(&compared, 11), Ok(()));
        let said = refusal(&compared, 9).expect_err("11 are too many");
        assert!(said.starts_with("the window `ssim` has 11 pixels along an axis") && said.contains("over 9"), "{said}");
        let likeness = ObjectiveTerms { likeness: 0.1, ..terms() };
        assert_eq!(refusal(&likeness, 5), Ok(()));
        let said = refusal(&likeness, 3).expect_err("5 are too many");
        assert!(said.starts_with("the window `structure` has 5 pixels along an axis"), "{said}");
    }

    #[cfg(all(feature = "flex", feature = "ndarray"))]
    #[test]
    fn tensors_on_two_devices_are_refused_by_name() {
        let [own, other] = crate::test_support::two_devices();
        let inputs = ObjectiveInputs {
            dynamic: Tensor::zeros([2, DYNAMIC_PLANES, 3, 4], &own),
            static_: Tensor::zeros([2, STATIC_PLANES, 3, 4], &own),
            exposure: None,
            photo: Tensor::zeros([COLOUR_CHANNELS, 3, 4], &own),
            masks: ObjectiveMasks::default(),
        };
        let refusal = |inputs: &ObjectiveInputs| check(inputs, &terms()).map_err(|error| error.to_string());
        assert_eq!(refusal(&inputs), Ok(()));
        let tracked = ObjectiveInputs { dynamic: inputs.dynamic.clone().autodiff(), ..inputs.clone() };
        assert_eq!(refusal(&tracked), Ok(()));
        let photo = Tensor::zeros([COLOUR_CHANNELS, 3, 4], &other);
        let said = refusal(&ObjectiveInputs { photo, ..inputs.clone() }).expect_err("two devices");
        assert!(said.starts_with("`photo` is on another device than `dynamic`"), "{said}");
        let masks = ObjectiveMasks { moving: Some(Tensor::zeros([1, 3, 4], &other)), ..ObjectiveMasks::default() };
        let said = refusal(&ObjectiveInputs { masks, ..inputs }).expect_err("two devices");
        assert!(said.starts_with("`moving` is on another device"), "{said}");
    }
}
