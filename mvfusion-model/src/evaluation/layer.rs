//! The layers of a model that can be rendered.

use std::fmt;

use crate::model::{DeformationLevel, Model};

/// A layer of a model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Layer {
    /// The whole model: both branches blended, or the only one.
    Composed,
    /// Only the static branch, without brightness control.
    Static,
    /// Only the dynamic branch.
    Dynamic,
    /// The share of the dynamic branch.
    Mask,
    /// The contribution of the static branch to the composed render: with brightness control, times its share.
    MaskedStatic,
    /// The contribution of the dynamic branch to the composed render. Both contributions add up to the composed render.
    MaskedDynamic,
    /// Depth of the composed render along the camera's axis, in world units. It is the sum of weighted depths divided
    /// by the sum of weights, both blended by the mask like the colours. 0 where nothing is rendered.
    Depth,
    /// Alpha of the composed render.
    Alpha,
    /// Motion intensity, rendered with the dynamic branch: the weighted sum of the spreads of position, scale and
    /// rotation.
    Motion,
    /// Spread of the positions over the trajectories, rendered with the dynamic branch.
    PositionVariance,
    /// Spread of the rotations.
    RotationVariance,
    /// Spread of the scales.
    ScaleVariance,
}

impl Layer {
    /// All layers.
    pub const ALL: [Self; 12] = [
        Self::Composed,
        Self::Static,
        Self::Dynamic,
        Self::Mask,
        Self::MaskedStatic,
        Self::MaskedDynamic,
        Self::Depth,
        Self::Alpha,
        Self::Motion,
        Self::PositionVariance,
        Self::RotationVariance,
        Self::ScaleVariance,
    ];

    /// Name on command lines and in files.
    pub const fn name(self) -> &'static str {
        self.name_and_label().0
    }

    /// Name in captions and reports.
    pub const fn label(self) -> &'static str {
        self.name_and_label().1
    }

    const fn name_and_label(self) -> (&'static str, &'static str) {
        match self {
            Self::Composed => ("composed", "composed"),
            Self::Static => ("static", "static branch"),
            Self::Dynamic => ("dynamic", "dynamic branch"),
            Self::Mask => ("mask", "mask"),
            Self::MaskedStatic => ("masked_static", "masked static"),
            Self::MaskedDynamic => ("masked_dynamic", "masked dynamic"),
            Self::Depth => ("depth", "depth"),
            Self::Alpha => ("alpha", "alpha"),
            Self::Motion => ("motion", "motion intensity"),
            Self::PositionVariance => ("position_variance", "variance of position"),
            Self::RotationVariance => ("rotation_variance", "variance of rotation"),
            Self::ScaleVariance => ("scale_variance", "variance of scale"),
        }
    }

    /// The layer of a name.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|layer| layer.name() == name)
    }

    /// Names of its channels in OpenEXR.
    pub fn channels(self) -> &'static [&'static str] {
        match self {
            Self::Composed | Self::Static | Self::Dynamic | Self::MaskedStatic | Self::MaskedDynamic => {
                &["R", "G", "B"]
            }
            Self::Depth => &["Z"],
            Self::Alpha => &["A"],
            Self::Mask | Self::Motion | Self::PositionVariance | Self::RotationVariance | Self::ScaleVariance => &["Y"],
        }
    }

    /// Whether it is a motion layer.
    pub fn is_motion(self) -> bool {
        matches!(self, Self::Motion | Self::PositionVariance | Self::RotationVariance | Self::ScaleVariance)
    }

    /// The reason why a model cannot render this layer; `None` if it can.
    pub fn lacking(self, model: &Model, level: DeformationLevel) -> Option<&'static str> {
        let of_two = matches!(self, Self::Static | Self::Mask | Self::MaskedStatic | Self::MaskedDynamic);
        if of_two && model.static_.is_none() {
            return Some("the model has no static branch and no mask");
        }
        (self.is_motion() && level == DeformationLevel::Still).then_some("nothing moves in the model")
    }

    /// The default layers of a model.
    pub fn usual(model: &Model, level: DeformationLevel) -> Vec<Self> {
        let two = [Self::Composed, Self::Static, Self::Dynamic, Self::Mask, Self::Depth, Self::Motion];
        let one = [Self::Composed, Self::Depth, Self::Motion];
        let usual: &[Self] = if model.static_.is_some() { &two } else { &one };
        usual.iter().copied().filter(|layer| layer.lacking(model, level).is_none()).collect()
    }
}

impl fmt::Display for Layer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_layer_is_found_by_its_name_and_no_other() {
        for layer in Layer::ALL {
            assert_eq!(Layer::of_name(layer.name()), Some(layer));
        }
        assert_eq!(Layer::of_name("gt"), None);
    }
}
