//! The networks of LPIPS: which layers they have, and what they are fed.

/// A network whose features are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Backbone {
    /// AlexNet, the one that the authors of LPIPS recommend for judging.
    Alex,
    /// VGG-16.
    Vgg,
}

/// The numbers that a network is fed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum InputRange {
    /// `[-1, 1]`, for which the networks were made.
    Signed,
    /// `[0, 1]`: what the code of 3DGS and its descendants feeds. Such metrics are comparable among themselves alone.
    Raw,
}

/// A kind of LPIPS metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LpipsVariant {
    /// The network.
    pub backbone: Backbone,
    /// What it is fed.
    pub range: InputRange,
}

impl LpipsVariant {
    /// All kinds.
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

/// A convolution with bias, ReLU behind it.
#[derive(Clone, Copy, Debug)]
pub struct ConvolutionLayout {
    /// Number of the layer in torchvision's `features`, by which files name it.
    pub number: usize,
    /// Channels in and out.
    pub channels: [usize; 2],
    /// Side of the kernel.
    pub kernel: usize,
    /// Pixels from one window to the next.
    pub stride: usize,
    /// Zeros on each side.
    pub padding: usize,
}

/// Convolutions whose last output is compared, and the pooling before the next ones.
#[derive(Clone, Debug)]
pub struct StageLayout {
    /// First to last.
    pub convolutions: Vec<ConvolutionLayout>,
    /// Maximum over windows of this side, stride 2; none behind the last stage.
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

    /// The five stages.
    pub fn layout(self) -> Vec<StageLayout> {
        match self {
            Self::Alex => alex(),
            Self::Vgg => vgg(),
        }
    }
}

/// AlexNet as torchvision has it. The last three convolutions are compared one by one, without pooling between.
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
