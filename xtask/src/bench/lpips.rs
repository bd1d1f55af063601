//! LPIPS of a pair of pictures: both pass through the network, without gradients.

use std::fmt::{self, Display};
use std::str::FromStr;

use anyhow::{Context, Error, Result, ensure};
use burn::tensor::{Tensor, TensorData};
use clap::Args;
use mvfusion_model::Device;
use mvfusion_model::evaluation::{Backbone, InputRange, Lpips};
use mvfusion_model::random::Stream;

use super::{Row, Seconds, Subjected, medians, timed};

/// What to compare.
#[derive(Debug, Args)]
pub struct LpipsArguments {
    /// Sizes of pictures as WIDTHxHEIGHT.
    #[arg(long = "size", value_delimiter = ',', default_values = ["320x180"])]
    sizes: Vec<Size>,
    /// Network: alex or vgg.
    #[arg(long, default_value = "vgg")]
    network: String,
}

/// Pixels of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Size {
    width: usize,
    height: usize,
}

impl FromStr for Size {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let read = || {
            let (width, height) = text.split_once('x')?;
            Some(Self { width: width.parse().ok()?, height: height.parse().ok()? })
        };
        read().with_context(|| format!("`{text}` is no size; write WIDTHxHEIGHT, as 320x180"))
    }
}

impl Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// Measures every size on every device.
pub fn measure(
    arguments: &LpipsArguments,
    devices: &[Subjected],
    repeat: usize,
    note: &mut impl FnMut(Row),
) -> Result<()> {
    let backbone = Backbone::ALL.into_iter().find(|backbone| backbone.name() == arguments.network);
    let backbone = backbone.with_context(|| format!("there is no network `{}`", arguments.network))?;
    let network = |subject: &Subjected| Lpips::random(backbone, &mut Stream::new(1, 0), &subject.device);
    let networks: Vec<Lpips> = devices.iter().map(network).collect();
    for size in &arguments.sizes {
        let times = medians(devices.len(), repeat, |subject| {
            let device = &devices[subject].device;
            let pictures = noise(size, device);
            let (seconds, distances) =
                timed(device, || networks[subject].distances(pictures, InputRange::Signed, &[(0, 1)]))?;
            ensure!(distances.is_some(), "pictures of {size} are too small for the network");
            Ok([seconds])
        })?;
        for (Subjected { name, .. }, [seconds]) in devices.iter().zip(times) {
            note(Row {
                scene: format!("LPIPS-{} of a pair of {size}", backbone.name()),
                device: name.clone(),
                threads: rayon::current_num_threads(),
                seconds: Seconds::Whole(seconds),
                pairs: None,
                peak_bytes: None,
            });
        }
    }
    Ok(())
}

/// Two pictures, `[2, 3, H, W]`.
fn noise(size: &Size, device: &Device) -> Tensor<4> {
    let mut stream = Stream::new(2, 0);
    let values: Vec<f32> = (0..6 * size.width * size.height).map(|_| stream.unit() as f32).collect();
    Tensor::from_data(TensorData::new(values, [2, 3, size.height, size.width]), device)
}
