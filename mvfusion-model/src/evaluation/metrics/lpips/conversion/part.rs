//! The parts of a network's weights: each is published in a file of its own.

use super::super::layout::Backbone;

/// A part of the weights of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Part {
    /// The network.
    pub backbone: Backbone,
    /// Which of its layers.
    pub kind: PartKind,
}

/// Layers that are published together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum PartKind {
    /// The convolutions, which torchvision publishes.
    Convolutions,
    /// The linear layers, which the package lpips contains.
    Linear,
}

/// A tensor under its name in the published file and under ours.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct TensorNames {
    pub published: String,
    pub own: String,
    pub shape: Vec<usize>,
}

impl Part {
    /// All parts.
    pub const ALL: [Self; 4] = [
        Self { backbone: Backbone::Alex, kind: PartKind::Convolutions },
        Self { backbone: Backbone::Alex, kind: PartKind::Linear },
        Self { backbone: Backbone::Vgg, kind: PartKind::Convolutions },
        Self { backbone: Backbone::Vgg, kind: PartKind::Linear },
    ];

    /// In words: `the convolutions of AlexNet`.
    pub fn words(self) -> String {
        format!("the {} of {}", self.kind.words(), self.backbone.label())
    }

    /// Where people get the file.
    pub fn source(self) -> String {
        let Self { backbone, kind } = self;
        match (kind, backbone) {
            (PartKind::Convolutions, Backbone::Alex) => {
                "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth".to_owned()
            }
            (PartKind::Convolutions, Backbone::Vgg) => {
                "https://download.pytorch.org/models/vgg16-397923af.pth".to_owned()
            }
            (PartKind::Linear, _) => format!(
                "the wheel that `pip download --no-deps lpips` fetches, or \
                 https://github.com/richzhang/PerceptualSimilarity/raw/master/lpips/weights/v0.1/{}.pth",
                backbone.name()
            ),
        }
    }

    /// Its tensors.
    pub(super) fn tensors(self) -> Vec<TensorNames> {
        let stages = self.backbone.layout();
        match self.kind {
            PartKind::Convolutions => stages
                .iter()
                .flat_map(|stage| &stage.convolutions)
                .flat_map(|layer| {
                    let [inputs, outputs] = layer.channels;
                    [("weight", vec![outputs, inputs, layer.kernel, layer.kernel]), ("bias", vec![outputs])].map(
                        |(kind, shape)| {
                            let name = format!("features.{}.{kind}", layer.number);
                            TensorNames { published: name.clone(), own: name, shape }
                        },
                    )
                })
                .collect(),
            PartKind::Linear => stages
                .iter()
                .enumerate()
                .map(|(number, stage)| {
                    let channels = stage.convolutions.last().map_or(0, |last| last.channels[1]);
                    TensorNames {
                        published: format!("lin{number}.model.1.weight"),
                        own: format!("lin{number}.weight"),
                        shape: vec![1, channels, 1, 1],
                    }
                })
                .collect(),
        }
    }
}

impl PartKind {
    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Convolutions => "convolutions",
            Self::Linear => "linear layers",
        }
    }
}
