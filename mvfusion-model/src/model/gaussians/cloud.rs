//! The values of Gaussians, for a file.

use burn::module::Module;
use burn::tensor::Tensor;
use mvfusion_data::{GaussianCloud, Lifetime};

use super::attribute::Attribute;
use super::learned::Gaussians;
use super::raw::RawGaussians;
use crate::{ModelError, tensors};

impl Gaussians {
    /// The values of the canonical Gaussians with their lifetimes, for a file.
    ///
    /// # Errors
    /// If the device fails to return them.
    pub fn to_cloud(&self) -> Result<GaussianCloud, ModelError> {
        let plain = |attribute| self.plain(attribute).map(tensors::read::<2, f32>).transpose();
        let (centres, durations) = (plain(Attribute::TimeCentres)?, plain(Attribute::LogDurations)?);
        let lifetimes =
            centres.zip(durations).zip(plain(Attribute::Velocities)?).map(|((centres, durations), travel)| {
                let each = centres.into_iter().zip(durations).zip(rows(&travel, 3));
                each.map(|((centre, log_duration), velocity)| Lifetime { centre, log_duration, velocity }).collect()
            });
        Ok(GaussianCloud { lifetimes, ..self.valid().canonical().to_cloud()? })
    }
}

impl RawGaussians {
    /// The values of these Gaussians, for a file.
    ///
    /// # Errors
    /// If the device fails to return them.
    pub fn to_cloud(&self) -> Result<GaussianCloud, ModelError> {
        let [_, coefficients, _] = self.sh.dims();
        let width = 3 * coefficients;
        let sh: Vec<f32> = tensors::read(self.sh.clone())?;
        let read = |tensor: &Tensor<2>| tensors::read::<2, f32>(tensor.clone());
        let masks = self.mask_logits.as_ref().map(read).transpose()?;
        Ok(GaussianCloud {
            sh_degree: coefficients.isqrt().saturating_sub(1),
            means: rows(&read(&self.means)?, 3).collect(),
            sh_dc: rows(&sh, width).collect(),
            sh_rest: sh.chunks_exact(width.max(1)).flat_map(|row| &row[3..]).copied().collect(),
            opacity_logits: read(&self.opacity_logits)?,
            log_scales: rows(&read(&self.log_scales)?, 3).collect(),
            quaternions: rows(&read(&self.quaternions)?, 4).collect(),
            mask_logits: masks.map(|masks| rows(&masks, 3).collect()),
            lifetimes: None,
        })
    }
}

/// The first `N` of every `stride` values.
fn rows<const N: usize>(values: &[f32], stride: usize) -> impl Iterator<Item = [f32; N]> {
    values.chunks_exact(stride.max(1)).filter_map(|row| row.first_chunk().copied())
}
