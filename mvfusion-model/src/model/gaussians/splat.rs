//! Rendering of Gaussians.

use burn::tensor::{Tensor, TensorData};
use mvfusion_data::Camera;
use mvfusion_render::profile::{Part, measure};
use mvfusion_render::splat::{self, SplatFrame, SplatInputs, SplatPicture, SplatSettings};

use super::raw::RawGaussians;
use crate::tensors;

/// Background of features other than masks: "near black" (METHOD §1.2).
const FEATURE_BACKGROUND: f64 = 1e-7;

/// The background behind all Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackgroundLevels {
    /// Level of the colour channels.
    pub grey: f64,
    /// Mask probabilities, one per [`MaskChannel`](crate::model::mask::MaskChannel).
    pub masks: [f64; 3],
}

impl RawGaussians {
    /// Renders these Gaussians and `features` (`[N, F]`, activated) over `background`.
    ///
    /// # Errors
    /// If the splat op rejects its input.
    pub fn splat(
        self,
        features: Option<Tensor<2>>,
        probe: Option<Tensor<2>>,
        camera: &Camera,
        settings: &SplatSettings,
        background: BackgroundLevels,
    ) -> Result<SplatPicture, splat::SplatError> {
        let frame = self.into_frame(features, probe, camera, settings, background);
        // Proof: there is a picture for each frame.
        splat_frames(vec![frame]).map(|mut pictures| pictures.pop().expect("one"))
    }

    /// The frame that [`RawGaussians::splat`] renders, to be rendered together with others.
    pub(crate) fn into_frame(
        self,
        features: Option<Tensor<2>>,
        probe: Option<Tensor<2>>,
        camera: &Camera,
        settings: &SplatSettings,
        background: BackgroundLevels,
    ) -> SplatFrame {
        let width = features.as_ref().map_or(0, |features| features.dims()[1]);
        let masks = self.mask_logits.as_ref().map_or([].as_slice(), |_| &background.masks);
        let others = std::iter::repeat(&FEATURE_BACKGROUND);
        let levels: Vec<f64> =
            [background.grey; 3].iter().chain(masks.iter().chain(others).take(width)).copied().collect();
        let levels = tensors::from_data_like(TensorData::new(levels, [3 + width]), &self.means);
        let count = self.means.dims()[0];
        let inputs = SplatInputs {
            means: self.means,
            quaternions: self.quaternions,
            log_scales: self.log_scales,
            opacity_logits: self.opacity_logits.reshape([count]),
            sh: self.sh,
            features,
            background: levels,
        };
        SplatFrame { inputs, probe, camera: *camera, settings: *settings }
    }
}

/// Renders frames together.
pub(crate) fn splat_frames(frames: Vec<SplatFrame>) -> Result<Vec<SplatPicture>, splat::SplatError> {
    measure(Part::SplatForward, || splat::splat_all(frames))
}
