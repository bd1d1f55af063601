//! The metrics of evaluation: pairs of pictures whose metrics are in `oracle_metrics/metrics.json`, one trial a pair
//! for what needs no weights and one for LPIPS; and the gradients of `grads_*.npz`. The weights of LPIPS are in
//! `lpips_weights`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::{Device, Tensor};
use image::RgbImage;
use libtest_mimic::Trial;
use mvfusion_model::evaluation::{
    Backbone, Evaluator, InputRange, LayerScores, Lpips, Pair, Protocol, decibels, squared_errors,
};
use mvfusion_model::train::loss::terms::l1;
use mvfusion_model::train::picture_tensor;
use mvfusion_render::window::{Window, ssim_map};
use mvfusion_tests::{Array, Backend, Checklist, Tolerance, gradient, numbers};
use serde_json::{Map, Value};

use crate::archive::Archive;
use crate::{failed, ignored, root};

/// Folder of the pairs.
const FOLDER: &str = "oracle_metrics";

/// Folder of the weights.
pub const WEIGHTS: &str = "lpips_weights";

/// Of PSNR, in dB.
const PSNR: Tolerance = Tolerance::absolute(1e-3);

/// Of means and of SSIM in all forms: single precision against double.
const MEANS: Tolerance = Tolerance::absolute(1e-4);

/// Of LPIPS with the same weights.
const LPIPS: Tolerance = Tolerance::absolute(1e-4);

/// Of LPIPS with weights that were rounded to half precision.
const LPIPS_ROUNDED: Tolerance = Tolerance::absolute(1e-3);

/// Of gradients.
const GRADIENTS: Tolerance = Tolerance::of_largest(1e-4);

/// Of the gradient of LPIPS: where two numbers of a window of a pooling are nearly equal, rounding picks the other one.
const LPIPS_GRADIENT: Tolerance = Tolerance::of_largest(1e-3);

/// Two small pairs. Where convolutions are slow, the LPIPS of the others is computed only if all are asked for
/// (`--include-ignored`).
const SMALL: [&str; 2] = ["07_odd_size_101x67", "09_lpips_ex_p1"];

/// The trials of the pairs.
pub fn trials(backend: Backend) -> Vec<Trial> {
    let name = |part: &str, pair: &str| format!("oracle::{}::{part}::{pair}", backend.name);
    let Some(folder) = root().map(|root| root.join(FOLDER)).filter(|folder| folder.is_dir()) else {
        let reason = || format!("there is no folder {FOLDER}");
        return vec![
            ignored(format!("oracle::{}::metrics", backend.name), reason()),
            ignored(format!("oracle::{}::lpips", backend.name), reason()),
        ];
    };
    let entries = match read(&folder.join("metrics.json")) {
        Ok(entries) => entries,
        Err(error) => {
            let message = format!("{error:#}");
            return vec![Trial::test(name("metrics", "metrics.json"), move || Err(message.into()))];
        }
    };
    let mut trials = vec![complete(name("metrics", "every_file_is_known"), &folder, &entries)];
    for (pair, metrics) in entries {
        let (folder, metrics) = (folder.clone(), metrics.clone());
        let [own, its] = [(folder.clone(), metrics.clone()), (folder, metrics)];
        let pair_name = pair.clone();
        trials.push(Trial::test(name("metrics", &pair), move || {
            check_metrics(&own.0, &pair_name, &own.1, &(backend.device)()).map_err(failed)
        }));
        let title = name("lpips", &pair);
        let slowness = match backend.name {
            "wgpu" => "a minute by a software driver",
            "ndarray" => "a quarter of a minute without SIMD",
            _ => "",
        };
        let is_too_slow = !slowness.is_empty() && !SMALL.contains(&pair.as_str());
        if weights().is_none() {
            trials.push(ignored(title, format!("there is no folder {WEIGHTS}")));
            continue;
        }
        let check = move || check_lpips(&its.0, &pair, &its.1, &(backend.device)()).map_err(failed);
        let kind = if is_too_slow { slowness } else { "" };
        trials.push(Trial::test(title, check).with_kind(kind).with_ignored_flag(is_too_slow));
    }
    trials
}

fn weights() -> Option<PathBuf> {
    root().map(|root| root.join(WEIGHTS)).filter(|folder| folder.is_dir())
}

fn read(path: &Path) -> Result<Map<String, Value>> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    match serde_json::from_str(&text)? {
        Value::Object(entries) => Ok(entries),
        _ => bail!("{} is no list of pairs", path.display()),
    }
}

/// A trial that fails for a file that nothing here looks at.
fn complete(name: String, folder: &Path, entries: &Map<String, Value>) -> Trial {
    let pictures = entries.keys().flat_map(|pair| ["a", "b"].map(|side| format!("{pair}_{side}.png")));
    let pictures: BTreeSet<String> = pictures.collect();
    let folder = folder.to_owned();
    Trial::test(name, move || {
        let other = |name: &String| !["metrics.json", "README.md", "images"].contains(&name.as_str());
        let unknown: Vec<String> =
            names(&folder)?.into_iter().filter(other).filter(|name| !name.ends_with(".npz")).collect();
        let unpaired: Vec<String> =
            names(&folder.join("images"))?.into_iter().filter(|name| !pictures.contains(name)).collect();
        if unknown.is_empty() && unpaired.is_empty() {
            return Ok(());
        }
        Err(format!("no check knows {unknown:?}, and these pictures have no metrics: {unpaired:?}").into())
    })
}

fn names(folder: &Path) -> std::io::Result<Vec<String>> {
    std::fs::read_dir(folder)?.map(|entry| Ok(entry?.file_name().to_string_lossy().into_owned())).collect()
}

/// The two pictures of a pair.
fn pictures(folder: &Path, pair: &str) -> Result<[RgbImage; 2]> {
    let picture = |side: &str| -> Result<RgbImage> {
        let path = folder.join("images").join(format!("{pair}_{side}.png"));
        Ok(image::open(&path).with_context(|| format!("cannot read {}", path.display()))?.into_rgb8())
    };
    Ok([picture("a")?, picture("b")?])
}

/// The metrics of an entry, and which of them were compared.
struct Entry<'a> {
    metrics: &'a Map<String, Value>,
    seen: BTreeSet<&'static str>,
}

impl<'a> Entry<'a> {
    fn new(metrics: &'a Value) -> Result<Self> {
        Ok(Self { metrics: metrics.as_object().context("an entry is an object")?, seen: BTreeSet::new() })
    }

    /// A metric; `None` if it is null or absent.
    fn metric(&mut self, name: &'static str) -> Option<f64> {
        self.seen.insert(name);
        self.metrics.get(name)?.as_f64()
    }

    fn list(&mut self, name: &'static str) -> Result<Array> {
        self.seen.insert(name);
        let list = self.metrics.get(name).and_then(Value::as_array).with_context(|| format!("no list `{name}`"))?;
        Ok(Array::list(list.iter().map(|value| value.as_f64().context("a number")).collect::<Result<_>>()?))
    }

    /// Compares a metric that is known to both or to neither.
    fn compare(&mut self, checks: &mut Checklist, name: &'static str, found: Option<f64>, tolerance: Tolerance) {
        match (self.metric(name), found) {
            (Some(expected), Some(found)) => checks.close_number(name, expected, found, tolerance),
            (None, None) => {}
            (expected, found) => checks.fail(format!("`{name}` is {found:?}, expected {expected:?}")),
        }
    }

    /// Fails for metrics that belong to neither part.
    fn finish(self, left: &[&str]) -> Result<()> {
        let unseen: Vec<&String> = self
            .metrics
            .keys()
            .filter(|key| !self.seen.contains(key.as_str()) && !left.contains(&key.as_str()))
            .collect();
        ensure!(unseen.is_empty(), "metrics that were not compared: {unseen:?}");
        Ok(())
    }
}

/// What is compared where there are weights.
const LPIPS_FIGURES: [&str; 5] =
    ["lpips_alex", "lpips_alex_layers", "lpips_vgg", "lpips_vgg_layers", "lpips_vgg_with_f16_weights"];

/// What needs no weights. The evaluator's metrics are those of the pictures as they are, since these are 8-bit already.
fn check_metrics(folder: &Path, pair: &str, metrics: &Value, device: &Device) -> Result<()> {
    let [a, b] = pictures(folder, pair)?;
    let mut entry = Entry::new(metrics)?;
    let mut checks = Checklist::default();
    checks.same(
        "size",
        &[entry.metric("width"), entry.metric("height")],
        &[Some(f64::from(a.width())), Some(f64::from(a.height()))],
    );
    let exact = picture_tensor(&a, device);
    let reference = picture_tensor(&b, device);
    let squared_error = squared_errors(exact.clone(), reference.clone())?.mean();
    entry.compare(&mut checks, "mse", Some(squared_error), MEANS);
    entry.compare(&mut checks, "l1", Some(numbers(l1(exact.clone(), reference))[0]), MEANS);
    let metrics = Evaluator::without_lpips(Protocol::Mvfusion).metrics(&Pair::new(a, exact, b), None, None)?;
    let LayerScores { psnr, psnr_exact, ssim, ssim_valid, ms_ssim, d_ssim, .. } = metrics.whole;
    checks.same("unknown metrics", &[metrics.whole.lpips_alex, metrics.whole.lpips_vgg], &[None, None]);
    for found in [psnr, psnr_exact, decibels(squared_error)] {
        entry.compare(&mut checks, "psnr", found, PSNR);
    }
    entry.compare(&mut checks, "ssim_3dgs", ssim, MEANS);
    for name in ["ssim_valid_skimage", "ssim_valid_from_map"] {
        entry.compare(&mut checks, name, ssim_valid, MEANS);
    }
    let expected = entry.metric("ms_ssim");
    entry.compare(&mut checks, "ms_ssim", ms_ssim, MEANS);
    if let (Some(expected), Some(found)) = (expected, d_ssim) {
        checks.close_number("d_ssim", (1.0 - expected) / 2.0, found, MEANS);
    }
    entry.finish(&LPIPS_FIGURES)?;
    checks.finish()
}

/// Both networks, with the parts of each stage.
///
/// The file has no metrics of pictures that are fed as they are, in `[0, 1]`. But of `2 x - 1`, fed that way, a network
/// must find the metric of `x`. AlexNet alone is asked: both networks are fed by the same function, and VGG-16 is slow.
fn check_lpips(folder: &Path, pair: &str, metrics: &Value, device: &Device) -> Result<()> {
    let [a, b] = pictures(folder, pair)?;
    let mut entry = Entry::new(metrics)?;
    let mut checks = Checklist::default();
    let both = Tensor::cat(vec![picture_tensor(&a, device), picture_tensor(&b, device)], 0);
    for backbone in Backbone::ALL {
        let (network, is_rounded) = network(backbone, device)?;
        let distances = network.distances(both.clone(), InputRange::Signed, &[(0, 1)]);
        let distances = distances.context("the pictures are large enough")?;
        let value = numbers(distances[0].value())[0];
        let stages = Array::list(distances[0].stages().map(|stage| numbers(stage)[0]).collect());
        let tolerance = if is_rounded { LPIPS_ROUNDED } else { LPIPS };
        let (name, layers) = match backbone {
            Backbone::Alex => ("lpips_alex", "lpips_alex_layers"),
            Backbone::Vgg => ("lpips_vgg", "lpips_vgg_layers"),
        };
        entry.compare(&mut checks, name, Some(value), tolerance);
        if backbone == Backbone::Alex {
            let expected = entry.metric(name).context("the entry has a metric of AlexNet")?;
            let scaled = network.distances(both.clone() * 2.0 - 1.0, InputRange::Raw, &[(0, 1)]);
            let scaled = scaled.context("the pictures are large enough")?;
            let found = numbers(scaled[0].value())[0];
            checks.close_number("lpips_alex of scaled pictures, fed as they are", expected, found, tolerance);
        }
        checks.close(layers, &entry.list(layers)?, &stages, tolerance);
        if backbone == Backbone::Vgg {
            let tolerance = if is_rounded { LPIPS } else { LPIPS_ROUNDED };
            entry.compare(&mut checks, "lpips_vgg_with_f16_weights", Some(value), tolerance);
        }
    }
    let seen_elsewhere: Vec<&str> =
        entry.metrics.keys().map(String::as_str).filter(|name| !LPIPS_FIGURES.contains(name)).collect();
    entry.finish(&seen_elsewhere)?;
    checks.finish()
}

/// The pairs by which converted weights are compared: the first backend suffices.
pub fn check_converted(backbone: Backbone, folder: &Path) -> Result<()> {
    let device = (mvfusion_tests::backends()[0].device)();
    let network = Lpips::load(backbone, &backbone.file_in(folder).context("the file is there")?, &device)?;
    let pairs = root().map(|root| root.join(FOLDER)).context("the folder is there")?;
    let mut checks = Checklist::default();
    for (pair, metrics) in read(&pairs.join("metrics.json"))? {
        // VGG-16 is slow.
        if backbone == Backbone::Vgg && !SMALL.contains(&pair.as_str()) {
            continue;
        }
        let both = pictures(&pairs, &pair)?.map(|picture| picture_tensor(&picture, &device));
        let distances = network.distances(Tensor::cat(both.to_vec(), 0), InputRange::Signed, &[(0, 1)]);
        let found = numbers(distances.context("the pictures are large enough")?[0].value())[0];
        let (name, tolerance) = match backbone {
            Backbone::Alex => ("lpips_alex", LPIPS),
            Backbone::Vgg => ("lpips_vgg", LPIPS_ROUNDED),
        };
        Entry::new(&metrics)?.compare(&mut checks, name, Some(found), tolerance);
    }
    checks.finish()
}

/// A network, and whether its weights were rounded to half precision.
fn network(backbone: Backbone, device: &Device) -> Result<(Lpips, bool)> {
    let folder = weights().with_context(|| format!("there is no folder {WEIGHTS}"))?;
    let path = backbone.file_in(&folder).with_context(|| format!("{WEIGHTS} has no file for {backbone:?}"))?;
    let is_rounded = path.to_string_lossy().ends_with("_f16.safetensors");
    Ok((Lpips::load(backbone, &path, device)?, is_rounded))
}

/// `grads_<pair>.npz`: terms of losses and their gradients with respect to the first picture.
pub fn check_gradients(archive: &Archive, device: &Device) -> Result<()> {
    let pair = archive.name().strip_prefix("grads_").context("the file is called grads_<pair>")?;
    let folder = root().map(|root| root.join(FOLDER)).context("the folder is there")?;
    let pictures = pictures(&folder, pair)?.map(|picture| picture_tensor(&picture, device).autodiff());
    let [a, b] = pictures;
    let window = Window::gaussian(11, 1.5);
    let network = network(Backbone::Alex, device)?.0;
    let mut checks = Checklist::default();
    let map = ssim_map(a.clone(), b.clone(), &window);
    checks.close("ssim_map", archive.array("ssim_map")?, &pixels_last(Array::of(map)), MEANS);
    for (term, derivative, tolerance) in [
        ("l1", "grad_l1", GRADIENTS),
        ("ssim", "grad_ssim", GRADIENTS),
        ("loss", "grad_loss_08l1_02dssim", GRADIENTS),
        ("lpips_alex", "grad_lpips_alex", LPIPS_GRADIENT),
    ] {
        let leaf = a.clone().detach().require_grad();
        let similarity = || ssim_map(leaf.clone(), b.clone(), &window).mean();
        let difference = || l1(leaf.clone(), b.clone());
        let value = match term {
            "l1" => difference(),
            "ssim" => similarity(),
            "loss" => difference() * 0.8 + (-similarity() + 1.0) * 0.2,
            _ => {
                let both = Tensor::cat(vec![leaf.clone(), b.clone()], 0);
                let distances = network.distances(both, InputRange::Signed, &[(0, 1)]);
                distances.context("the pictures are large enough")?[0].value()
            }
        };
        let gradients = value.backward();
        checks.close_number(term, archive.number(term)?, numbers(value)[0], MEANS);
        let found = pixels_last(gradient(&leaf, &gradients));
        checks.close(derivative, archive.array(derivative)?, &found, tolerance);
    }
    checks.finish()
}

/// `[1, 3, H, W]` as `[H, W, 3]`.
fn pixels_last(array: Array) -> Array {
    let [_, channels, height, width] = array.shape[..] else { panic!("{:?} is no picture", array.shape) };
    let plane = height * width;
    let values = (0..plane * channels).map(|i| array.values[i % channels * plane + i / channels]).collect();
    Array::new([height, width, channels], values)
}
