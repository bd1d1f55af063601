//! The splat there and back, on scenes from nothing to 200,000 Gaussians.

use anyhow::{Context, Result, ensure};
use burn::tensor::{DType, Device, Tensor};
use glam::{DMat3, DVec3};
use mvfusion_data::Camera;
use mvfusion_model::random::Stream;
use mvfusion_render::splat::{
    Antialias, SplatFrame, SplatInputs, SplatPicture, SplatRules, SplatSettings, Statistic, splat_all,
};
use mvfusion_tests::{Array, Checklist, Few, Tolerance, numbers, splat_gradients, tensor};

use super::{normal, uniform, weighed};

#[cfg(any(feature = "wgpu", feature = "cuda"))]
pub mod on_gpus;

/// What a pixel may lose or win if a Gaussian stands on the threshold of alpha, 1/255, for colours and features of size
/// one.
const FLIP: f64 = 2.5 / 255.0;

/// The root of the mean squared difference of two pictures: flips are rare.
const MEAN_DIFFERENCE: f64 = 2e-5;

/// Of the largest gradient, through long sums.
const SPLAT_GRADIENTS: Tolerance = Tolerance::of_largest(1e-4);

/// The background's few gradients are sums over all pixels, so that every flip reaches each of them.
const BACKGROUND_GRADIENTS: Tolerance = Tolerance::of_largest(2e-3);

/// Gradients of a Gaussian that stands on that threshold at one pixel.
const FLIPPED: Few = Few { share: 1e-3, tolerance: Tolerance::of_largest(1e-2) };

/// A picture to render.
pub struct Scene {
    pub name: &'static str,
    count: usize,
    size: [usize; 2],
    features: usize,
    degree: usize,
    rules: fn() -> SplatRules,
    statistic: Statistic,
    crowd: Crowd,
}

/// What the Gaussians are like.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Crowd {
    /// All can be seen.
    Plain,
    /// Every third has a number that is none, lies behind the camera, has no rotation, is huge or has underflowed.
    Hostile,
    /// All lie behind the camera.
    Unseen,
    /// All are many times as long as the picture.
    Needles,
}

/// No Gaussian to 200,000, odd sizes, 3, 4 and 8 channels beside the depth, all rules.
pub const SCENES: &[Scene] = &[
    Scene {
        name: "none",
        count: 0,
        size: [33, 17],
        features: 1,
        degree: 0,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "unseen",
        count: 5,
        size: [33, 17],
        features: 0,
        degree: 1,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Unseen,
    },
    Scene {
        name: "one",
        count: 1,
        size: [17, 33],
        features: 0,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "one_tile",
        count: 200,
        size: [13, 11],
        features: 1,
        degree: 2,
        rules: SplatRules::inria,
        statistic: Statistic::AllChannels,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "thousand",
        count: 1000,
        size: [67, 45],
        features: 3,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "four_channels",
        count: 1000,
        size: [64, 48],
        features: 1,
        degree: 1,
        rules: SplatRules::inria,
        statistic: Statistic::AllChannels,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "eight_channels",
        count: 1000,
        size: [50, 41],
        features: 5,
        degree: 2,
        rules: SplatRules::gsplat,
        statistic: Statistic::AllChannels,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "antialiased",
        count: 3000,
        size: [131, 77],
        features: 0,
        degree: 3,
        rules: antialiased,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "hostile",
        count: 2000,
        size: [67, 45],
        features: 3,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Hostile,
    },
    Scene {
        name: "twenty_thousand",
        count: 20_000,
        size: [321, 201],
        features: 3,
        degree: 3,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Plain,
    },
    Scene {
        name: "two_hundred_thousand",
        count: 200_000,
        size: [403, 301],
        features: 3,
        degree: 1,
        rules: SplatRules::inria,
        statistic: Statistic::ColourAndDepth,
        crowd: Crowd::Plain,
    },
];

fn antialiased() -> SplatRules {
    SplatRules { antialias: Antialias::Compensated, ..SplatRules::gsplat() }
}

impl Scene {
    fn inputs(&self, device: &Device) -> SplatInputs {
        let count = self.count;
        let mut stream = Stream::new(51, count as u64);
        let mut means: Vec<f64> = (0..count)
            .flat_map(|_| [stream.uniform(-3.0, 3.0), stream.uniform(-2.2, 2.2), stream.uniform(1.0, 9.0)])
            .collect();
        // Of a size that each covers some pixels, however many there are.
        let spread = -2.2 - 0.25 * (count.max(1) as f64).log10();
        let mut scales: Vec<f64> = (0..3 * count).map(|_| spread + 0.5 * stream.normal()).collect();
        let mut quaternions: Vec<f64> = (0..4 * count).map(|_| stream.normal()).collect();
        let mut logits: Vec<f64> = (0..count).map(|_| 1.5 * stream.normal()).collect();
        if self.crowd == Crowd::Needles {
            scales.iter_mut().step_by(3).for_each(|scale| *scale = stream.uniform(8.0, 18.0));
        }
        if self.crowd == Crowd::Unseen {
            means.iter_mut().skip(2).step_by(3).for_each(|z| *z = -4.0);
        }
        if self.crowd == Crowd::Hostile {
            for index in (0..count).step_by(3) {
                match index / 3 % 7 {
                    0 => means[3 * index] = f64::NAN,
                    1 => means[3 * index + 2] = -4.0,
                    2 => quaternions[4 * index..4 * index + 4].fill(0.0),
                    3 => scales[3 * index] = 60.0,
                    4 => logits[index] = f64::INFINITY,
                    5 => logits[index] = -200.0,
                    _ => means[3 * index + 1] = 1e30,
                }
            }
        }
        let leaf = |values: &[f64], columns: usize| tensor(values, [count, columns], device, DType::F32).require_grad();
        SplatInputs {
            means: leaf(&means, 3),
            quaternions: leaf(&quaternions, 4),
            log_scales: leaf(&scales, 3),
            opacity_logits: tensor(&logits, [count], device, DType::F32).require_grad(),
            sh: normal([count, 16, 3], 0.4, 52, device),
            features: (self.features > 0).then(|| normal([count, self.features], 0.5, 53, device)),
            background: uniform([3 + self.features], [0.0, 1.0], 54, device),
        }
    }

    fn camera(&self) -> Camera {
        let [width, height] = self.size;
        let rotation = DMat3::from_euler(glam::EulerRot::XYZ, 0.1, -0.15, 0.2);
        Camera::centred(width, height, 0.9 * width as f64, rotation, DVec3::new(0.1, -0.2, 0.4))
    }
}

/// A picture and the gradients of all arguments.
struct Rendered {
    picture: Array,
    radii: Array,
    gradients: Vec<(&'static str, Array)>,
}

fn render(scene: &Scene, device: &Device) -> Result<Rendered> {
    render_all(&[scene], device)?.pop().context("one picture")
}

/// Renders scenes with one call.
fn render_all(scenes: &[&Scene], device: &Device) -> Result<Vec<Rendered>> {
    let inputs: Vec<SplatInputs> = scenes.iter().map(|scene| scene.inputs(device)).collect();
    let probes: Vec<Tensor<2>> =
        scenes.iter().map(|_| Tensor::zeros([1, 2], (device, DType::F32)).require_grad()).collect();
    let frame = |((scene, inputs), probe): ((&&Scene, &SplatInputs), &Tensor<2>)| SplatFrame {
        inputs: inputs.clone(),
        probe: Some(probe.clone()),
        camera: scene.camera(),
        settings: SplatSettings { rules: (scene.rules)(), sh_degree: scene.degree, statistic: scene.statistic },
    };
    let pictures = splat_all(scenes.iter().zip(&inputs).zip(&probes).map(frame).collect())?;
    let costs = pictures.iter().map(|picture| weighed(&picture.packed, 55));
    let gradients = costs.reduce(|sum, cost| sum + cost).context("a scene")?.backward();
    let rendered = |((picture, inputs), probe): ((SplatPicture, &SplatInputs), &Tensor<2>)| {
        let statistic = probe.grad(&gradients).context("the probe has a gradient")?;
        let mut all = splat_gradients(inputs, &gradients);
        all.push(("statistic", Array::of(statistic)));
        let radii = Array::list(numbers(picture.radii.float()));
        Ok(Rendered { picture: Array::of(picture.packed), radii, gradients: all })
    };
    pictures.into_iter().zip(&inputs).zip(&probes).map(rendered).collect()
}

/// Compares what two devices render of a scene, and what comes back.
pub fn compare_pictures(scene: &Scene, device: &Device, reference: &Device) -> Result<()> {
    let (found, wanted) = (render(scene, device)?, render(scene, reference)?);
    let mut checks = Checklist::default();
    // A radius is rounded up to whole pixels, the last bit decides.
    checks.close("radii", &wanted.radii, &found.radii, Tolerance::absolute(1.0));
    // The depth is larger than one.
    let largest = wanted.picture.largest().max(1.0);
    checks.close("picture", &wanted.picture, &found.picture, Tolerance::absolute(FLIP * largest));
    let squares = found.picture.values.iter().zip(&wanted.picture.values).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let mean = (squares / found.picture.values.len() as f64).sqrt();
    ensure!(
        mean <= MEAN_DIFFERENCE * largest,
        "pictures differ by {mean:e} in the mean, the largest number is {largest}"
    );
    for ((name, found), (_, wanted)) in found.gradients.iter().zip(&wanted.gradients) {
        if *name == "background" {
            checks.close(name, wanted, found, BACKGROUND_GRADIENTS);
        } else {
            checks.close_but_few(name, wanted, found, SPLAT_GRADIENTS, FLIPPED);
        }
    }
    checks.finish()
}
