//! The image metrics: their names, units and directions.

use serde::Serialize;

use super::layer_scores::LayerScores;
use super::metrics::lpips::{Backbone, InputRange, LpipsVariant};

/// A metric of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// [`LayerScores::psnr`].
    Psnr,
    /// [`LayerScores::psnr_exact`].
    PsnrExact,
    /// [`LayerScores::ssim`].
    Ssim,
    /// [`LayerScores::ssim_valid`].
    SsimValid,
    /// [`LayerScores::ms_ssim`].
    MsSsim,
    /// [`LayerScores::d_ssim`].
    DSsim,
    /// One of the four kinds of LPIPS.
    Lpips(LpipsVariant),
}

/// The better direction of a metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Better {
    /// Higher is better.
    Higher,
    /// Lower is better.
    Lower,
}

impl Metric {
    /// Every metric.
    pub const ALL: [Self; 10] = [
        Self::Psnr,
        Self::PsnrExact,
        Self::Ssim,
        Self::SsimValid,
        Self::MsSsim,
        Self::DSsim,
        Self::Lpips(LpipsVariant::ALEX),
        Self::Lpips(LpipsVariant::VGG),
        Self::Lpips(LpipsVariant::ALEX_RAW),
        Self::Lpips(LpipsVariant::VGG_RAW),
    ];

    /// Name in files, which is the name of its field in [`LayerScores`].
    pub fn name(self) -> &'static str {
        match self {
            Self::Psnr => "psnr",
            Self::PsnrExact => "psnr_exact",
            Self::Ssim => "ssim",
            Self::SsimValid => "ssim_valid",
            Self::MsSsim => "ms_ssim",
            Self::DSsim => "d_ssim",
            Self::Lpips(variant) => match (variant.backbone, variant.range) {
                (Backbone::Alex, InputRange::Signed) => "lpips_alex",
                (Backbone::Vgg, InputRange::Signed) => "lpips_vgg",
                (Backbone::Alex, InputRange::Raw) => "lpips_alex_raw",
                (Backbone::Vgg, InputRange::Raw) => "lpips_vgg_raw",
            },
        }
    }

    /// Name for people. Every table uses it, whatever the protocol.
    pub const fn label(self) -> &'static str {
        match self {
            Self::Psnr => "PSNR",
            Self::PsnrExact => "PSNR unrounded",
            Self::Ssim => "SSIM",
            Self::SsimValid => "SSIM without border",
            Self::MsSsim => "MS-SSIM",
            Self::DSsim => "D-SSIM",
            Self::Lpips(variant) => match (variant.backbone, variant.range) {
                (Backbone::Alex, InputRange::Signed) => "LPIPS-alex",
                (Backbone::Vgg, InputRange::Signed) => "LPIPS-vgg",
                (Backbone::Alex, InputRange::Raw) => "LPIPS-alex on [0,1]",
                (Backbone::Vgg, InputRange::Raw) => "LPIPS-vgg on [0,1]",
            },
        }
    }

    /// The unit of its values.
    pub const fn unit(self) -> Option<&'static str> {
        match self {
            Self::Psnr | Self::PsnrExact => Some("dB"),
            _ => None,
        }
    }

    /// Decimal places. Runs of the same kind differ beyond them.
    pub const fn decimals(self) -> usize {
        match self {
            Self::Psnr | Self::PsnrExact => 2,
            _ => 4,
        }
    }

    /// The better direction.
    pub const fn better(self) -> Better {
        match self {
            Self::Psnr | Self::PsnrExact | Self::Ssim | Self::SsimValid | Self::MsSsim => Better::Higher,
            Self::DSsim | Self::Lpips(_) => Better::Lower,
        }
    }

    /// Its value in a layer's metrics.
    pub fn of(self, scores: &LayerScores) -> Option<f64> {
        // A copy, so that one list of fields serves reading and writing.
        *self.place(&mut { *scores })
    }

    /// Its field in a layer's metrics.
    pub(super) fn place(self, scores: &mut LayerScores) -> &mut Option<f64> {
        match self {
            Self::Psnr => &mut scores.psnr,
            Self::PsnrExact => &mut scores.psnr_exact,
            Self::Ssim => &mut scores.ssim,
            Self::SsimValid => &mut scores.ssim_valid,
            Self::MsSsim => &mut scores.ms_ssim,
            Self::DSsim => &mut scores.d_ssim,
            Self::Lpips(variant) => match (variant.backbone, variant.range) {
                (Backbone::Alex, InputRange::Signed) => &mut scores.lpips_alex,
                (Backbone::Vgg, InputRange::Signed) => &mut scores.lpips_vgg,
                (Backbone::Alex, InputRange::Raw) => &mut scores.lpips_alex_raw,
                (Backbone::Vgg, InputRange::Raw) => &mut scores.lpips_vgg_raw,
            },
        }
    }
}

impl Better {
    /// An arrow in the better direction.
    pub const fn arrow(self) -> &'static str {
        match self {
            Self::Higher => "\u{2191}",
            Self::Lower => "\u{2193}",
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_label_names_one_metric() {
        let labels: BTreeSet<&str> = Metric::ALL.into_iter().map(Metric::label).collect();
        assert_eq!(labels.len(), Metric::ALL.len());
    }

    #[test]
    fn every_metric_has_a_place_of_its_own() {
        let mut scores = LayerScores::default();
        for (number, metric) in Metric::ALL.into_iter().enumerate() {
            *metric.place(&mut scores) = Some(number as f64);
        }
        let found = Metric::ALL.map(|metric| metric.of(&scores));
        assert_eq!(found, std::array::from_fn(|number| Some(number as f64)));
        let file = serde_json::to_value(scores).expect("written");
        let written = Metric::ALL.map(|metric| file[metric.name()].as_f64());
        assert_eq!(written, found);
    }
}
