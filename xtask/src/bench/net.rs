//! The deformation network at the size of DeGauss' video configuration: width 128, 16 features, scales 1, 2, 4.

use anyhow::Result;
use burn::tensor::{DType, Tensor, TensorData};
use clap::Args;
use mvfusion_model::Device;
use mvfusion_model::config::GridConfig;
use mvfusion_model::model::network::{DeformationConfig, DeformationNetwork, HeadChoice, ModuleInit};
use mvfusion_model::random::Stream;
use mvfusion_render::grid::GridBounds;

use super::{Row, Seconds, Subjected, medians, timed};

/// Width of trunk and heads.
const WIDTH: usize = 128;

/// How many points to look up and decode.
#[derive(Debug, Args)]
pub struct NetArguments {
    /// Numbers of Gaussians.
    #[arg(long, value_delimiter = ',', default_values_t = [10_000, 30_000])]
    gaussians: Vec<usize>,
}

/// Measures every size on every device.
pub fn measure(
    arguments: &NetArguments,
    devices: &[Subjected],
    repeat: usize,
    note: &mut impl FnMut(Row),
) -> Result<()> {
    let tracking: Vec<Device> = devices.iter().map(|subject| subject.device.clone().autodiff()).collect();
    let networks: Vec<DeformationNetwork> = tracking.iter().map(network).collect();
    let parts: [(&str, Part); 2] = [("look-up", look_up), ("net", decode)];
    for &count in &arguments.gaussians {
        for (part, work) in parts {
            let times =
                medians(devices.len(), repeat, |subject| step(&networks[subject], count, &tracking[subject], work))?;
            for (Subjected { name, .. }, [forward, backward]) in devices.iter().zip(times) {
                note(Row {
                    scene: format!("{part} {count} Gaussians"),
                    device: name.clone(),
                    threads: rayon::current_num_threads(),
                    seconds: Seconds::Passes { render: None, forward, backward },
                    pairs: None,
                    peak_bytes: None,
                });
            }
        }
    }
    Ok(())
}

fn network(device: &Device) -> DeformationNetwork {
    let mut stream = Stream::new(1, 0);
    let mut init = ModuleInit { device, dtype: DType::F32, stream: &mut stream };
    let config = DeformationConfig {
        layout: GridConfig::default().layout(),
        bounds: GridBounds { min: [-1.0; 3], max: [1.0; 3] },
        width: WIDTH,
        depth: 1,
        heads: HeadChoice::ALL,
    };
    config.init(&mut init)
}

/// What is timed of the network: from points and a time to a loss.
type Part = fn(&DeformationNetwork, Tensor<2>, Tensor<2>) -> Tensor<1>;

/// The features of all planes alone.
fn look_up(network: &DeformationNetwork, points: Tensor<2>, time: Tensor<2>) -> Tensor<1> {
    network.grid.forward(points, time).sum()
}

/// The features, the trunk and all heads.
fn decode(network: &DeformationNetwork, points: Tensor<2>, time: Tensor<2>) -> Tensor<1> {
    network.decode(network.feature(points, time)).joined().powf_scalar(2.0).sum()
}

/// Seconds of one forward and one backward pass.
fn step(network: &DeformationNetwork, count: usize, device: &Device, part: Part) -> Result<[f64; 2]> {
    let mut stream = Stream::new(2, 0);
    let points: Vec<f32> = (0..3 * count).map(|_| stream.uniform(-1.0, 1.0) as f32).collect();
    let points = Tensor::<2>::from_data(TensorData::new(points, [count, 3]), device).require_grad();
    let time = Tensor::from_data(TensorData::new(vec![0.5f32], [1, 1]), &device.clone().inner());
    let (forward, loss) = timed(device, || part(network, points, time))?;
    let (backward, gradients) = timed(device, || loss.backward())?;
    drop(gradients);
    Ok([forward, backward])
}
