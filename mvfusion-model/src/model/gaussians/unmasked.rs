//! Gaussians for viewers that know no masks.

use burn::tensor::Tensor;
use mvfusion_render::activation::sigmoid;

use super::raw::{RawGaussians, SH_C0, foreground_share};
use crate::model::composition::brightness;
use crate::model::mask::MaskChannel;

/// Distance of opacities in files from 0 and 1, so that their logits are finite. It is invisible in 8-bit images.
const OPACITY_MARGIN: f64 = 1e-6;

impl RawGaussians {
    /// The same Gaussians for viewers without masks, which blend all Gaussians front to back.
    ///
    /// Alone and opaque, a Gaussian with the foreground share `d` and the brightness factor `l` leaves `(1 - d) l` of
    /// the static branch visible and adds `d` times its colour (METHOD §1.3). A viewer does the same with an opacity of
    /// `1 - (1 - d) l` and that colour over this opacity. This equals the blending of the branches where one opaque
    /// Gaussian, or several with equal masks, cover a pixel. Behind translucent ones, errors multiply.
    ///
    /// `l` is taken as at most 1, because a Gaussian cannot brighten what is behind it.
    pub fn without_masks(self) -> Self {
        let Some(logits) = &self.mask_logits else { return self };
        let probabilities = sigmoid(logits.clone());
        let light = brightness(MaskChannel::Brightness.of(&probabilities)).clamp_max(1.0);
        let share = foreground_share(logits.clone());
        // 1 - (1 - d) l without the cancellation that would make it 0 for small shares.
        let hidden = share.clone() + (-share.clone() + 1.0) * (-light + 1.0);
        let opacity = (sigmoid(self.opacity_logits) * hidden.clone()).clamp(OPACITY_MARGIN, 1.0 - OPACITY_MARGIN);
        let opacity_logits = opacity.clone().log() - (-opacity + 1.0).log();
        // `hidden` is at least `share`, which is positive.
        let dim: Tensor<3> = (share / hidden).unsqueeze_dim(2);
        let [_, coefficients, _] = self.sh.dims();
        let constant = self.sh.clone().narrow(1, 0, 1) * dim.clone() + (dim.clone() - 1.0) * (0.5 / SH_C0);
        let mut sh = vec![constant];
        if coefficients > 1 {
            sh.push(self.sh.narrow(1, 1, coefficients - 1) * dim);
        }
        Self { opacity_logits, sh: Tensor::cat(sh, 1), mask_logits: None, ..self }
    }
}

#[cfg(test)]
mod tests {
    use burn::tensor::{Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, values};

    /// Tolerance for rounding in single precision, and for the margin of opacities.
    const ROUNDING: f64 = 1e-5;

    /// One opaque Gaussian with a colour coefficient of 0.4 and these mask probabilities.
    fn masked(probabilities: [f64; 3], device: &Device) -> RawGaussians {
        let logit = |share: f64| (share / (1.0 - share)).ln() as f32;
        let row = |numbers: Vec<f32>| {
            let width = numbers.len();
            Tensor::<2>::from_data(TensorData::new(numbers, [1, width]), device)
        };
        RawGaussians {
            means: row(vec![0.0; 3]),
            sh: row(vec![0.4; 12]).reshape([1, 4, 3]),
            opacity_logits: row(vec![30.0]),
            log_scales: row(vec![0.0; 3]),
            quaternions: row(vec![1.0, 0.0, 0.0, 0.0]),
            mask_logits: Some(row(probabilities.map(logit).to_vec())),
        }
    }

    #[test]
    fn without_masks_a_gaussian_hides_and_adds_what_the_blend_does() {
        for_each_device(|device| {
            for (probabilities, light) in [
                ([0.3, 0.4, 0.6], 0.9),
                ([0.3, 0.9, 0.6], 1.0),
                ([0.98, 0.1, 0.02], 0.6),
                ([0.999_999, 0.5, 1e-9], 1.0),
            ] {
                let share = probabilities[2] / (probabilities[0] + probabilities[2]);
                let folded = masked(probabilities, &device).without_masks();
                assert!(folded.mask_logits.is_none());
                let opacity = values(sigmoid(folded.opacity_logits))[0];
                assert!((1.0 - opacity - (1.0 - share) * light).abs() < ROUNDING, "{probabilities:?}: {opacity}");
                let sh = values(folded.sh);
                // The constant colour and the higher coefficients, each times the opacity.
                let added = [(0.5 + SH_C0 * sh[0]) * opacity, sh[3] * opacity];
                let wanted = [(0.5 + SH_C0 * 0.4) * share, 0.4 * share];
                assert!(added.iter().zip(wanted).all(|(a, b)| (a - b).abs() < ROUNDING), "{added:?}, not {wanted:?}");
            }
        });
    }

    #[test]
    fn gaussians_without_masks_stay_as_they_are() {
        for_each_device(|device| {
            let plain = RawGaussians { mask_logits: None, ..masked([0.5; 3], &device) };
            let same = plain.clone().without_masks();
            assert_eq!(values(same.opacity_logits), values(plain.opacity_logits));
        });
    }
}
