//! Contradictory switches of the motion modules.

use serde::Serialize;

use super::{Descriptor, MotionConfig, Temporal, TokenMode, TokenOffset, TokenValues};

/// A key whose value has no effect or no meaning because of another key.
pub(super) struct Contradiction {
    /// The dotted key.
    pub key: &'static str,
    /// Its value.
    pub value: String,
    /// The other key, and the remedy.
    pub reason: &'static str,
}

impl MotionConfig {
    /// The first contradiction among the switches.
    pub(super) fn contradiction(&self) -> Option<Contradiction> {
        let is_cross = self.temporal == Temporal::Cross;
        let attends = is_cross || matches!(self.temporal, Temporal::SelfAttention | Temporal::Spatial);
        let contradictions = [
            (
                !self.mvg && self.descriptor != Descriptor::default(),
                "motion.descriptor",
                written(&self.descriptor),
                "`motion.mvg` is off, so nothing is shown it; switch that on or leave this key at its default",
            ),
            (!self.mfta && !is_cross, "motion.temporal", written(&self.temporal), NO_TOKENS),
            (
                !self.mfta && self.token_offset != TokenOffset::default(),
                "motion.token_offset",
                written(&self.token_offset),
                NO_TOKENS,
            ),
            (!self.mfta && self.values != TokenValues::default(), "motion.values", written(&self.values), NO_TOKENS),
            (!self.mfta && self.residual, "motion.residual", self.residual.to_string(), NO_TOKENS),
            (
                self.include_self && !is_cross,
                "motion.include_self",
                self.include_self.to_string(),
                "it is a switch of cross-attention; every other `motion.temporal` reads the current frame anyway",
            ),
            (
                self.token_offset != TokenOffset::default() && !attends,
                "motion.token_offset",
                written(&self.token_offset),
                "without attention, the distances are the same for all Gaussians; give another `motion.temporal`",
            ),
            (
                self.values != TokenValues::default() && !is_cross,
                "motion.values",
                written(&self.values),
                "only cross-attention over frames has differences in time; leave `motion.temporal` at its default",
            ),
            (
                self.values != TokenValues::default() && self.include_self,
                "motion.values",
                written(&self.values),
                "the current frame has no difference from itself; switch `motion.include_self` off",
            ),
            (
                self.residual && !(is_cross || self.temporal == Temporal::Spatial),
                "motion.residual",
                self.residual.to_string(),
                "it needs one current token that attends to others; give `cross` or `spatial` as `motion.temporal`",
            ),
            (
                self.tokens == TokenMode::FullWindow && self.temporal == Temporal::Convolution,
                "motion.tokens",
                written(&self.tokens),
                "the convolution has a tap for each token of a triple; give `triple` or another `motion.temporal`",
            ),
            (
                self.tokens == TokenMode::FullWindow && self.temporal == Temporal::Spatial,
                "motion.tokens",
                written(&self.tokens),
                "the neighbours are at the same time; `motion.neighbours` is their number",
            ),
        ];
        first_of(contradictions)
    }

    /// The first switch of the tokens that has no effect without MFTA. Former versions accepted it.
    pub(super) fn idle_switch(&self) -> Option<Contradiction> {
        let has_none = !self.mfta;
        first_of([
            (has_none && self.include_self, "motion.include_self", self.include_self.to_string(), NO_TOKENS),
            (has_none && self.tokens != TokenMode::Triple, "motion.tokens", written(&self.tokens), NO_TOKENS),
            (
                has_none && self.neighbour_gradient,
                "motion.neighbour_gradient",
                self.neighbour_gradient.to_string(),
                NO_TOKENS,
            ),
        ])
    }
}

/// The first contradiction that is one.
fn first_of<const N: usize>(all: [(bool, &'static str, String, &'static str); N]) -> Option<Contradiction> {
    let mut found = all.into_iter().filter(|&(is_contradiction, ..)| is_contradiction);
    found.next().map(|(_, key, value, reason)| Contradiction { key, value, reason })
}

/// Why a switch of the tokens has no effect without MFTA.
const NO_TOKENS: &str = "`motion.mfta` is off, so there are no tokens; switch that on or leave this key at its default";

/// A value as written in a configuration file.
fn written(value: &impl Serialize) -> String {
    serde_json::to_string(value).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;

    /// The error for a configuration with these switches.
    fn refusal(switch: impl Fn(&mut MotionConfig)) -> Option<String> {
        let mut config = Config::default();
        switch(&mut config.motion);
        config.check().err().map(|error| error.to_string())
    }

    #[track_caller]
    fn assert_refused(switch: impl Fn(&mut MotionConfig), said: &str) {
        let refusal = refusal(switch).expect("it is refused");
        assert!(refusal.starts_with(said), "{refusal}");
    }

    #[test]
    fn a_descriptor_needs_mvg() {
        for (descriptor, name) in [
            (Descriptor::PositionVariance, "position_variance"),
            (Descriptor::Offsets, "offsets"),
            (Descriptor::Momentary, "momentary"),
        ] {
            assert_eq!(refusal(|motion| motion.descriptor = descriptor), None);
            let said = format!("`motion.descriptor` is \"{name}\": `motion.mvg` is off");
            assert_refused(|motion| (motion.mvg, motion.descriptor) = (false, descriptor), &said);
        }
        assert_eq!(refusal(|motion| motion.mvg = false), None);
    }

    #[test]
    fn a_kind_of_temporal_module_needs_mfta() {
        for (temporal, name) in [
            (Temporal::SelfAttention, "self_attention"),
            (Temporal::Average, "average"),
            (Temporal::Convolution, "convolution"),
            (Temporal::Spatial, "spatial"),
        ] {
            assert_eq!(refusal(|motion| motion.temporal = temporal), None);
            let said = format!("`motion.temporal` is \"{name}\": `motion.mfta` is off");
            assert_refused(|motion| (motion.mfta, motion.temporal) = (false, temporal), &said);
        }
        assert_eq!(refusal(|motion| motion.mfta = false), None);
    }

    #[test]
    fn what_concerns_tokens_alone_needs_mfta() {
        for (switch, said) in [
            ((|motion| motion.include_self = true) as fn(&mut MotionConfig), "`motion.include_self` is true"),
            (|motion| motion.tokens = TokenMode::FullWindow, "`motion.tokens` is \"full_window\""),
            (|motion| motion.neighbour_gradient = true, "`motion.neighbour_gradient` is true"),
        ] {
            assert_eq!(refusal(switch), None);
            let without = |motion: &mut MotionConfig| (switch(motion), motion.mfta = false).1;
            assert_refused(without, &format!("{said}: `motion.mfta` is off"));
            let mut old = Config::default();
            without(&mut old.motion);
            assert!(old.check_of_run().is_ok(), "{said}: runs of former versions can still be opened");
        }
    }

    #[test]
    fn only_cross_attention_can_include_the_current_frame() {
        assert_eq!(refusal(|motion| motion.include_self = true), None);
        for temporal in [Temporal::SelfAttention, Temporal::Average, Temporal::Convolution] {
            assert_refused(
                |motion| (motion.include_self, motion.temporal) = (true, temporal),
                "`motion.include_self` is true: it is a switch of cross-attention",
            );
        }
    }

    #[test]
    fn a_convolution_reads_a_triple() {
        for temporal in [Temporal::Cross, Temporal::SelfAttention, Temporal::Average] {
            assert_eq!(refusal(|motion| (motion.tokens, motion.temporal) = (TokenMode::FullWindow, temporal)), None);
        }
        assert_refused(
            |motion| (motion.tokens, motion.temporal) = (TokenMode::FullWindow, Temporal::Convolution),
            "`motion.tokens` is \"full_window\": the convolution",
        );
    }

    #[test]
    fn what_is_said_of_tokens_needs_tokens_that_attend() {
        type Form = (fn(&mut MotionConfig), &'static str);
        let forms: [Form; 3] = [
            (|motion| motion.token_offset = TokenOffset::Sines, "`motion.token_offset` is \"sines\""),
            (|motion| motion.values = TokenValues::Velocities, "`motion.values` is \"velocities\""),
            (|motion| motion.residual = true, "`motion.residual` is true"),
        ];
        for (form, said) in forms {
            assert_eq!(refusal(form), None);
            for temporal in [Temporal::Average, Temporal::Convolution] {
                assert_refused(|motion| (form(motion), motion.temporal = temporal).1, said);
            }
            assert_refused(|motion| (form(motion), motion.mfta = false).1, &format!("{said}: `motion.mfta` is off"));
        }
        assert_refused(
            |motion| (motion.values, motion.temporal) = (TokenValues::Velocities, Temporal::Spatial),
            "`motion.values` is \"velocities\": only cross-attention over frames",
        );
        assert_refused(
            |motion| (motion.values, motion.include_self) = (TokenValues::Velocities, true),
            "`motion.values` is \"velocities\": the current frame",
        );
        assert_refused(
            |motion| (motion.tokens, motion.temporal) = (TokenMode::FullWindow, Temporal::Spatial),
            "`motion.tokens` is \"full_window\": the neighbours are at the same time",
        );
    }
}
