//! The kinds of images that an evaluation writes, each with its folder and label.

use mvfusion_model::evaluation::Layer;

/// The contents of an image of a held-out view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PictureKind {
    /// The photo.
    GroundTruth,
    /// A layer of the model.
    Model(Layer),
    /// The true background, if the scene provides it.
    TrueBackground,
    /// The true mask of moving objects, if the scene provides it.
    TrueMask,
}

impl PictureKind {
    /// The ground truth and the layers of the model, in the order of a row of the report.
    pub const IMAGES: [Self; 10] = [
        Self::GroundTruth,
        Self::Model(Layer::Composed),
        Self::Model(Layer::Static),
        Self::Model(Layer::Dynamic),
        Self::Model(Layer::Mask),
        Self::Model(Layer::MaskedStatic),
        Self::Model(Layer::MaskedDynamic),
        Self::Model(Layer::Depth),
        Self::TrueBackground,
        Self::TrueMask,
    ];

    /// The heat maps of motion, in the order of a row of the report.
    pub const HEAT_MAPS: [Self; 4] = [
        Self::Model(Layer::Motion),
        Self::Model(Layer::PositionVariance),
        Self::Model(Layer::RotationVariance),
        Self::Model(Layer::ScaleVariance),
    ];

    /// The folder of these images within `renders/test`.
    pub const fn folder(self) -> &'static str {
        match self {
            Self::GroundTruth => "gt",
            Self::Model(layer) => layer.name(),
            Self::TrueBackground => "true_background",
            Self::TrueMask => "true_mask",
        }
    }

    /// The label for captions.
    pub const fn label(self) -> &'static str {
        match self {
            Self::GroundTruth => "ground truth",
            Self::Model(layer) => layer.label(),
            Self::TrueBackground => "true background",
            Self::TrueMask => "true mask",
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_kind_has_a_folder_and_a_label_of_its_own() {
        let kinds = [&PictureKind::IMAGES[..], &PictureKind::HEAT_MAPS[..]].concat();
        for name in [PictureKind::folder, PictureKind::label] {
            assert_eq!(kinds.iter().map(|kind| name(*kind)).collect::<BTreeSet<_>>().len(), kinds.len());
        }
    }
}
