//! What the program writes, in readers that others wrote.
//!
//! The trials, `foreign::<format>::<reader>`, train for a few steps with the program's own commands. They are ignored
//! where the reader is missing.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use libtest_mimic::{Completion, Trial};
use mvfusion_model::evaluation::Layer;
use mvfusion_tests::Ply;

use crate::failed;
use crate::tiny::{mvfusion, text, train};

/// Size of a film's frames: small, for speed; not square, lest width and height be taken for each other.
const SIZE: [usize; 2] = [48, 36];

/// Frames of a film.
const FRAMES: usize = 3;

/// The run, the export and the film within a trial's folder.
const RUN: &str = "run";
const EXPORT: &str = "export";
const FILM: &str = "film";

/// A reader that is a module of Python.
pub struct Module {
    /// The name of the module and of the package that has it.
    pub name: &'static str,
    /// Fails where the module is missing or too old.
    pub probe: &'static str,
    /// Prints what stands in the file that is its argument.
    pub script: &'static str,
}

/// Prints every channel in a line: its name, and its numbers.
const OPENEXR: Module = Module {
    name: "OpenEXR",
    probe: "import OpenEXR; OpenEXR.File",
    script: "\
import OpenEXR, sys
for name, channel in OpenEXR.File(sys.argv[1], separate_channels=True).channels().items():
    print(name, *map(float, channel.pixels.ravel()))
",
};

/// Prints the names of the properties, then the numbers of each vertex in a line.
const PLYFILE: Module = Module {
    name: "plyfile",
    probe: "import plyfile",
    script: "\
import plyfile, sys
vertices = plyfile.PlyData.read(sys.argv[1])['vertex']
print(*(property.name for property in vertices.properties))
for row in vertices.data:
    print(*map(float, row))
",
};

/// Prints every number that TensorBoard shows in a line: its name, its step, its value; then every image: its name, its
/// step, its width and its height.
const TENSORBOARD: Module = Module {
    name: "tensorboard",
    probe: "from tensorboard.backend.event_processing import event_accumulator",
    script: "\
import sys
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
events = EventAccumulator(sys.argv[1], size_guidance={'scalars': 0, 'images': 0})
events.Reload()
for tag in events.Tags()['scalars']:
    for event in events.Scalars(tag):
        assert event.wall_time > 1.7e9
        print('scalar', tag, event.step, event.value)
for tag in events.Tags()['images']:
    for event in events.Images(tag):
        assert event.encoded_image_string.startswith(b'\\x89PNG')
        print('image', tag, event.step, event.width, event.height)
",
};

/// All trials.
pub fn trials() -> Vec<Trial> {
    vec![
        trial("exr::python_openexr", || OPENEXR.absent(), openexr_finds_every_number),
        trial("ply::plyfile", || PLYFILE.absent(), plyfile_finds_every_number),
        trial("mp4::ffmpeg", no_ffmpeg, ffmpeg_finds_every_frame),
        trial("events::tensorboard", || TENSORBOARD.absent(), tensorboard_finds_every_step_once),
    ]
}

/// A trial with a trained run, where nothing is `absent`.
fn trial(what: &str, absent: fn() -> Option<String>, check: fn(&Path) -> Result<()>) -> Trial {
    // Asked only when the trial runs: a list of the trials need not wait for Python.
    Trial::ignorable_test(format!("foreign::{what}"), move || {
        if let Some(reason) = absent() {
            return Ok(Completion::ignored_with(reason));
        }
        let folder = tempfile::tempdir()?;
        let settings = ["--set", "eval.pictures=false"];
        train(&folder.path().join(RUN), &settings).and_then(|_| check(folder.path())).map_err(failed)?;
        Ok(Completion::Completed)
    })
}

impl Module {
    /// The reason why this machine cannot use it; `None` if it can.
    pub fn absent(&self) -> Option<String> {
        let Ok(output) = Command::new("python3").args(["-c", self.probe]).output() else {
            return Some("no python3 was found".to_owned());
        };
        let said = String::from_utf8_lossy(&output.stderr);
        let complaint = said.trim_end().lines().next_back().unwrap_or_default();
        let reason = || format!("python3 has no {0} (`python3 -m pip install {0}`): {complaint}", self.name);
        (!output.status.success()).then(reason)
    }

    /// What it finds in a file.
    pub fn read(&self, path: &Path) -> Result<String> {
        let printed = output(Command::new("python3").args(["-c", self.script]).arg(path), self.name)?;
        Ok(String::from_utf8(printed)?)
    }
}

/// What a program prints.
fn output(command: &mut Command, name: &str) -> Result<Vec<u8>> {
    let output = command.output().with_context(|| format!("{name} cannot be started"))?;
    ensure!(output.status.success(), "{name} fails: {}", String::from_utf8_lossy(&output.stderr));
    Ok(output.stdout)
}

/// Numbers with blanks between them.
fn numbers(text: &str) -> Result<Vec<f32>> {
    text.split(' ').map(|word| word.parse::<f32>().with_context(|| format!("`{word}` is no number"))).collect()
}

/// Renders all layers of the run in a format.
fn film(folder: &Path, format: &str) -> Result<PathBuf> {
    let (run, film) = (folder.join(RUN), folder.join(FILM));
    let (frames, size) = (FRAMES.to_string(), SIZE.map(|side| side.to_string()).join("x"));
    let what = ["render", text(&run)?, "--layers", "all", "--format", format, "--frames", &frames, "--size", &size];
    mvfusion(&[&what[..], &["--device", "cpu", "--out", text(&film)?]].concat())?;
    Ok(film)
}

fn openexr_finds_every_number(folder: &Path) -> Result<()> {
    let path = film(folder, "exr")?.join("exr").join("00001.exr");
    let ours = exr::prelude::read_first_flat_layer_from_file(&path)?.layer_data;
    ensure!([ours.size.0, ours.size.1] == SIZE, "the picture has {:?} pixels", ours.size);
    let ours: BTreeMap<String, Vec<f32>> = ours
        .channel_data
        .list
        .iter()
        .map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect()))
        .collect();
    let mut theirs = BTreeMap::new();
    for line in OPENEXR.read(&path)?.lines() {
        let (name, values) = line.split_once(' ').context("a name and numbers")?;
        theirs.insert(name.to_owned(), numbers(values)?);
    }
    let mut wanted: Vec<String> = ["R", "G", "B"].map(str::to_owned).to_vec();
    for layer in Layer::ALL {
        wanted.extend(layer.channels().iter().map(|channel| format!("{layer}.{channel}")));
    }
    wanted.sort();
    ensure!(theirs.keys().eq(&wanted), "OpenEXR finds the channels {:?}, not {wanted:?}", theirs.keys());
    for (name, plane) in &theirs {
        ensure!(ours.get(name) == Some(plane), "OpenEXR finds other numbers in {name}");
    }
    Ok(())
}

fn plyfile_finds_every_number(folder: &Path) -> Result<()> {
    let (run, export) = (folder.join(RUN), folder.join(EXPORT));
    mvfusion(&["export", text(&run)?, "--out", text(&export)?, "--frames", "1", "--device", "cpu"])?;
    for name in ["static.ply", "dynamic.ply", "frames/frame0001.ply"] {
        let path = export.join(name);
        let (ours, said) = (Ply::read(&path)?, PLYFILE.read(&path)?);
        let mut lines = said.lines();
        let names = lines.next().context("names")?.split(' ').map(str::to_owned).collect();
        let theirs = Ply { names, rows: lines.map(numbers).collect::<Result<_>>()? };
        ensure!(!ours.rows.is_empty(), "{name} is empty");
        ensure!(ours.names == theirs.names, "{name}: plyfile finds {:?}, not {:?}", theirs.names, ours.names);
        ensure!(ours.rows == theirs.rows, "{name}: plyfile finds other numbers");
    }
    Ok(())
}

/// The reason why there are no videos; `None` if there can be.
fn no_ffmpeg() -> Option<String> {
    (!mvfusion_data::can_write_videos()).then(|| "no program ffmpeg was found".to_owned())
}

fn ffmpeg_finds_every_frame(folder: &Path) -> Result<()> {
    let film = film(folder, "mp4")?;
    for layer in Layer::ALL {
        let mut command = Command::new("ffmpeg");
        command.args(["-v", "error", "-nostdin", "-i"]).arg(film.join(format!("video_{layer}.mp4")));
        command.args(["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]);
        let found = output(&mut command, "ffmpeg")?.len();
        let wanted = 3 * SIZE[0] * SIZE[1] * FRAMES;
        ensure!(found == wanted, "{layer}: {found} bytes are in the frames, not {wanted}");
    }
    let mut left = std::fs::read_dir(film)?.map(|entry| Ok(entry?.file_name())).collect::<Result<Vec<_>>>()?;
    left.retain(|name| name != "films.json");
    ensure!(left.len() == Layer::ALL.len(), "{left:?} lie in the folder, and some of them are no videos");
    Ok(())
}

/// The tiny run has 8 steps, and with this setting 10.
const LONGER: &str = "train.stages.refinement=5";
const STEPS: [u64; 10] = [1, 2, 3, 4, 5, 6, 7, 8, 9, 10];

fn tensorboard_finds_every_step_once(folder: &Path) -> Result<()> {
    let run = folder.join("curves");
    let settings = ["train.tensorboard=true", "train.checkpoint_interval=3", "eval.pictures=false"];
    train(&run, &settings.iter().flat_map(|setting| ["--set", setting]).collect::<Vec<_>>())?;
    // As if it had been killed while it wrote, after step 8, and the newest checkpoint were that of step 3.
    let events = run.join("tensorboard");
    let file = std::fs::read_dir(&events)?.next().context("an event file")??.path();
    let bytes = std::fs::read(&file)?;
    std::fs::write(&file, &bytes[..bytes.len() - 100])?;
    for name in ["step_6.safetensors", "final.safetensors"] {
        std::fs::remove_file(run.join("checkpoints").join(name))?;
    }
    let before = scalars(&TENSORBOARD.read(&events)?)?;
    ensure!(before["train/loss"].keys().eq(&STEPS[..8]), "half an event makes the file unreadable: {before:?}");
    mvfusion(&["train", "--resume", text(&run)?, "--set", LONGER])?;
    ensure!(std::fs::read_dir(&events)?.count() == 2, "the continued run has no file of its own");

    let said = TENSORBOARD.read(&events)?;
    let found = scalars(&said)?;
    let log = std::fs::read_to_string(run.join("metrics.jsonl"))?;
    let log: Vec<serde_json::Value> = log.lines().map(serde_json::from_str).collect::<Result<_, _>>()?;
    let logged = [
        ("train/loss", "/loss"),
        ("train/psnr", "/psnr"),
        ("train/steps_per_second", "/steps_per_second"),
        ("gaussians/static", "/gaussians/static"),
        ("gaussians/dynamic", "/gaussians/dynamic"),
    ];
    for (tag, pointer) in logged {
        let curve = found.get(tag).with_context(|| format!("there is no {tag}: {said}"))?;
        ensure!(curve.keys().eq(&STEPS), "{tag} has the steps {:?}", curve.keys());
        for line in &log {
            let step = line["step"].as_u64().context("a step")?;
            let ours = line.pointer(pointer).and_then(serde_json::Value::as_f64).context("a number")?;
            ensure!(curve[&step] == ours as f32, "{tag} of step {step} is {}, not {ours}", curve[&step]);
        }
    }
    for tag in ["rates/dynamic.means", "rates/deformation", "rates/mask_heads"] {
        ensure!(found.get(tag).is_some_and(|curve| curve.keys().eq(&STEPS)), "{tag} is not complete: {said}");
    }
    let results: serde_json::Value = serde_json::from_slice(&std::fs::read(run.join("results.json"))?)?;
    let psnr = results["test"]["composed"]["psnr"].as_f64().context("a PSNR")? as f32;
    ensure!(found["test/composed.psnr"] == BTreeMap::from([(10, psnr)]), "{:?}", found["test/composed.psnr"]);
    let strip = image::open(run.join("strips/00000.png"))?;
    let line = format!("image strips/00000 10 {} {}", strip.width(), strip.height());
    ensure!(said.lines().any(|said| said == line), "`{line}` is missing: {said}");
    Ok(())
}

/// The curves among printed lines: by their names, the value of each step, none of which may stand twice.
fn scalars(said: &str) -> Result<BTreeMap<String, BTreeMap<u64, f32>>> {
    let mut curves = BTreeMap::<String, BTreeMap<u64, f32>>::new();
    for line in said.lines().filter_map(|line| line.strip_prefix("scalar ")) {
        let [tag, step, value] = line.split(' ').collect::<Vec<_>>()[..] else { bail!("`{line}` has other parts") };
        let before = curves.entry(tag.to_owned()).or_default().insert(step.parse()?, value.parse()?);
        ensure!(before.is_none(), "{tag} has step {step} twice");
    }
    Ok(curves)
}
