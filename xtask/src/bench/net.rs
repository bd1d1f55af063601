//! The deformation network at the size of DeGauss' video configuration: width 128, 16 features, scales 1, 2, 4.

use anyhow::Result;
use burn::tensor::{DType, Tensor, TensorData};
use mvfusion_model::Device;
use mvfusion_model::config::GridConfig;
use mvfusion_model::network::{DeformationConfig, DeformationNetwork, HeadChoice, LayerInit};
use mvfusion_model::random::Stream;
use mvfusion_render::grid::GridBounds;

use super::{Row, devices, medians, timed};

/// Numbers of Gaussians.
const COUNTS: [usize; 2] = [10_000, 30_000];

/// Width of trunk and heads.
const WIDTH: usize = 128;

/// Measures every size on every device.
pub fn measure(repeat: usize) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for (name, device) in devices() {
        let device = device.autodiff();
        let network = network(&device);
        for count in COUNTS {
            let (forward, backward) = medians(repeat, || Ok(step(&network, count, &device)))?;
            rows.push(Row {
                scene: format!("net {count} Gaussians"),
                device: name,
                threads: rayon::current_num_threads(),
                forward_seconds: forward,
                backward_seconds: backward,
                pairs: None,
            });
        }
    }
    Ok(rows)
}

fn network(device: &Device) -> DeformationNetwork {
    let mut stream = Stream::new(1, 0);
    let mut init = LayerInit { device, dtype: DType::F32, stream: &mut stream };
    let config = DeformationConfig {
        layout: GridConfig::default().layout(),
        bounds: GridBounds { max: [1.0; 3], min: [-1.0; 3] },
        width: WIDTH,
        depth: 1,
        heads: HeadChoice::ALL,
    };
    config.init(&mut init)
}

/// Seconds of one forward and one backward pass.
fn step(network: &DeformationNetwork, count: usize, device: &Device) -> (f64, f64) {
    let mut stream = Stream::new(2, 0);
    let points: Vec<f32> = (0..3 * count).map(|_| stream.uniform(-1.0, 1.0) as f32).collect();
    let points = Tensor::<2>::from_data(TensorData::new(points, [count, 3]), device).require_grad();
    let time = Tensor::from_data(TensorData::new(vec![0.5f32], [1, 1]), &device.clone().inner());
    let (forward, loss) = timed(|| {
        let offsets = network.decode(network.feature(points, time));
        // Proof of the `expect`: the first three offsets are always there.
        [
            Some(offsets.means),
            Some(offsets.log_scales),
            Some(offsets.quaternions),
            offsets.opacity_logits,
            offsets.sh,
            offsets.mask_logits,
        ]
        .into_iter()
        .flatten()
        .map(|offset| offset.powf_scalar(2.0).sum())
        .reduce(|sum, part| sum + part)
        // Proof: the first three of the list are always there.
        .expect("six offsets were listed")
    });
    let (backward, gradients) = timed(|| loss.backward());
    drop(gradients);
    (forward, backward)
}
