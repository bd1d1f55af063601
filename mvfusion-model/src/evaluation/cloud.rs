//! Renders Gaussians that other programs receive, as those programs would: all of them front to back, without masks.

use burn::tensor::{DType, Device};
use image::RgbImage;
use mvfusion_data::{Camera, GaussianCloud};

use super::metrics::quantise;
use crate::ModelError;
use crate::initial::{Masking, gaussians_of};
use crate::model::RenderContext;

/// An 8-bit image of Gaussians over the background of `context`. Masks and lifetimes of the cloud are ignored.
///
/// # Errors
/// If the splat op rejects the Gaussians, or the device fails to return the image.
pub fn cloud_picture(
    cloud: &GaussianCloud,
    camera: &Camera,
    context: &RenderContext,
    device: &Device,
) -> Result<RgbImage, ModelError> {
    let gaussians = gaussians_of(cloud, Masking::Absent, cloud.sh_degree, device, DType::F32);
    let settings = context.splat_settings(cloud.sh_degree, false);
    let picture = gaussians.canonical().splat(None, None, camera, &settings, context.behind)?;
    quantise(picture.main().colour.unsqueeze_dim(0))
}
