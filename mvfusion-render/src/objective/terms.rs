//! The weights of the terms, and what selects their pixels.

use crate::window::Window;

/// The weights of the picture terms (METHOD §4.4), finite and not below 0. A term with weight 0 contributes
/// nothing; a similarity, the entropy and the smoothness are then not computed. Means include all pixels, also where an
/// indicator is 0.
///
/// In the formulas, `d` is the clamped render of the dynamic branch, `l` that of the static branch with brightness `b`
/// and clamped, `m` and `n` are their shares, `c = m d + n l` is the composed render, `p` the photo, `S` is SSIM and `K`
/// its structure term. Indicators have no gradient. Of the fields, those up to `static_above` make up the main loss, the
/// rest the light loss.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectiveTerms {
    /// The normalisation of the mask.
    pub normalisation: MaskNormalisation,
    /// The scene's extent, which divides depths.
    pub extent: f64,
    /// Whether the dynamic branch learns around moving pixels, instead of everywhere or by `dynamic_above`.
    pub dynamic_region: bool,
    /// Whether the colours of the static branch learn only where nothing moves.
    pub static_region: bool,
    /// The window of SSIM.
    pub ssim: Window,
    /// The window of the structure term.
    pub structure: Window,

    /// The terms of the first stage.
    pub geometry: Option<GeometryTerms>,
    /// `|c - p|`.
    pub composed_l1: f64,
    /// Distance of the dynamic depth behind the static one where the mask is surely dynamic.
    pub depth_back: f64,
    /// Whether that term has no gradient for the static depth.
    pub depth_back_detached: bool,
    /// Distance of the static depth behind the dynamic one where the mask is not above its lower bound.
    pub depth_forward: f64,
    /// Edge-aware total variation of the static depth.
    pub depth_smooth: f64,
    /// `K(d, l)` where the mask is dynamic, without gradient for `l`.
    pub likeness: f64,
    /// `1 - S(d, p)` and `1 - S(l, p)`, each where its branch answers for the pixel.
    pub branch_dssim: f64,
    /// `|d - p|` and `|l - p|` there.
    pub branch_l1: f64,
    /// Share above which the dynamic branch answers, without `dynamic_region`.
    pub dynamic_above: f64,
    /// Share above which the static branch answers.
    pub static_above: f64,

    /// `1 - S(c, p)`.
    pub composed_dssim: f64,
    /// `|b - 1|`.
    pub brightness: f64,
    /// `|l - p|`, with gradient for the brightness alone.
    pub explicit_brightness: f64,
    /// Entropy of the mask.
    pub entropy: f64,
    /// `(1 - m)` at moving pixels.
    pub mask_motion: f64,
    /// `m` away from moving pixels.
    pub mask_still: f64,
}

/// The terms of the first stage, in which each branch must match the photo on its own.
#[derive(Clone, Debug, PartialEq)]
pub struct GeometryTerms {
    /// `|x - 0.9 p|` with a mixture `x` of both branches, and `|l - p|`.
    pub l1: f64,
    /// `1 - S(d, p)` and `1 - S(l, p)`.
    pub dssim: f64,
    /// Whether the mixture is the mean of both branches, instead of that by their shares. The static branch has no
    /// gradient in it.
    pub mean: bool,
}

/// The normalisation of the mask (METHOD §1.3).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskNormalisation {
    /// First stage: biased towards the background.
    Geometry,
    /// First stage as in the original code, unclamped (METHOD §12, item 6).
    GeometryUnclamped,
    /// Later stages.
    Deformation,
}

impl ObjectiveTerms {
    /// All weights, by the names of their fields.
    pub(super) fn weights(&self) -> [(&'static str, f64); 15] {
        let geometry = |of: fn(&GeometryTerms) -> f64| self.geometry.as_ref().map_or(0.0, of);
        [
            ("geometry.l1", geometry(|terms| terms.l1)),
            ("geometry.dssim", geometry(|terms| terms.dssim)),
            ("composed_l1", self.composed_l1),
            ("depth_back", self.depth_back),
            ("depth_forward", self.depth_forward),
            ("depth_smooth", self.depth_smooth),
            ("likeness", self.likeness),
            ("branch_dssim", self.branch_dssim),
            ("branch_l1", self.branch_l1),
            ("composed_dssim", self.composed_dssim),
            ("brightness", self.brightness),
            ("explicit_brightness", self.explicit_brightness),
            ("entropy", self.entropy),
            ("mask_motion", self.mask_motion),
            ("mask_still", self.mask_still),
        ]
    }

    /// The windows over which pictures are compared, by the names of their fields.
    pub(super) fn windows(&self) -> [Option<(&'static str, &Window)>; 2] {
        [
            self.compares_with_photo().then_some(("ssim", &self.ssim)),
            self.compares_branches().then_some(("structure", &self.structure)),
        ]
    }

    /// Whether SSIM of any picture is needed.
    pub(crate) fn compares_with_photo(&self) -> bool {
        self.branch_similarity() || self.composed_dssim > 0.0
    }

    /// Whether the structure term of both branches is needed.
    pub(crate) fn compares_branches(&self) -> bool {
        self.likeness > 0.0
    }

    /// Whether SSIM of each branch is needed.
    pub(crate) fn branch_similarity(&self) -> bool {
        self.branch_dssim > 0.0 || self.geometry.as_ref().is_some_and(|geometry| geometry.dssim > 0.0)
    }
}
