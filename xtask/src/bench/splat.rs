//! The splat op on clouds of Gaussians that fills the view.

use anyhow::Result;
use clap::Args;
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_model::Device;
use mvfusion_model::random::Stream;
use mvfusion_render::splat::{self, SplatInputs, SplatRules, SplatSettings, Statistic};

use burn::tensor::{Tensor, TensorData};

use super::scene::SceneSize;
use super::{Pairs, Row, Seconds, Subjected, medians, timed};

/// Median radius of a Gaussian on the picture, in pixels, as in a trained scene of this size.
const SIGMA_PIXELS: f64 = 1.6;

/// The clouds to render.
#[derive(Debug, Args)]
pub struct SplatArguments {
    /// Scenes as COUNT@WIDTHxHEIGHT.
    #[arg(long = "scene", value_delimiter = ',', default_values = ["10000@256x192", "50000@640x360", "100000@640x360"])]
    scenes: Vec<SceneSize>,
}

/// Measures every scene on every device.
pub fn measure(
    arguments: &SplatArguments,
    devices: &[Subjected],
    repeat: usize,
    note: &mut impl FnMut(Row),
) -> Result<()> {
    for scene in &arguments.scenes {
        measure_scene(scene, devices, repeat, note)?;
    }
    Ok(())
}

fn camera(scene: &SceneSize) -> Camera {
    Camera::centred(scene.width, scene.height, scene.width as f64, DMat3::IDENTITY, DVec3::ZERO)
}

fn settings() -> SplatSettings {
    SplatSettings { rules: SplatRules::inria(), sh_degree: 3, statistic: Statistic::ColourAndDepth }
}

/// What there is to blend; the same on every device.
fn pairs_of(scene: &SceneSize, device: &Device) -> Result<Pairs> {
    let cloud = Cloud::draw(scene.count, &camera(scene));
    let diagnosis = splat::diagnose(&cloud.inputs(device, Tracking::Off), &camera(scene), &settings())?;
    Ok(Pairs {
        intersections: diagnosis.intersections,
        evaluated: diagnosis.evaluated_pairs,
        contributing: diagnosis.contributing_pairs,
    })
}

fn measure_scene(scene: &SceneSize, devices: &[Subjected], repeat: usize, note: &mut impl FnMut(Row)) -> Result<()> {
    let (camera, settings) = (camera(scene), settings());
    let cloud = Cloud::draw(scene.count, &camera);
    let plain: Vec<SplatInputs> = devices.iter().map(|subject| cloud.inputs(&subject.device, Tracking::Off)).collect();
    let times = medians(devices.len(), repeat, |subject| {
        let device = &devices[subject].device;
        let (render, picture) = timed(device, || splat::splat(plain[subject].clone(), None, &camera, &settings))?;
        drop(picture?);
        let inputs = cloud.inputs(device, Tracking::On);
        let (forward, picture) = timed(device, || splat::splat(inputs, None, &camera, &settings))?;
        // Of all numbers of the picture: a cotangent of ones, and no op but the splat's.
        let picture = picture?.packed;
        let (backward, gradients) = timed(device, || picture.backward())?;
        drop(gradients);
        Ok([render, forward, backward])
    })?;
    let pairs = pairs_of(scene, &devices[0].device)?;
    for (Subjected { name, .. }, [render, forward, backward]) in devices.iter().zip(times) {
        note(Row {
            scene: format!("splat {scene}"),
            device: name.clone(),
            threads: rayon::current_num_threads(),
            seconds: Seconds::Passes { render: Some(render), forward, backward },
            pairs: Some(pairs),
            peak_bytes: None,
        });
    }
    Ok(())
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
