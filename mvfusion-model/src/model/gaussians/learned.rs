//! The Gaussians of a branch as they are learned: one parameter per attribute.

use burn::module::{Module, Param, ParamId};
use burn::tensor::Tensor;

use super::attribute::Attribute;
use super::raw::RawGaussians;
use crate::model::rows::{PerGaussian, RowMap};

/// Bounds of log-durations, so that relative ages are finite: a hundred-thousandth of the video, and a thousand videos.
pub(crate) const LEAST_LOG_DURATION: f64 = -12.0;
pub(crate) const MOST_LOG_DURATION: f64 = 7.0;

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
    /// Mask logits, one column per [`MaskChannel`](crate::model::mask::MaskChannel): `[N, 3]`; only in the dynamic
    /// branch.
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

    /// The canonical Gaussians at a time, with their lifetimes applied if they have any.
    ///
    /// With moment `c`, duration `w` and velocity `v`, the centre is `mean + (t - c) v`, and the opacity is
    /// `sigmoid(logit - ((t - c) / w)^2)`. For small opacities, this is the bell `opacity exp(-((t - c) / w)^2)` of
    /// Spacetime Gaussians and FreeTimeGS; for large ones, it is flat-topped. Ours; docs/METHOD.md, section 13.
    pub fn at(&self, time: f64) -> RawGaussians {
        self.alive(self.canonical(), time)
    }

    /// The canonical Gaussians of this branch with their lifetimes applied.
    pub(crate) fn alive(&self, canonical: RawGaussians, time: f64) -> RawGaussians {
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
