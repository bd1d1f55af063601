//! Learning rates of one step.

use crate::config::OptimConfig;
use crate::model::gaussians::Attribute;

/// The learning rate of every group at a step of a stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rates {
    /// The dynamic branch.
    pub dynamic: GaussianRates,
    /// The static branch.
    pub static_: GaussianRates,
    /// Trunk and attribute heads.
    pub deformation: f64,
    /// Mask heads.
    pub mask_heads: f64,
    /// HexPlane cells.
    pub grid: f64,
    /// MVG and MFTA.
    pub motion: f64,
    /// Exposures of the training cameras.
    pub exposure: f64,
}

/// Learning rates of a branch's attributes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GaussianRates {
    /// Centres, in world units.
    pub means: f64,
    /// Constant colour coefficient.
    pub sh_dc: f64,
    /// Higher colour coefficients.
    pub sh_rest: f64,
    /// Opacity logits.
    pub opacity: f64,
    /// Log-scales.
    pub scale: f64,
    /// Quaternions.
    pub rotation: f64,
    /// Mask logits.
    pub mask_logits: f64,
    /// Centres of lifetimes, in times between frames.
    pub time_centre: f64,
    /// Log-durations of lifetimes.
    pub duration: f64,
    /// Velocities, in world units.
    pub velocity: f64,
}

impl Rates {
    /// The rates at `step` (from 1) of a stage's counter, for a scene of the given extent.
    pub fn at(step: usize, extent: f64, config: &OptimConfig) -> Self {
        let horizon = config.decay_steps.0;
        let branch = |sh_rest| GaussianRates {
            means: config.means.at(step, horizon) * extent,
            sh_dc: config.sh_dc,
            sh_rest,
            opacity: config.opacity,
            scale: config.scale,
            rotation: config.rotation,
            mask_logits: config.mask_logits.at(step, horizon),
            time_centre: config.time_centre,
            duration: config.duration,
            velocity: config.velocity.at(step, horizon) * extent,
        };
        Self {
            dynamic: branch(config.dynamic_sh_rest.at(step, horizon)),
            static_: branch(config.static_sh_rest),
            deformation: config.deformation.at(step, horizon) * extent,
            mask_heads: config.mask_heads.at(step, horizon) * extent,
            grid: config.grid.at(step, horizon) * extent,
            motion: config.motion.at(step, horizon) * extent,
            exposure: config.exposure.at(step, horizon),
        }
    }
}

impl Rates {
    /// Converts the rates of lifetimes, which are given in frames, to a time with this spacing of frames.
    pub fn with_frame(mut self, spacing: f64) -> Self {
        for rates in [&mut self.dynamic, &mut self.static_] {
            rates.time_centre *= spacing;
            rates.velocity /= spacing;
        }
        self
    }
}

impl GaussianRates {
    /// The rate of an attribute.
    pub fn of(&self, attribute: Attribute) -> f64 {
        match attribute {
            Attribute::Means => self.means,
            Attribute::ShDc => self.sh_dc,
            Attribute::ShRest => self.sh_rest,
            Attribute::MaskLogits => self.mask_logits,
            Attribute::OpacityLogits => self.opacity,
            Attribute::LogScales => self.scale,
            Attribute::Quaternions => self.rotation,
            Attribute::TimeCentres => self.time_centre,
            Attribute::LogDurations => self.duration,
            Attribute::Velocities => self.velocity,
        }
    }
}
