//! The attributes of a Gaussian, by name.

use std::fmt;

use burn::tensor::{DType, Device, Tensor, TensorData};
use serde::{Deserialize, Serialize};

/// The name of an attribute of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Attribute {
    /// [`Gaussians::means`](super::Gaussians::means).
    Means,
    /// [`Gaussians::sh_dc`](super::Gaussians::sh_dc).
    ShDc,
    /// [`Gaussians::sh_rest`](super::Gaussians::sh_rest).
    ShRest,
    /// [`Gaussians::opacity_logits`](super::Gaussians::opacity_logits).
    OpacityLogits,
    /// [`Gaussians::log_scales`](super::Gaussians::log_scales).
    LogScales,
    /// [`Gaussians::quaternions`](super::Gaussians::quaternions).
    Quaternions,
    /// [`Gaussians::mask_logits`](super::Gaussians::mask_logits).
    MaskLogits,
    /// [`Gaussians::time_centres`](super::Gaussians::time_centres).
    TimeCentres,
    /// [`Gaussians::log_durations`](super::Gaussians::log_durations).
    LogDurations,
    /// [`Gaussians::velocities`](super::Gaussians::velocities).
    Velocities,
}

impl Attribute {
    /// All attributes.
    pub const ALL: [Self; 10] = [
        Self::Means,
        Self::ShDc,
        Self::ShRest,
        Self::OpacityLogits,
        Self::LogScales,
        Self::Quaternions,
        Self::MaskLogits,
        Self::TimeCentres,
        Self::LogDurations,
        Self::Velocities,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Means => "means",
            Self::ShDc => "sh_dc",
            Self::ShRest => "sh_rest",
            Self::OpacityLogits => "opacity_logits",
            Self::LogScales => "log_scales",
            Self::Quaternions => "quaternions",
            Self::MaskLogits => "mask_logits",
            Self::TimeCentres => "time_centres",
            Self::LogDurations => "log_durations",
            Self::Velocities => "velocities",
        }
    }
}

impl fmt::Display for Attribute {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// A `[rows, columns]` parameter tensor of `f64` values, in the given precision, on the device with autodiff.
pub(crate) fn attribute_tensor(values: Vec<f64>, columns: usize, device: &Device, dtype: DType) -> Tensor<2> {
    let rows = values.len() / columns.max(1);
    let data = TensorData::new(values, [rows, columns]).convert_dtype(dtype);
    Tensor::from_data(data, (device, dtype))
}
