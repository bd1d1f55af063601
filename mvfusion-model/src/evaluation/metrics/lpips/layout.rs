//! The networks of LPIPS: their layers and input ranges.

/// A network whose features are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Backbone {
    /// AlexNet, which the authors of LPIPS recommend for evaluation.
    Alex,
    /// VGG-16.
    Vgg,
}

/// The input range of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum InputRange {
    /// `[-1, 1]`, the intended range of the networks.
    Signed,
    /// `[0, 1]`, as in the code of 3DGS and its successors. These metrics are comparable only with each other.
    Raw,
}

/// A variant of LPIPS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LpipsVariant {
    /// The network.
    pub backbone: Backbone,
    /// The input range.
    pub range: InputRange,
}

impl LpipsVariant {
    /// All variants.
    pub const ALL: [Self; 4] = [Self::ALEX, Self::VGG, Self::ALEX_RAW, Self::VGG_RAW];
    /// AlexNet on `[-1, 1]`.
    pub const ALEX: Self = Self { backbone: Backbone::Alex, range: InputRange::Signed };
    /// VGG-16 on `[-1, 1]`.
    pub const VGG: Self = Self { backbone: Backbone::Vgg, range: InputRange::Signed };
    /// AlexNet on `[0, 1]`.
    pub const ALEX_RAW: Self = Self { backbone: Backbone::Alex, range: InputRange::Raw };
    /// VGG-16 on `[0, 1]`.
    pub const VGG_RAW: Self = Self { backbone: Backbone::Vgg, range: InputRange::Raw };
}

/// A convolution with bias, followed by a ReLU.
#[derive(Clone, Copy, Debug)]
pub struct ConvolutionLayout {
    /// Index of the layer in torchvision's `features`, which is its name in files.
    pub number: usize,
    /// Input and output channels.
    pub channels: [usize; 2],
    /// Side length of the kernel.
    pub kernel: usize,
    /// Distance between windows in pixels.
    pub stride: usize,
    /// Zero padding on each side.
    pub padding: usize,
}

/// Convolutions whose last output is compared, and the pooling before the next stage.
#[derive(Clone, Debug)]
pub struct StageLayout {
    /// First to last.
    pub convolutions: Vec<ConvolutionLayout>,
    /// Side length of the max pooling, with stride 2; `None` after the last stage.
    pub pool: Option<usize>,
}

impl Backbone {
    /// All networks.
    pub const ALL: [Self; 2] = [Self::Alex, Self::Vgg];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Alex => "alex",
            Self::Vgg => "vgg",
        }
    }

    /// Name for people.
    pub fn label(self) -> &'static str {
        match self {
            Self::Alex => "AlexNet",
            Self::Vgg => "VGG-16",
        }
    }

    /// The five stages.
    pub fn layout(self) -> Vec<StageLayout> {
        match self {
            Self::Alex => alex(),
            Self::Vgg => vgg(),
        }
    }
}

/// AlexNet as in torchvision. The last three convolutions are separate stages without pooling.
fn alex() -> Vec<StageLayout> {
    let stage = |number, channels, [kernel, stride, padding]: [usize; 3], pool| StageLayout {
        convolutions: vec![ConvolutionLayout { number, channels, kernel, stride, padding }],
        pool,
    };
    vec![
        stage(0, [3, 64], [11, 4, 2], Some(3)),
        stage(3, [64, 192], [5, 1, 2], Some(3)),
        stage(6, [192, 384], [3, 1, 1], None),
        stage(8, [384, 256], [3, 1, 1], None),
        stage(10, [256, 256], [3, 1, 1], None),
    ]
}

/// VGG-16: `relu1_2`, `relu2_2`, `relu3_3`, `relu4_3` and `relu5_3` are compared.
fn vgg() -> Vec<StageLayout> {
    let stage = |numbers: &[usize], inputs: usize, outputs: usize, pool| StageLayout {
        convolutions: numbers
            .iter()
            .enumerate()
            .map(|(place, &number)| ConvolutionLayout {
                number,
                channels: [if place == 0 { inputs } else { outputs }, outputs],
                kernel: 3,
                stride: 1,
                padding: 1,
            })
            .collect(),
        pool,
    };
    vec![
        stage(&[0, 2], 3, 64, Some(2)),
        stage(&[5, 7], 64, 128, Some(2)),
        stage(&[10, 12, 14], 128, 256, Some(2)),
        stage(&[17, 19, 21], 256, 512, Some(2)),
        stage(&[24, 26, 28], 512, 512, None),
    ]
}
