//! The evaluation protocols: the variant of each metric in a body of results.

use std::str::FromStr;

use super::metric::Metric;
use super::metrics::lpips::LpipsVariant;
use super::scores::HeldOutPhoto;

/// An evaluation protocol. All protocols average metrics over views (they never pool errors), and evaluate the last
/// iteration.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Protocol {
    /// The protocol of this program: all metrics.
    ///
    /// PSNR of 8-bit images; SSIM with zero padding, MS-SSIM and LPIPS on unrounded images. The first LPIPS is AlexNet
    /// on `[-1, 1]`, followed by VGG-16 and the variants on `[0, 1]`. T-LPIPS of consecutive frames.
    #[default]
    Mvfusion,
    /// The test scripts of DeGauss.
    ///
    /// All metrics use 8-bit images, which the scripts read back from files (truncated; this program rounds). SSIM is
    /// from torchmetrics, whose releases differ in whether they include the border; here they do not. There are three
    /// LPIPS: AlexNet on `[-1, 1]` (`LPIPS-alex normalized` there), AlexNet and VGG-16 on `[0, 1]` (`LPIPS-alex` and
    /// `LPIPS-vgg` there). The paper does not state which one its table contains.
    DeGauss,
    /// The `metrics.py` of 3DGS.
    ///
    /// All metrics use 8-bit images, which the script reads back from files. SSIM has zero padding. LPIPS is VGG-16 on
    /// `[0, 1]`, which is not its intended input range.
    ThreeDgs,
    /// nerfbaselines.
    ///
    /// All metrics use 8-bit images. SSIM has no padding. LPIPS is AlexNet on `[-1, 1]`, and VGG-16 for the scenes of
    /// NeRF. Pixels that a mask ignores are black in both images, as in all protocols of this program.
    NerfBaselines,
}

/// The precision of the images for SSIM and LPIPS. PSNR has a [`Metric`] for each precision.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// Full precision.
    Full,
    /// Rounded to 8 bits.
    EightBit,
}

/// Those of [`MVFUSION`] that do not repeat others in another form.
const MAIN: usize = 5;

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

    /// A description of its metrics, for tables and reports.
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
                 alex and by vgg fed [0,1]; MS-SSIM of pytorch-msssim; composed pictures of held-out photos are the \
                 static branch"
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

    /// The content of composed renders of held-out photos, for a model with two branches. Ours are clean views, as those
    /// of DeGauss (METHOD §6); protocols that know no branches evaluate the render at the photo's time.
    pub fn held_out_photos(self) -> HeldOutPhoto {
        match self {
            Self::Mvfusion | Self::DeGauss => HeldOutPhoto::StaticBranch,
            Self::ThreeDgs | Self::NerfBaselines => HeldOutPhoto::AllBranches,
        }
    }

    /// The metrics that it reports, in the order of its tables.
    pub fn metrics(self) -> &'static [Metric] {
        match self {
            Self::Mvfusion => MVFUSION,
            Self::DeGauss => DEGAUSS,
            Self::ThreeDgs => THREE_DGS,
            Self::NerfBaselines => NERF_BASELINES,
        }
    }

    /// Those of its metrics that do not repeat others in another form.
    pub fn main_metrics(self) -> &'static [Metric] {
        match self {
            Self::Mvfusion => &MVFUSION[..MAIN],
            other => other.metrics(),
        }
    }

    /// The precision of the images for SSIM and LPIPS.
    pub fn precision(self) -> Precision {
        match self {
            Self::Mvfusion => Precision::Full,
            Self::DeGauss | Self::ThreeDgs | Self::NerfBaselines => Precision::EightBit,
        }
    }

    /// The LPIPS variants that it reports.
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
