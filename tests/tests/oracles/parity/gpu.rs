//! What depends on the GPU, tried otherwise than by the GPU at hand.

use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use burn::tensor::{DType, Device};
use glam::{DMat3, DVec3};
use libtest_mimic::Trial;
use mvfusion_data::Camera;
use mvfusion_kernels::cube::sort::STAGED_BYTES;
use mvfusion_model::device::gpus;
use mvfusion_render::device::{GpuProperties, fold_launches, imitate_dirt, imitate_hardware, sort_apart};
use mvfusion_render::grid::{GridBounds, look_up, regulariser::penalties};
use mvfusion_render::mlp::{Layer, MlpLayout};
use mvfusion_render::splat::{
    SplatError, SplatFrame, SplatInputs, SplatRules, SplatSettings, Statistic, splat, splat_all,
};
use mvfusion_render::{attention, mlp};
use mvfusion_tests::{gpu_backends, tensor, with_padded_rows};

use super::ops::{CASES, adam_steps, layout, look_up_and_back, mlp_and_back};
use super::pictures::on_gpus::{compare_needles, render_together, render_twice};
use super::pictures::{SCENES, Scene};
use super::{Pair, device};

/// Trials for a backend of GPUs; none for another.
pub fn trials(pair: Pair) -> Vec<Trial> {
    if gpu_backends().iter().all(|gpu| gpu.name != pair.backend.name) {
        return Vec::new();
    }
    let mut trials = vec![
        pair.trial("language", move || language(pair)),
        pair.trial("folded", move || folded(pair)),
        pair.trial("as_on_hardware", move || as_on_hardware(pair)),
        pair.trial("dirty_buffers", move || dirty_buffers(pair)),
        pair.trial("padded_rows", move || with_padded_rows(|| compare_all(pair))),
        pair.trial("twice", move || twice(pair)),
        pair.trial("frames_together", move || frames_together(pair)),
        pair.trial("needles", move || compare_needles(&device(pair.backend), &device(pair.reference))),
        pair.trial("lists_too_long", move || lists_too_long(pair)),
        pair.trial("double_precision", move || double_precision(pair)),
    ];
    trials.extend(
        other_lengths(pair).map(|bits| pair.trial(&format!("lanes_of_{bits}_bits"), move || lanes(pair, bits))),
    );
    trials
}

/// What the GPU reports.
fn card(pair: Pair) -> Result<GpuProperties> {
    let gpu = gpus().iter().find(|gpu| gpu.backend == pair.backend.name).context("no GPU was found")?;
    Ok(gpu.properties()?)
}

/// The lengths of vectors, in bits, that Mesa's software driver does not use by itself on this processor; none for
/// another GPU.
fn other_lengths(pair: Pair) -> impl Iterator<Item = &'static str> {
    // It names itself as in `llvmpipe (LLVM 15.0.6, 256 bits)`.
    let own = card(pair).ok().map(|card| card.name).filter(|name| name.contains("llvmpipe"));
    let is_other = move |bits: &&str| own.as_ref().is_some_and(|name| !name.contains(&format!("{bits} bits")));
    ["128", "256", "512"].into_iter().filter(is_other)
}

/// The kernels are compiled to what the features of this build ask for. CubeCL says nothing where a driver lacks what
/// SPIR-V needs, and compiles to WGSL.
fn language(pair: Pair) -> Result<()> {
    let wanted = match pair.backend.name {
        "cuda" if cfg!(feature = "cuda-cpp") => "CUDA C++",
        "cuda" => "PTX",
        _ if cfg!(all(feature = "metal", target_os = "macos")) => "MSL",
        _ if cfg!(all(feature = "vulkan", not(target_vendor = "apple"))) => "SPIR-V",
        _ => "WGSL",
    };
    let found = card(pair)?.language;
    ensure!(found == wanted, "the kernels are compiled to {found}, not to {wanted}");
    Ok(())
}

/// The driver with vectors of another length: other units run together, and the others in another order. It reads the
/// length when it starts, so each trial is a process.
fn lanes(pair: Pair, bits: &str) -> Result<()> {
    for case in ["mlp", "look_up", "as_on_hardware"] {
        let trial = format!("parity::{}::{case}", pair.backend.name);
        let mut again = Command::new(std::env::current_exe()?);
        let output = again.args(["--exact", &trial]).env("LP_NATIVE_VECTOR_WIDTH", bits).output()?;
        let said = String::from_utf8_lossy(&output.stdout);
        ensure!(output.status.success() && said.contains("1 passed"), "{trial} with {bits} bits: {said}");
    }
    Ok(())
}

/// Launches as where only four cubes fit along an axis.
fn folded(pair: Pair) -> Result<()> {
    fold_launches(4, || {
        pair.compare(look_up_and_back)?;
        pair.compare(adam_steps)?;
        compare_scenes(pair, &["twenty_thousand"])
    })
}

/// Work shared out as on hardware, which a driver that computes on the CPU would not do.
fn as_on_hardware(pair: Pair) -> Result<()> {
    let found = card(pair)?.shared_memory;
    ensure!(found >= STAGED_BYTES, "keys are not sorted in {found} bytes of shared memory, which takes {STAGED_BYTES}");
    imitate_hardware(|| {
        pair.compare(mlp_and_back)?;
        pair.compare(look_up_and_back)?;
        let scenes = [
            "none",
            "unseen",
            "one",
            "one_tile",
            "thousand",
            "four_channels",
            "eight_channels",
            "antialiased",
            "hostile",
            "twenty_thousand",
        ];
        compare_scenes(pair, &scenes)
    })
}

/// Buffers whose old contents would show, with work shared out as on either kind of driver.
fn dirty_buffers(pair: Pair) -> Result<()> {
    imitate_dirt(|| {
        compare_all(pair)?;
        imitate_hardware(|| {
            compare_all(pair)?;
            // Enough Gaussians that some have whole pieces of records.
            compare_scenes(pair, &["twenty_thousand", "antialiased"])
        })
    })
}

/// Every op, and small scenes.
fn compare_all(pair: Pair) -> Result<()> {
    CASES.iter().try_for_each(|&(name, case)| pair.compare(case).with_context(|| name))?;
    compare_scenes(pair, &["none", "unseen", "one", "one_tile", "thousand", "hostile"])
}

/// What has no atomic additions gives the same bits again: a race would show.
fn twice(pair: Pair) -> Result<()> {
    let device = device(pair.backend);
    for (name, case) in CASES.iter().filter(|(name, _)| *name != "look_up") {
        let (first, second) = (case(&device)?, case(&device)?);
        for ((what, first, _), (_, second, _)) in first.iter().zip(&second) {
            let is_same = first.values.iter().zip(&second.values).all(|(a, b)| a.to_bits() == b.to_bits());
            ensure!(is_same, "{name}: {what} differ");
        }
    }
    let scenes = SCENES.iter().filter(|scene| ["thousand", "eight_channels", "twenty_thousand"].contains(&scene.name));
    imitate_hardware(|| scenes.into_iter().try_for_each(|scene| render_twice(scene, &device)))
}

/// Frames of one call, which are sorted together unless their Gaussians, or their pairs of one and a tile, are too many.
fn frames_together(pair: Pair) -> Result<()> {
    let names = ["unseen", "thousand", "none", "one", "hostile", "one_tile", "antialiased"];
    let scenes: Vec<&Scene> = SCENES.iter().filter(|scene| names.contains(&scene.name)).collect();
    let render = || render_together(&scenes, &device(pair.backend));
    imitate_dirt(render)?;
    // Keys are then sorted in shared memory first.
    imitate_hardware(|| imitate_dirt(render))?;
    // There are 6206 Gaussians, and more pairs.
    [100, 7000].into_iter().try_for_each(|most| sort_apart(most, || imitate_dirt(render)))
}

fn compare_scenes(pair: Pair, names: &[&str]) -> Result<()> {
    SCENES.iter().filter(|scene| names.contains(&scene.name)).try_for_each(|scene| pair.compare_scene(scene))
}

/// As many Gaussians before the whole picture as make gradient records that no buffer holds, between two frames that fit:
/// an error, after which the device goes on.
fn lists_too_long(pair: Pair) -> Result<()> {
    let (size, tile, record) = (1024, 16, 3 * 16);
    let limit = card(pair)?.buffer;
    let count = (limit / record) as usize / (size / tile * (size / tile)) + 1;
    let frame = |count: usize| {
        let mut inputs = before_the_picture(count, &device(pair.backend), DType::F32);
        inputs.means = inputs.means.require_grad();
        SplatFrame { inputs, probe: None, camera: camera(size), settings: settings() }
    };
    match splat_all([1, count, 2].map(frame).into()) {
        Err(SplatError::Buffer { tensor: "tile lists", bytes, limit: told }) => {
            ensure!(told == limit && bytes > limit, "{bytes} bytes, of {told} that a buffer holds");
        }
        Err(error) => bail!("refused for another reason: {error}"),
        Ok(_) => bail!("{count} Gaussians in each of {} tiles were not refused", size / tile * (size / tile)),
    }
    compare_scenes(pair, &["one"])
}

/// Gaussians that cover the whole picture.
fn before_the_picture(count: usize, device: &Device, dtype: DType) -> SplatInputs {
    let of = |value: f64, columns: usize| tensor(&vec![value; count * columns], [count, columns], device, dtype);
    SplatInputs {
        means: tensor(&[0.0, 0.0, 2.0].repeat(count), [count, 3], device, dtype),
        quaternions: of(0.5, 4),
        log_scales: of(3.0, 3),
        opacity_logits: of(0.0, 1).reshape([count]),
        sh: of(0.0, 3).reshape([count, 1, 3]),
        features: None,
        background: tensor(&[0.0; 3], [3], device, dtype),
    }
}

fn camera(size: usize) -> Camera {
    Camera::centred(size, size, size as f64, DMat3::IDENTITY, DVec3::ZERO)
}

fn settings() -> SplatSettings {
    SplatSettings { rules: SplatRules::inria(), sh_degree: 0, statistic: Statistic::ColourAndDepth }
}

/// GPUs take single precision alone, and say so.
fn double_precision(pair: Pair) -> Result<()> {
    let device = &device(pair.backend);
    let wide = |shape: [usize; 2]| tensor(&vec![0.5; shape.iter().product()], shape, device, DType::F64);
    let (bounds, planes) = (GridBounds { min: [-1.0; 3], max: [1.0; 3] }, [layout().cells(), layout().features]);
    let perceptron = MlpLayout { inputs: 3, rectified: true, chains: vec![vec![2]] };
    let parameters = wide([1, perceptron.parameters()]).reshape([perceptron.parameters()]);
    let refusals = [
        look_up(wide(planes), wide([5, 3]), wide([1, 1]), &bounds, &layout()).err().map(|error| error.to_string()),
        mlp::forward(wide([5, 3]), Layer::all_of(&parameters, &perceptron), &perceptron)
            .err()
            .map(|error| error.to_string()),
        attention::forward(wide([5, 4]).unsqueeze_dim(1), wide([5, 8]).unsqueeze_dim(1), 2)
            .err()
            .map(|error| error.to_string()),
        penalties(wide(planes), &layout()).err().map(|error| error.to_string()),
        splat(before_the_picture(5, device, DType::F64), None, &camera(32), &settings())
            .err()
            .map(|error| error.to_string()),
    ];
    for refusal in refusals {
        let Some(message) = refusal else { bail!("double precision was not refused") };
        ensure!(message.contains("F64") && message.to_lowercase().contains("f64 on a cpu"), "{message}");
    }
    Ok(())
}
