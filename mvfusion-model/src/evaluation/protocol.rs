//! The protocols of evaluation: which variant of each metric the people report with whom one compares.

use std::str::FromStr;

use super::metric::Metric;
use super::metrics::lpips::LpipsVariant;
use super::scores::HeldOutPhoto;

/// A way of scoring pictures that some body of results shares. All of them average metrics of single views (never
/// errors of all views together), and score the last iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Protocol {
    /// This program's own: every metric.
    ///
    /// PSNR of 8-bit pictures; SSIM with zero padding, MS-SSIM and LPIPS on unrounded pictures; LPIPS by AlexNet on
    /// `[-1, 1]` in front, by VGG-16 and on `[0, 1]` beside it; T-LPIPS of consecutive frames.
    #[default]
    Mvfusion,
    /// DeGauss' test scripts.
    ///
    /// Everything on 8-bit pictures, which they read back from files (and had truncated, where this program rounds);
    /// SSIM of torchmetrics, whose releases differ in whether the border counts: here it does not; three LPIPS, of
    /// which its paper does not say which one the table has: AlexNet on `[-1, 1]` (`LPIPS-alex normalized` there),
    /// AlexNet and VGG-16 on `[0, 1]` (`LPIPS-alex` and `LPIPS-vgg` there).
    DeGauss,
    /// The `metrics.py` of 3DGS.
    ///
    /// Everything on 8-bit pictures, which it reads back from files; SSIM with zero padding; LPIPS by VGG-16 on
    /// `[0, 1]`, for which that network was not made.
    ThreeDgs,
    /// nerfbaselines.
    ///
    /// Everything on 8-bit pictures; SSIM without padding; LPIPS by AlexNet on `[-1, 1]`, and by VGG-16 for the scenes
    /// of NeRF. Pixels that a mask ignores are black in both pictures, here as in all protocols of this program.
    NerfBaselines,
}

/// What pictures SSIM and LPIPS are taken of. PSNR has a [`Metric`] for each.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// As rendered.
    Full,
    /// Rounded to 8 bits.
    EightBit,
}

const MVFUSION: &[Metric] = &[
    Metric::Psnr,
    Metric::Ssim,
    Metric::Lpips(LpipsVariant::ALEX),
    Metric::Lpips(LpipsVariant::VGG),
    Metric::MsSsim,
    Metric::DSsim,
    Metric::PsnrExact,
    Metric::SsimValid,
    Metric::Lpips(LpipsVariant::ALEX_RAW),
    Metric::Lpips(LpipsVariant::VGG_RAW),
];

const DEGAUSS: &[Metric] = &[
    Metric::Psnr,
    Metric::SsimValid,
    Metric::Lpips(LpipsVariant::ALEX),
    Metric::Lpips(LpipsVariant::ALEX_RAW),
    Metric::Lpips(LpipsVariant::VGG_RAW),
    Metric::MsSsim,
    Metric::DSsim,
];

const THREE_DGS: &[Metric] = &[Metric::Psnr, Metric::Ssim, Metric::Lpips(LpipsVariant::VGG_RAW)];

const NERF_BASELINES: &[Metric] =
    &[Metric::Psnr, Metric::SsimValid, Metric::Lpips(LpipsVariant::ALEX), Metric::Lpips(LpipsVariant::VGG)];

impl Protocol {
    /// All protocols.
    pub const ALL: [Self; 4] = [Self::Mvfusion, Self::DeGauss, Self::ThreeDgs, Self::NerfBaselines];

    /// Name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Mvfusion => "mvfusion",
            Self::DeGauss => "degauss",
            Self::ThreeDgs => "3dgs",
            Self::NerfBaselines => "nerfbaselines",
        }
    }

    /// What its metrics mean, in a sentence to be written beside them.
    pub fn statement(self) -> &'static str {
        match self {
            Self::Mvfusion => {
                "mvfusion-3: last iteration; PSNR of 8-bit pictures, mean over views; SSIM 11x11 sigma 1.5 zero-padded \
                 and LPIPS on unrounded pictures, LPIPS of networks fed [-1,1] but where raw ([0,1]) is said; \
                 MS-SSIM of pytorch-msssim; T-LPIPS = mean |LPIPS(pictures) - LPIPS(photos)| of consecutive frames; \
                 dynamic region from given masks, else temporal standard deviation > 0.02 grown by 3 px, metrics \
                 inside and outside are means of maps; mask IoU pooled at 0.5; pixels that a view's mask ignores are \
                 black; composed pictures of held-out photos are the static branch"
            }
            Self::DeGauss => {
                "degauss: last iteration; everything on 8-bit pictures, rounded, mean over views; SSIM 11x11 sigma 1.5 \
                 without the 5-pixel border (torchmetrics); LPIPS by alex fed [-1,1] (called normalized there), and by \
                 alex and by vgg fed [0,1]; MS-SSIM of pytorch-msssim"
            }
            Self::ThreeDgs => {
                "3dgs: last iteration; everything on 8-bit pictures, mean over views; SSIM 11x11 sigma 1.5 \
                 zero-padded; LPIPS by vgg fed [0,1]"
            }
            Self::NerfBaselines => {
                "nerfbaselines: last iteration; everything on 8-bit pictures, mean over views; SSIM 11x11 sigma 1.5 \
                 without the 5-pixel border; LPIPS by alex and by vgg fed [-1,1]; pixels that a view's mask ignores \
                 are black"
            }
        }
    }

    /// What composed pictures of held-out photos show, of a model of two branches. Ours are clean views; the others
    /// score what the method renders for the photo's time.
    pub fn held_out_photos(self) -> HeldOutPhoto {
        match self {
            Self::Mvfusion => HeldOutPhoto::StaticBranch,
            Self::DeGauss | Self::ThreeDgs | Self::NerfBaselines => HeldOutPhoto::AllBranches,
        }
    }

    /// What it reports, in the order of its tables.
    pub fn metrics(self) -> &'static [Metric] {
        match self {
            Self::Mvfusion => MVFUSION,
            Self::DeGauss => DEGAUSS,
            Self::ThreeDgs => THREE_DGS,
            Self::NerfBaselines => NERF_BASELINES,
        }
    }

    /// The pictures that SSIM and LPIPS are taken of.
    pub fn precision(self) -> Precision {
        match self {
            Self::Mvfusion => Precision::Full,
            Self::DeGauss | Self::ThreeDgs | Self::NerfBaselines => Precision::EightBit,
        }
    }

    /// The kinds of LPIPS that it reports.
    pub fn lpips(self) -> impl Iterator<Item = LpipsVariant> {
        self.metrics().iter().filter_map(|&metric| match metric {
            Metric::Lpips(variant) => Some(variant),
            _ => None,
        })
    }

    /// Whether it reports flicker.
    pub fn compares_frames(self) -> bool {
        self == Self::Mvfusion
    }
}

impl FromStr for Protocol {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|protocol| protocol.name() == name).ok_or_else(|| {
            let known = Self::ALL.map(Self::name).join(", ");
            format!("there is no protocol `{name}`; there are: {known}")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn protocols_are_found_by_name_and_say_it_first() {
        for protocol in Protocol::ALL {
            assert_eq!(protocol.name().parse(), Ok(protocol));
            assert!(protocol.statement().starts_with(protocol.name()));
        }
        let said = "psnr".parse::<Protocol>().expect_err("no such protocol");
        assert!(said.contains("nerfbaselines"), "{said}");
    }

    #[test]
    fn our_own_protocol_reports_every_metric() {
        assert!(Metric::ALL.into_iter().all(|metric| MVFUSION.contains(&metric)));
    }
}
