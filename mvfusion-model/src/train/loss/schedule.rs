//! The schedule of the loss terms and their weights.

/// The position in training, for the losses (METHOD §4.4).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossSchedule {
    /// Whether this is the first stage, without deformation.
    pub geometry: bool,
    /// Step within the counter of the stage, from 1.
    pub step: usize,
    /// Steps of the deformation and refinement stages together.
    pub total: usize,
    /// Step at which densification ends; 0 without densification.
    pub densify_until: usize,
    /// Brightness weight at that step, or at the end of the run without densification.
    pub brightness_end: f64,
}

/// Brightness weight when the ramp starts.
const BRIGHTNESS_START: f64 = 0.001;

/// Steps between computations of the term against spiky Gaussians.
const SPIKY_INTERVAL: usize = 10;

/// Below this brightness weight, the difference is the weight of the explicit brightness term.
const EXPLICIT_BELOW: f64 = 0.01;

impl LossSchedule {
    /// Step at which the brightness ramp reaches its end weight.
    fn ramp_end(&self) -> usize {
        if self.densify_until == 0 { self.total } else { self.densify_until }
    }

    /// Start of the brightness ramp: a tenth of it.
    fn ramp_start(&self) -> usize {
        self.ramp_end() / 10
    }

    /// The ramp `omega(it)`: linear, also beyond its end, but never below 0, where a small end would lead.
    fn ramp(&self) -> f64 {
        let start = self.ramp_start() as f64;
        let length = (self.ramp_end() as f64 - start).max(1.0);
        let ramp = BRIGHTNESS_START + (self.brightness_end - BRIGHTNESS_START) * (self.step as f64 - start) / length;
        ramp.max(0.0)
    }

    /// Weight that pulls the brightness to 1, in addition to the constant weight.
    pub fn brightness_weight(&self) -> f64 {
        if !self.geometry && self.step > self.ramp_start() { self.ramp() } else { 0.0 }
    }

    /// Weight of the brightened background against the photo: `explicit` at first. 0 switches the term off.
    pub fn explicit_weight(&self, explicit: f64) -> f64 {
        if explicit == 0.0 || self.step <= self.ramp_start() {
            explicit
        } else {
            (EXPLICIT_BELOW - self.ramp()).max(0.0)
        }
    }

    /// Whether the entropy term is active.
    pub fn entropy(&self) -> bool {
        self.step > self.total / 2
    }

    /// Whether the term against spiky Gaussians is computed in this step.
    pub fn spiky(&self) -> bool {
        self.step.is_multiple_of(SPIKY_INTERVAL)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_weight_of_the_brightness_is_negative_and_zero_switches_the_explicit_term_off() {
        let at = |step, brightness_end| LossSchedule {
            geometry: false,
            step,
            total: 300,
            densify_until: 100,
            brightness_end,
        };
        assert_eq!(at(290, 0.0).brightness_weight(), 0.0);
        assert!(at(290, 0.5).brightness_weight() > 0.5, "the ramp goes on");
        assert_eq!([5, 50].map(|step| at(step, 0.0).explicit_weight(0.0)), [0.0; 2]);
        assert!(at(50, 0.0).explicit_weight(0.01) > 0.0);
    }

    #[test]
    fn without_densification_the_brightness_weight_grows_over_the_run() {
        let at = |step| LossSchedule { geometry: false, step, total: 300, densify_until: 0, brightness_end: 0.5 };
        assert_eq!(at(30).brightness_weight(), 0.0);
        assert!((at(300).brightness_weight() - 0.5).abs() < 1e-12);
    }
}
