//! A set of Gaussians: the raw attributes to optimise (METHOD §1.1).

use std::fmt;

use burn::module::{Module, Param, ParamId};
use burn::tensor::{DType, Device, Int, Tensor, TensorData, activation::sigmoid};
use mvfusion_data::{Camera, GaussianCloud, Lifetime};
use mvfusion_render::profile::{Part, measure};
use mvfusion_render::splat::{self, SplatFrame, SplatInputs, SplatPicture, SplatSettings};
use serde::{Deserialize, Serialize};

use crate::model::composition::brightness;
use crate::model::mask::MaskChannel;
use crate::model::network::Offsets;
use crate::model::rows::{PerGaussian, RowMap};
use crate::{ModelError, tensors};

/// The colour of a Gaussian at SH degree 0 is `0.5 + SH_C0 * dc`.
pub const SH_C0: f64 = 0.282_094_791_773_878_14;

/// Background of features other than masks: "near black" (METHOD §1.2).
const FEATURE_BACKGROUND: f64 = 1e-7;

/// Distance of opacities in files from 0 and 1, so that their logits are finite. It is invisible in 8-bit images.
const OPACITY_MARGIN: f64 = 1e-6;

/// Gaussians as raw values before activation, one row each.
#[derive(Module, Debug)]
pub struct Gaussians {
    /// Centres in world units: `[N, 3]`.
    pub means: Param<Tensor<2>>,
    /// Constant colour coefficients: `[N, 3]`.
    pub sh_dc: Param<Tensor<2>>,
    /// Higher colour coefficients, coefficient by coefficient, colour fastest: `[N, 45]` for degree 3.
    pub sh_rest: Param<Tensor<2>>,
    /// Opacity logits: `[N, 1]`.
    pub opacity_logits: Param<Tensor<2>>,
    /// Log-scales: `[N, 3]`.
    pub log_scales: Param<Tensor<2>>,
    /// Quaternions w, x, y, z, not normalised: `[N, 4]`.
    pub quaternions: Param<Tensor<2>>,
    /// Mask logits, one column per [`MaskChannel`]: `[N, 3]`; only in the dynamic branch.
    pub mask_logits: Option<Param<Tensor<2>>>,
    /// Moment of a Gaussian's maximum opacity, at which its centre is given, in the time of the views: `[N, 1]`; only
    /// in a dynamic branch with lifetimes (`model.lifetime`).
    pub time_centres: Option<Param<Tensor<2>>>,
    /// Logarithm of its duration, in the same time: `[N, 1]`; with `time_centres`.
    pub log_durations: Option<Param<Tensor<2>>>,
    /// Velocity, in world units per unit of time: `[N, 3]`; with `time_centres`.
    pub velocities: Option<Param<Tensor<2>>>,
    /// Current SH degree; the coefficients above it are 0.
    #[module(skip)]
    pub sh_degree: usize,
}

/// The name of an attribute of a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Attribute {
    /// [`Gaussians::means`].
    Means,
    /// [`Gaussians::sh_dc`].
    ShDc,
    /// [`Gaussians::sh_rest`].
    ShRest,
    /// [`Gaussians::opacity_logits`].
    OpacityLogits,
    /// [`Gaussians::log_scales`].
    LogScales,
    /// [`Gaussians::quaternions`].
    Quaternions,
    /// [`Gaussians::mask_logits`].
    MaskLogits,
    /// [`Gaussians::time_centres`].
    TimeCentres,
    /// [`Gaussians::log_durations`].
    LogDurations,
    /// [`Gaussians::velocities`].
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

/// Bounds of log-durations, so that relative ages are finite: a hundred-thousandth of the video, and a thousand videos.
pub(crate) const LEAST_LOG_DURATION: f64 = -12.0;
pub(crate) const MOST_LOG_DURATION: f64 = 7.0;

/// The background behind all Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Behind {
    /// Level of the colour channels.
    pub grey: f64,
    /// Mask probabilities, one per [`MaskChannel`].
    pub masks: [f64; 3],
}

/// Raw attributes as tensors for rendering, canonical or deformed.
#[derive(Clone, Debug)]
pub struct RawGaussians {
    /// Centres: `[N, 3]`.
    pub means: Tensor<2>,
    /// Colour coefficients: `[N, K, 3]`.
    pub sh: Tensor<3>,
    /// Opacity logits: `[N, 1]`.
    pub opacity_logits: Tensor<2>,
    /// Log-scales: `[N, 3]`.
    pub log_scales: Tensor<2>,
    /// Quaternions: `[N, 4]`.
    pub quaternions: Tensor<2>,
    /// Mask logits, one column per [`MaskChannel`]: `[N, 3]`.
    pub mask_logits: Option<Tensor<2>>,
}

impl Gaussians {
    /// Gaussians with the given attributes; every tensor becomes a parameter. The SH degree starts at 0.
    pub fn from_tensors(raw: impl Fn(Attribute) -> Option<Tensor<2>>) -> Option<Self> {
        let parameter = |attribute| raw(attribute).map(Param::from_tensor);
        Some(Self {
            means: parameter(Attribute::Means)?,
            sh_dc: parameter(Attribute::ShDc)?,
            sh_rest: parameter(Attribute::ShRest)?,
            opacity_logits: parameter(Attribute::OpacityLogits)?,
            log_scales: parameter(Attribute::LogScales)?,
            quaternions: parameter(Attribute::Quaternions)?,
            mask_logits: parameter(Attribute::MaskLogits),
            time_centres: parameter(Attribute::TimeCentres),
            log_durations: parameter(Attribute::LogDurations),
            velocities: parameter(Attribute::Velocities),
            sh_degree: 0,
        })
    }

    /// Number of Gaussians.
    pub fn count(&self) -> usize {
        self.means.dims()[0]
    }

    /// The parameter of an attribute.
    pub fn attribute(&self, attribute: Attribute) -> Option<&Param<Tensor<2>>> {
        match attribute {
            Attribute::Means => Some(&self.means),
            Attribute::ShDc => Some(&self.sh_dc),
            Attribute::ShRest => Some(&self.sh_rest),
            Attribute::OpacityLogits => Some(&self.opacity_logits),
            Attribute::LogScales => Some(&self.log_scales),
            Attribute::Quaternions => Some(&self.quaternions),
            Attribute::MaskLogits => self.mask_logits.as_ref(),
            Attribute::TimeCentres => self.time_centres.as_ref(),
            Attribute::LogDurations => self.log_durations.as_ref(),
            Attribute::Velocities => self.velocities.as_ref(),
        }
    }

    /// The values of an attribute without autodiff.
    pub fn plain(&self, attribute: Attribute) -> Option<Tensor<2>> {
        self.attribute(attribute).map(|parameter| parameter.val().inner())
    }

    /// Takes the values of an attribute, without autodiff, so that they can be changed in place. The attribute is empty
    /// until [`Gaussians::replace`] puts them back.
    pub fn take(&mut self, attribute: Attribute) -> Option<Tensor<2>> {
        let slot = self.slot(attribute)?;
        let empty = Param::initialized(ParamId::new(), Tensor::empty([0, 0], &slot.val().device().inner()));
        Some(std::mem::replace(slot, empty).into_value().inner())
    }

    /// Replaces the values of an attribute by new ones (without autodiff), as a new parameter.
    pub fn replace(&mut self, attribute: Attribute, values: Tensor<2>) {
        if let Some(slot) = self.slot(attribute) {
            *slot = Param::from_tensor(values.autodiff());
        }
    }

    fn slot(&mut self, attribute: Attribute) -> Option<&mut Param<Tensor<2>>> {
        match attribute {
            Attribute::Means => Some(&mut self.means),
            Attribute::ShDc => Some(&mut self.sh_dc),
            Attribute::ShRest => Some(&mut self.sh_rest),
            Attribute::OpacityLogits => Some(&mut self.opacity_logits),
            Attribute::LogScales => Some(&mut self.log_scales),
            Attribute::Quaternions => Some(&mut self.quaternions),
            Attribute::MaskLogits => self.mask_logits.as_mut(),
            Attribute::TimeCentres => self.time_centres.as_mut(),
            Attribute::LogDurations => self.log_durations.as_mut(),
            Attribute::Velocities => self.velocities.as_mut(),
        }
    }

    /// The canonical Gaussians.
    pub fn canonical(&self) -> RawGaussians {
        let sh = Tensor::cat(vec![self.sh_dc.val(), self.sh_rest.val()], 1);
        let [count, columns] = sh.dims();
        RawGaussians {
            means: self.means.val(),
            sh: sh.reshape([count, columns / 3, 3]),
            opacity_logits: self.opacity_logits.val(),
            log_scales: self.log_scales.val(),
            quaternions: self.quaternions.val(),
            mask_logits: self.mask_logits.as_ref().map(|logits| logits.val()),
        }
    }

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

    /// The canonical Gaussians at a time, with their lifetimes applied if they have any.
    ///
    /// With moment `c`, duration `w` and velocity `v`, the centre is `mean + (t - c) v`, and the opacity is
    /// `sigmoid(logit - ((t - c) / w)^2)`. For small opacities, this is the bell `opacity exp(-((t - c) / w)^2)` of
    /// Spacetime Gaussians and FreeTimeGS; for large ones, it is flat-topped. Ours; docs/METHOD.md, section 13.
    pub fn at(&self, time: f64) -> RawGaussians {
        let canonical = self.canonical();
        let (Some(centres), Some(durations), Some(velocities)) =
            (&self.time_centres, &self.log_durations, &self.velocities)
        else {
            return canonical;
        };
        let since = -centres.val() + time;
        let ages = since.clone() * (-durations.val().clamp(LEAST_LOG_DURATION, MOST_LOG_DURATION)).exp();
        RawGaussians {
            means: canonical.means + velocities.val() * since,
            opacity_logits: canonical.opacity_logits - ages.powf_scalar(2.0),
            ..canonical
        }
    }
}

impl PerGaussian for Gaussians {
    /// New Gaussians equal their parents. Those without a parent are zero until the caller sets their values.
    fn follow(&mut self, map: &RowMap) {
        for attribute in Attribute::ALL {
            if let Some(values) = self.plain(attribute) {
                self.replace(attribute, map.inherit(&values));
            }
        }
    }
}

impl RawGaussians {
    /// The Gaussians plus `offsets`, all in raw units (METHOD §2.3).
    pub fn deformed(self, offsets: Offsets) -> Self {
        let [count, coefficients, _] = self.sh.dims();
        let sh_offsets =
            offsets.sh.map(|offsets| offsets.narrow(1, 0, coefficients * 3).reshape([count, coefficients, 3]));
        Self {
            means: self.means + offsets.means,
            sh: plus(self.sh, sh_offsets),
            opacity_logits: plus(self.opacity_logits, offsets.opacity_logits),
            log_scales: self.log_scales + offsets.log_scales,
            quaternions: self.quaternions + offsets.quaternions,
            mask_logits: self.mask_logits.map(|logits| plus(logits, offsets.mask_logits)),
        }
    }

    /// Splat features: mask probabilities, one column per [`MaskChannel`]: `[N, 3]` (METHOD §1.2).
    pub fn mask_features(&self) -> Option<Tensor<2>> {
        Some(sigmoid(self.mask_logits.clone()?))
    }

    /// Foreground probability of each Gaussian: `clamp(u_d / (u_d + u_s)) * opacity`, `[N, 1]` (METHOD §1.4).
    pub fn foreground_probability(&self) -> Option<Tensor<2>> {
        let probabilities = sigmoid(self.mask_logits.clone()?.inner());
        Some(foreground_share(&probabilities) * sigmoid(self.opacity_logits.clone().inner()))
    }

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
        let share = foreground_share(&probabilities);
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

    /// Renders these Gaussians and `features` (`[N, F]`, activated) over the background `behind`.
    ///
    /// # Errors
    /// If the splat op rejects its input.
    pub fn splat(
        self,
        features: Option<Tensor<2>>,
        probe: Option<Tensor<2>>,
        camera: &Camera,
        settings: &SplatSettings,
        behind: Behind,
    ) -> Result<SplatPicture, splat::SplatError> {
        let frame = self.into_frame(features, probe, camera, settings, behind);
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
        behind: Behind,
    ) -> SplatFrame {
        let width = features.as_ref().map_or(0, |features| features.dims()[1]);
        let masks = self.mask_logits.as_ref().map_or([].as_slice(), |_| &behind.masks);
        let others = std::iter::repeat(&FEATURE_BACKGROUND);
        let levels: Vec<f64> = [behind.grey; 3].iter().chain(masks.iter().chain(others).take(width)).copied().collect();
        let background = tensors::from_data_like(TensorData::new(levels, [3 + width]), &self.means);
        let count = self.means.dims()[0];
        let inputs = SplatInputs {
            means: self.means,
            quaternions: self.quaternions,
            log_scales: self.log_scales,
            opacity_logits: self.opacity_logits.reshape([count]),
            sh: self.sh,
            features,
            background,
        };
        SplatFrame { inputs, probe, camera: *camera, settings: *settings }
    }

    /// The values of an attribute in the layout of [`Gaussians`].
    pub fn attribute(&self, attribute: Attribute) -> Option<Tensor<2>> {
        let sh = |first: usize, end: usize| {
            let count = self.sh.dims()[0];
            self.sh.clone().narrow(1, first, end - first).reshape([count, 3 * (end - first)])
        };
        Some(match attribute {
            Attribute::Means => self.means.clone(),
            Attribute::ShDc => sh(0, 1),
            Attribute::ShRest => sh(1, self.sh.dims()[1]),
            Attribute::OpacityLogits => self.opacity_logits.clone(),
            Attribute::LogScales => self.log_scales.clone(),
            Attribute::Quaternions => self.quaternions.clone(),
            Attribute::MaskLogits => return self.mask_logits.clone(),
            Attribute::TimeCentres | Attribute::LogDurations | Attribute::Velocities => return None,
        })
    }

    /// The rows of the given Gaussians.
    pub fn select(self, rows: &Tensor<1, Int>) -> Self {
        Self {
            means: self.means.select(0, rows.clone()),
            sh: self.sh.select(0, rows.clone()),
            opacity_logits: self.opacity_logits.select(0, rows.clone()),
            log_scales: self.log_scales.select(0, rows.clone()),
            quaternions: self.quaternions.select(0, rows.clone()),
            mask_logits: self.mask_logits.map(|logits| logits.select(0, rows.clone())),
        }
    }
}

/// Share of the foreground in the mask probabilities of each Gaussian: `[N, 1]` (METHOD §1.4).
fn foreground_share(probabilities: &Tensor<2>) -> Tensor<2> {
    let [static_, dynamic] = [MaskChannel::Static, MaskChannel::Dynamic].map(|channel| channel.of(probabilities));
    (dynamic.clone() / (dynamic + static_ + 1e-6)).clamp(1e-9, 1.0 - 1e-9)
}

/// Values plus offsets, if there are any.
fn plus<const D: usize>(values: Tensor<D>, offsets: Option<Tensor<D>>) -> Tensor<D> {
    match offsets {
        Some(offsets) => values + offsets,
        None => values,
    }
}

/// The first `N` of every `stride` values.
fn rows<const N: usize>(values: &[f32], stride: usize) -> impl Iterator<Item = [f32; N]> {
    values.chunks_exact(stride.max(1)).filter_map(|row| row.first_chunk().copied())
}

/// A `[rows, columns]` parameter tensor of `f64` values, in the given precision, on the device with autodiff.
pub(crate) fn attribute_tensor(values: Vec<f64>, columns: usize, device: &Device, dtype: DType) -> Tensor<2> {
    let rows = values.len() / columns.max(1);
    let data = TensorData::new(values, [rows, columns]).convert_dtype(dtype);
    Tensor::from_data(data, (device, dtype))
}

/// Renders frames together.
pub(crate) fn splat_frames(frames: Vec<SplatFrame>) -> Result<Vec<SplatPicture>, splat::SplatError> {
    measure(Part::SplatForward, || splat::splat_all(frames))
}

#[cfg(test)]
mod tests {
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
