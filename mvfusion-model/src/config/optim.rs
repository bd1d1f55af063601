//! Learning rates (METHOD §4.5).

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Steps;
use super::keys::{Key, ListedKey, Range, keys};
use crate::ModelError;

/// Learning rates of all parameter groups (METHOD §4.5). Those marked "times the extent" are multiplied by the scene's
/// extent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OptimConfig {
    /// Centres of both branches; times the extent.
    pub means: Decay,
    /// Trunk and attribute heads; times the extent.
    pub deformation: Decay,
    /// Mask heads; times the extent. DeGauss: a hundredth of `deformation` for video, a tenth for photos.
    pub mask_heads: Decay,
    /// HexPlane cells; times the extent.
    pub grid: Decay,
    /// MVG and MFTA; times the extent (A22: as `deformation`).
    pub motion: Decay,
    /// Steps over which the learning rates with `start` and `end` change.
    pub decay_steps: Steps,
    /// Constant colour of both branches.
    pub sh_dc: f64,
    /// Higher colour coefficients of the dynamic branch.
    pub dynamic_sh_rest: Decay,
    /// Mask logits; in DeGauss they are part of the higher colour coefficients, with the same rate.
    pub mask_logits: Decay,
    /// Higher colour coefficients of the static branch.
    pub static_sh_rest: f64,
    /// Opacity logits.
    pub opacity: f64,
    /// Log-scales.
    pub scale: f64,
    /// Quaternions.
    pub rotation: f64,
    /// Temporal centres of lifetimes, in frames; with `model.lifetime`. Ours.
    pub time_centre: f64,
    /// Log-durations of lifetimes. Ours.
    pub duration: f64,
    /// Velocities of lifetimes, per frame; times the extent. Ours.
    pub velocity: Decay,
    /// Exposures of the training cameras; with `model.exposure`. Ours; 3DGS: 0.01 to 0.001, for maps that are used once
    /// per round.
    pub exposure: Decay,
    /// Decay of Adam's first moment.
    pub beta1: f64,
    /// Decay of Adam's second moment.
    pub beta2: f64,
    /// Adam's epsilon (3DGS: 1e-15).
    pub epsilon: f64,
}

/// A learning rate that changes log-linearly from `start` to `end` (METHOD §4.5). A `start` of 0 is off: the rate is
/// always 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Decay {
    /// Rate at the first step.
    pub start: f64,
    /// Rate at the end of the horizon and after it; above 0, unless `start` is 0.
    pub end: f64,
}

impl Decay {
    /// The rate at `step` of `horizon` steps: `exp((1 - tau) ln start + tau ln end)`, `tau` clipped to `[0, 1]`.
    pub fn at(&self, step: usize, horizon: usize) -> f64 {
        if self.start == 0.0 {
            return 0.0;
        }
        let tau = (step as f64 / horizon.max(1) as f64).clamp(0.0, 1.0);
        ((1.0 - tau) * self.start.ln() + tau * self.end.ln()).exp()
    }

    fn times(self, factor: f64) -> Self {
        Self { start: self.start * factor, end: self.end * factor }
    }
}

impl OptimConfig {
    /// Raises the end of every decaying learning rate to at least `share` of its start.
    pub(super) fn end_above(&mut self, share: f64) {
        for decay in self.decays() {
            decay.end = decay.end.max((share * decay.start).min(decay.start));
        }
    }

    /// Multiplies all learning rates except two. Opacities already cross their range in a hundred steps. The motion
    /// modules start without effect and must not disturb the base deformation. The mask logits have a separate factor.
    pub(super) fn faster(&mut self, factor: f64, of_mask_logits: f64) {
        let (motion, mask_logits) = (self.motion, self.mask_logits.times(of_mask_logits));
        for decay in self.decays() {
            *decay = decay.times(factor);
        }
        (self.motion, self.mask_logits) = (motion, mask_logits);
        let constant = [
            &mut self.sh_dc,
            &mut self.static_sh_rest,
            &mut self.scale,
            &mut self.rotation,
            &mut self.time_centre,
            &mut self.duration,
        ];
        constant.into_iter().for_each(|rate| *rate *= factor);
    }

    /// The learning rates that follow a schedule.
    pub(super) fn decays(&mut self) -> [&mut Decay; 9] {
        [
            &mut self.means,
            &mut self.deformation,
            &mut self.mask_heads,
            &mut self.grid,
            &mut self.motion,
            &mut self.dynamic_sh_rest,
            &mut self.mask_logits,
            &mut self.velocity,
            &mut self.exposure,
        ]
    }
}

impl Default for OptimConfig {
    fn default() -> Self {
        Self {
            means: Decay { start: 1.6e-4, end: 1.6e-6 },
            deformation: Decay { start: 1.6e-4, end: 1.6e-5 },
            mask_heads: Decay { start: 1.6e-6, end: 1.6e-7 },
            grid: Decay { start: 8e-4, end: 5e-6 },
            motion: Decay { start: 1.6e-4, end: 1.6e-5 },
            decay_steps: Steps(20_000),
            sh_dc: 0.0025,
            dynamic_sh_rest: Decay { start: 0.0025 / 8.0, end: 0.0025 / 20.0 },
            mask_logits: Decay { start: 0.0025 / 8.0, end: 0.0025 / 20.0 },
            static_sh_rest: 0.0025 / 20.0,
            opacity: 0.05,
            scale: 0.005,
            rotation: 0.001,
            time_centre: 2.5e-3,
            duration: 0.005,
            velocity: Decay { start: 7e-5, end: 7e-7 },
            exposure: Decay { start: 2e-3, end: 2e-4 },
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-15,
        }
    }
}

keys!(OptimConfig {
    means: RATE,
    deformation: RATE,
    mask_heads: RATE,
    grid: RATE.to(0.3),
    motion: RATE,
    decay_steps: INTERVAL,
    sh_dc: RATE,
    dynamic_sh_rest: RATE,
    mask_logits: RATE.to(1e3),
    static_sh_rest: RATE,
    opacity: RATE,
    scale: RATE,
    rotation: RATE,
    time_centre: RATE,
    duration: RATE,
    velocity: RATE,
    exposure: RATE,
    beta1: DECAY,
    beta2: DECAY,
    epsilon: ABOVE_0.to(1.0),
});

impl Decay {
    /// The range of the end, given that of the start.
    fn end_range(&self, range: Range) -> Range {
        match self.start {
            0.0 => range,
            _ => Range::ABOVE_0.to(range.most).saying("a rate that falls log-linearly ends above 0"),
        }
    }
}

impl Key for Decay {
    fn check(&self, key: &str, range: Range) -> Result<(), ModelError> {
        self.start.check(&format!("{key}.start"), range)?;
        self.end.check(&format!("{key}.end"), self.end_range(range))
    }

    fn list(&self, key: &str, range: Range, listed: &mut Vec<ListedKey>) {
        listed.push(ListedKey::other(key));
        self.start.list(&format!("{key}.start"), range, listed);
        self.end.list(&format!("{key}.end"), self.end_range(range), listed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_falls_log_linearly_and_then_stays() {
        let rate = Decay { start: 1e-2, end: 1e-4 };
        assert!((rate.at(50, 100) - 1e-3).abs() < 1e-15);
        assert_eq!(rate.at(100, 100), rate.at(1000, 100));
    }

    #[test]
    fn a_rate_that_starts_at_0_is_off_to_the_end_of_the_run_and_beyond() {
        for end in [0.0, 1e-4] {
            let rate = Decay { start: 0.0, end };
            for step in [0, 1, 50, 99, 100, 101, 1000] {
                assert_eq!(rate.at(step, 100), 0.0, "step {step}");
            }
        }
    }
}
