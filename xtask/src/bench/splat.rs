//! The splat op on a cloud of Gaussians that fills the view.

use anyhow::Result;
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_model::Device;
use mvfusion_model::random::Stream;
use mvfusion_render::splat::{self, SplatInputs, SplatRules, SplatSettings, Statistic};

use burn::tensor::{Tensor, TensorData};

use super::{Pairs, Row, devices, medians, timed};

/// Gaussians, width, height.
const SCENES: [(usize, usize, usize); 2] = [(10_000, 256, 192), (100_000, 640, 360)];

/// Median radius of a Gaussian on the picture, in pixels, as in a trained scene of this size.
const SIGMA_PIXELS: f64 = 1.6;

/// Measures every scene on every device.
pub fn measure(repeat: usize) -> Result<Vec<Row>> {
    let mut rows = Vec::new();
    for (name, device) in devices() {
        for (count, width, height) in SCENES {
            rows.push(measure_scene(name, &device, count, width, height, repeat)?);
        }
    }
    Ok(rows)
}

fn measure_scene(
    name: &'static str,
    device: &Device,
    count: usize,
    width: usize,
    height: usize,
    repeat: usize,
) -> Result<Row> {
    let camera = Camera::centred(width, height, width as f64, DMat3::IDENTITY, DVec3::ZERO);
    let settings = SplatSettings { rules: SplatRules::inria(), sh_degree: 3, statistic: Statistic::ColourAndDepth };
    let cloud = Cloud::draw(count, &camera);
    let diagnosis = splat::diagnose(&cloud.inputs(device, Tracking::Off), &camera, &settings)?;

    let (forward, backward) = medians(repeat, || {
        let inputs = cloud.inputs(device, Tracking::On);
        let (forward, picture) = timed(|| splat::splat(inputs, None, &camera, &settings));
        let loss = picture?.packed.sum();
        let (backward, gradients) = timed(|| loss.backward());
        drop(gradients);
        Ok((forward, backward))
    })?;
    let threads = rayon::current_num_threads();
    let rate = |seconds: f64| diagnosis.contributing_pairs as f64 / seconds / threads as f64;
    Ok(Row {
        scene: format!("splat {count} Gaussians, {width}x{height}"),
        device: name,
        threads,
        forward_seconds: forward,
        backward_seconds: backward,
        pairs: Some(Pairs {
            intersections: diagnosis.intersections,
            evaluated: diagnosis.evaluated_pairs,
            contributing: diagnosis.contributing_pairs,
            forward_contributing_per_second_per_core: rate(forward),
            backward_contributing_per_second_per_core: rate(backward),
        }),
    })
}

/// Whether gradients are recorded.
#[derive(Clone, Copy, PartialEq)]
enum Tracking {
    On,
    Off,
}

/// Gaussians in front of the camera, at depths 2 to 8.
struct Cloud {
    count: usize,
    means: Vec<f64>,
    quaternions: Vec<f64>,
    log_scales: Vec<f64>,
    opacity_logits: Vec<f64>,
    sh: Vec<f64>,
    features: Vec<f64>,
}

impl Cloud {
    fn draw(count: usize, camera: &Camera) -> Self {
        let mut stream = Stream::new(1, 0);
        let mut cloud = Self {
            count,
            means: Vec::new(),
            quaternions: Vec::new(),
            log_scales: Vec::new(),
            opacity_logits: Vec::new(),
            sh: Vec::new(),
            features: Vec::new(),
        };
        for _ in 0..count {
            let depth = stream.uniform(2.0, 8.0);
            let x = stream.uniform(0.0, camera.width as f64);
            let y = stream.uniform(0.0, camera.height as f64);
            cloud.means.extend([depth * (x - camera.cx) / camera.fx, depth * (y - camera.cy) / camera.fy, depth]);
            cloud.quaternions.extend((0..4).map(|_| stream.normal()));
            let size = (SIGMA_PIXELS * depth / camera.fx).ln();
            cloud.log_scales.extend((0..3).map(|_| size + 0.5 * stream.normal()));
            cloud.opacity_logits.push(stream.uniform(-3.0, 3.0));
            cloud.sh.extend((0..48).map(|_| 0.3 * stream.normal()));
            cloud.features.extend((0..3).map(|_| stream.unit()));
        }
        cloud
    }

    fn inputs(&self, device: &Device, tracking: Tracking) -> SplatInputs {
        let count = self.count;
        SplatInputs {
            means: tensor(&self.means, [count, 3], device, tracking),
            quaternions: tensor(&self.quaternions, [count, 4], device, tracking),
            log_scales: tensor(&self.log_scales, [count, 3], device, tracking),
            opacity_logits: tensor(&self.opacity_logits, [count], device, tracking),
            sh: tensor(&self.sh, [count, 16, 3], device, tracking),
            features: Some(tensor(&self.features, [count, 3], device, tracking)),
            background: tensor(&[0.0; 6], [6], device, Tracking::Off),
        }
    }
}

fn tensor<const D: usize>(values: &[f64], shape: [usize; D], device: &Device, tracking: Tracking) -> Tensor<D> {
    let values: Vec<f32> = values.iter().map(|&value| value as f32).collect();
    let plain = Tensor::from_data(TensorData::new(values, shape), device);
    if tracking == Tracking::On { plain.autodiff().require_grad() } else { plain }
}
