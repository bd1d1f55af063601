//! `mvfusion check`.

use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use bytesize::ByteSize;
use mvfusion_data::Scene;
use mvfusion_data::inspect::{
    ContactSheet, Inspection, Pictures, Problem, Severity, Summary, inspect, points_over_photos,
};
use mvfusion_model::memory::MemoryNeed;
use mvfusion_model::{Config, ModelError};
use serde::Serialize;

use super::duration::Predicted;
use crate::args::CheckArgs;
use crate::config::{self, Resolved};
use crate::memory::{Available, need_of_training, refusal_of_training};
use crate::progress::Verbosity;
use crate::{atomic, device};

/// Photos in the image of the points.
const PHOTOS: usize = 9;

/// Largest side of that image in pixels.
const LARGEST_SIDE: u32 = 1800;

/// Width of the first column.
const LABEL: usize = 12;

/// The findings, for scripts.
#[derive(Serialize)]
struct Report<'a> {
    folder: &'a Path,
    #[serde(flatten)]
    inspection: &'a Inspection,
    /// Whether training could start.
    can_train: bool,
    /// Memory that training needs, in bytes; absent if the scene could not be read.
    #[serde(skip_serializing_if = "Option::is_none")]
    memory: Option<MemoryNeed>,
    /// Predicted time of a training, in seconds; absent if it was not asked for, or could not be measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    time: Option<&'a Predicted>,
    /// The image of the points.
    #[serde(skip_serializing_if = "Option::is_none")]
    picture: Option<&'a Path>,
}

/// What was found of a scene.
struct Findings {
    folder: PathBuf,
    inspection: Inspection,
    /// Memory that training needs; `None` if the scene could not be read.
    memory: Result<Option<MemoryNeed>, ModelError>,
    time: Option<Predicted>,
    /// The image of the points, if it was to be drawn.
    drawn: Option<anyhow::Result<Drawn>>,
}

/// Inspects a scene and reports its contents, its problems and their remedies.
///
/// # Errors
/// If training cannot start, after the report; if the command line is wrong, or a file cannot be written.
pub fn check(args: &CheckArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let resolved = config::resolve(&args.sources, Some(&args.folder))?;
    device::check(&args.compute.device)?;
    refuse_to_replace(args.picture.as_deref())?;
    let findings = Findings::of(args, &resolved.config, verbosity)?;
    if args.json {
        serde_json::to_writer_pretty(&mut *out, &findings.report())?;
        writeln!(out)?;
    } else {
        findings.tell(&resolved, out)?;
    }
    findings.verdict()
}

impl Findings {
    fn of(args: &CheckArgs, config: &Config, verbosity: Verbosity) -> anyhow::Result<Self> {
        let folder = std::path::absolute(&args.folder)?;
        let pictures = if args.quick { Pictures::Sampled } else { Pictures::Decoded };
        if pictures == Pictures::Decoded {
            verbosity.note("decoding every image (--quick decodes only a few)");
        }
        let (mut inspection, mut scene) = inspect(&folder, &config.read_options(), pictures);
        if let (Some(scene), Some(masks)) = (&mut scene, &config.eval.dynamic_masks) {
            inspection.attach_masks(scene, masks);
        }
        let memory = scene.as_ref().map(|scene| need_of_training(config, scene)).transpose();
        let scene = scene.as_ref().filter(|_| inspection.can_train());
        let time = match (scene, &memory) {
            (Some(scene), Ok(Some(memory))) if !args.no_time => {
                predicted(config, scene, memory, &args.compute.device, verbosity)
            }
            _ => None,
        };
        let scene = scene.filter(|_| !args.no_picture);
        let drawn = scene.and_then(|scene| drawn(scene, args.picture.as_deref(), &folder, verbosity));
        Ok(Self { folder, inspection, memory, time, drawn })
    }

    fn report(&self) -> Report<'_> {
        Report {
            folder: &self.folder,
            inspection: &self.inspection,
            can_train: self.inspection.can_train() && self.memory.is_ok(),
            memory: self.memory.as_ref().ok().copied().flatten(),
            time: self.time.as_ref(),
            picture: self.drawn.as_ref().and_then(|drawn| Some(drawn.as_ref().ok()?.path.as_path())),
        }
    }

    fn tell(&self, resolved: &Resolved, out: &mut dyn Write) -> std::io::Result<()> {
        tell(&self.inspection, &self.folder, out)?;
        if let Ok(Some(memory)) = &self.memory {
            line(out, "memory", &memory_sentence(memory))?;
            tell_shortage(memory, &resolved.config, out)?;
            if let Some(time) = &self.time {
                line(out, "time", &time.sentence(&format!("{:LABEL$}", "")))?;
            }
            line(out, "preset", resolved.preset.name)?;
        }
        if let Some(Ok(drawn)) = &self.drawn {
            line(out, "look at", &drawn.sentence())?;
        }
        self.inspection.problems.iter().try_for_each(|problem| tell_problem(problem, out))
    }

    /// The error that follows the report, even if the image or the initial Gaussians failed.
    fn verdict(self) -> anyhow::Result<()> {
        self.drawn.transpose()?;
        self.memory?;
        let errors = self.inspection.problems.iter().filter(|problem| problem.severity == Severity::Error).count();
        if errors > 0 {
            let noun = if errors == 1 { "error" } else { "errors" };
            bail!("training cannot start on {}: see the {errors} {noun} above", self.folder.display());
        }
        Ok(())
    }
}

/// The predicted time of a training. A failure is a note: what else was found must be reported.
fn predicted(
    config: &Config,
    scene: &Scene,
    memory: &MemoryNeed,
    device: &str,
    verbosity: Verbosity,
) -> Option<Predicted> {
    verbosity.note("training a few steps to predict the time (--no-time does not)");
    let predicted = Predicted::measure(config, scene, memory, device);
    predicted.inspect_err(|error| verbosity.note(&format!("note:   the time is not predicted: {error:#}"))).ok()
}

/// `check-NAME.png` in the current folder.
fn default_picture(folder: &Path) -> PathBuf {
    let name = folder.file_name().map_or("scene".into(), |name| name.to_string_lossy());
    PathBuf::from(format!("check-{name}.png"))
}

/// Refuses a picture in place of a file that is not known by its name as an earlier picture of this command.
fn refuse_to_replace(picture: Option<&Path>) -> anyhow::Result<()> {
    let Some(path) = picture.filter(|path| path.exists()) else { return Ok(()) };
    let name = path.file_name().map_or("".into(), |name| name.to_string_lossy());
    let is_own = name == "check.png" || (name.starts_with("check-") && name.ends_with(".png"));
    if is_own && path.is_file() {
        return Ok(());
    }
    bail!("{} exists, and --picture replaces only check.png and check-NAME.png. Choose another file.", path.display())
}

fn line(out: &mut dyn Write, label: &str, text: &str) -> std::io::Result<()> {
    writeln!(out, "{label:LABEL$}{text}")
}

fn tell(inspection: &Inspection, folder: &Path, out: &mut dyn Write) -> std::io::Result<()> {
    line(out, "folder", &folder.display().to_string())?;
    line(out, "format", inspection.format.map_or("unknown", |format| format.name()))?;
    inspection.summary.as_ref().map_or(Ok(()), |summary| tell_summary(summary, out))
}

fn tell_summary(scene: &Summary, out: &mut dyn Write) -> std::io::Result<()> {
    let [least, most] = scene.views_per_camera;
    let per_camera = if least == most { most.to_string() } else { format!("{least} to {most}") };
    let [narrow, wide] = scene.field_of_view;
    let angle = if wide - narrow < 0.5 { format!("{wide:.0}°") } else { format!("{narrow:.0}° to {wide:.0}°") };
    line(out, "cameras", &format!("{} with {per_camera} views each, field of view {angle}", scene.cameras))?;
    let size = format!("{}x{}", scene.width, scene.height);
    let decoded = ByteSize(scene.decoded_bytes);
    let extras = [(scene.straightened, "are undistorted on reading"), (scene.masked, "have masks")];
    let extras = extras.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("; {count} {what}"));
    line(out, "images", &format!("{size}, {decoded} decoded{}", extras.collect::<String>()))?;
    line(out, "views", &format!("{} training, {} held out", scene.train, scene.test))?;
    let [first, last] = scene.times;
    line(out, "times", &format!("{} time steps from {first:.3} to {last:.3}", scene.moments))?;
    let near = scene.near.map_or(String::new(), |near| format!(", nothing nearer than {near:.3}"));
    line(out, "extent", &format!("{:.3} units around the cameras{near}", scene.extent))?;
    let seen = scene.points_seen.map_or(String::new(), |share| format!(", {:.0} % of them in an image", 100.0 * share));
    let agreement = scene.colour_agreement;
    let agreement =
        agreement.map_or(String::new(), |value| format!(", correlation {value:.2} with the colours of the photos"));
    line(out, "points", &format!("{}{seen}{agreement}", scene.points))
}

fn memory_sentence(need: &MemoryNeed) -> String {
    let size = |bytes: f64| ByteSize(bytes as u64);
    let host = need.host();
    format!(
        "about {} at the start, {} with the most Gaussians that the configuration allows; of this, {} and {} on a GPU",
        size(host + need.start),
        size(host + need.most),
        size(need.start),
        size(need.most)
    )
}

/// Warns if a training on the CPU of this machine would be refused.
fn tell_shortage(need: &MemoryNeed, config: &Config, out: &mut dyn Write) -> std::io::Result<()> {
    let device = device::open("cpu").ok();
    match device.and_then(|cpu| refusal_of_training(need, config, &cpu, Available::on_this_machine().as_ref())) {
        Some(refusal) => writeln!(out, "warning: on the CPU of this machine, {refusal}"),
        None => Ok(()),
    }
}

/// The image of the points.
struct Drawn {
    path: PathBuf,
    sheet: ContactSheet,
}

/// The image was drawn, but could not be written.
#[derive(Clone, Copy, Debug)]
struct NotWritten;

impl fmt::Display for NotWritten {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the image of the points is not written; choose a file with --picture, or use --no-picture")
    }
}

/// The image of the points. If nobody asked for it, one that cannot be written is a note: the scene may be sound.
fn drawn(scene: &Scene, asked: Option<&Path>, folder: &Path, verbosity: Verbosity) -> Option<anyhow::Result<Drawn>> {
    let drawn = draw(scene, asked.map_or_else(|| default_picture(folder), Path::to_owned));
    match &drawn {
        Ok(drawn) => verbosity.wrote("picture", &drawn.path),
        Err(error) if asked.is_none() && error.is::<NotWritten>() => {
            verbosity.note(&format!("note:   {error:#}"));
            return None;
        }
        Err(_) => {}
    }
    Some(drawn)
}

fn draw(scene: &Scene, path: PathBuf) -> anyhow::Result<Drawn> {
    let sheet = points_over_photos(scene, PHOTOS, LARGEST_SIDE)?;
    let written = atomic::write_png(&path, sheet.image.clone());
    written.context(NotWritten)?;
    Ok(Drawn { path, sheet })
}

impl Drawn {
    fn sentence(&self) -> String {
        let rows: Vec<String> = self.sheet.names.chunks(self.sheet.columns).map(|row| row.join(", ")).collect();
        let indent = format!("\n{:LABEL$}", "");
        let path = self.path.display();
        format!("{path}: the points (near red, far blue) must lie on their objects{indent}{}", rows.join(&indent))
    }
}

fn tell_problem(problem: &Problem, out: &mut dyn Write) -> std::io::Result<()> {
    let severity = match problem.severity {
        Severity::Error => "error",
        Severity::Warning => "warning",
        Severity::Note => "note",
    };
    writeln!(out, "{severity}: {}.\n  {}", problem.what, problem.remedy)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_an_earlier_picture_is_replaced() {
        let folder = tempfile::tempdir().expect("folder");
        for (name, is_free) in [("check.png", true), ("check-steak.png", true), ("photo.png", false)] {
            let path = folder.path().join(name);
            refuse_to_replace(Some(&path)).expect("not there yet");
            std::fs::write(&path, "x").expect("written");
            assert_eq!(refuse_to_replace(Some(&path)).is_ok(), is_free, "{name}");
        }
    }
}
