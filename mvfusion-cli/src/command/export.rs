//! `mvfusion export`.

use std::io::Write;

use anyhow::Context;
use bytesize::ByteSize;
use mvfusion_data::GaussianCloud;
use mvfusion_data::write::{gaussian_npz, gaussian_ply};
use mvfusion_model::ModelError;
use mvfusion_model::model::harmonics::without_directions;

use crate::args::{ExportArgs, ExportFormat};
use crate::atomic;
use crate::export::moving::{Clock, MovingFile, Samples};
use crate::export::{self, ComparedTimes, Exporter, Fidelity, InriaModel, Loss, Moment};
use crate::failure::UsageError;
use crate::progress::{Progress, Verbosity};
use crate::run::{Existing, MasksRequest, OpenRun, RunFolder, RunPlan, RunRequest};

/// Width of the first column.
const LABEL: usize = 16;

/// Writes a run's Gaussians and cameras for other programs.
///
/// # Errors
/// If the run has no checkpoint, its data are missing, the folder is not empty, the device fails, or a file cannot be
/// written.
pub fn export(args: &ExportArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    if args.page.html.is_some() {
        return super::export_page::export_page(args, verbosity, out);
    }
    check(args)?;
    let existing = if args.force { Existing::Replace } else { Existing::Keep };
    let plan = RunPlan::for_contents(&args.out, existing, export::CONTENTS)?;
    let data = args.data.as_deref();
    let request = RunRequest { run: &args.run, data, masks: MasksRequest::Unused, device: &args.compute.device };
    let run = OpenRun::open(&request, verbosity)?;
    let exporter = Exporter::of(&run, args.no_mfta, verbosity).cropped(&args.crop, verbosity)?;
    let mut folder = plan.create()?;
    Session { args, run: &run, exporter, folder: &folder, verbosity }
        .write(out)
        .with_context(|| format!("the export failed, and nothing of it is kept in {}", args.out.display()))?;
    folder.finish();
    Ok(())
}

/// Refuses what only a film has where none is written, and a time where nothing but a film is.
fn check(args: &ExportArgs) -> Result<(), UsageError> {
    if args.time.is_some() && args.format.iter().all(|format| *format == ExportFormat::Moving) {
        return Err(UsageError::new("--time is about one moment, and scene.4dgs holds all of them: leave it out."));
    }
    let given = [("--samples", args.samples.is_some()), ("--precision", args.precision.is_some())];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        Some((name, _)) if !args.format.contains(&ExportFormat::Moving) => {
            Err(UsageError::new(format!("{name} is about scene.4dgs, which is written with --format 4dgs.")))
        }
        _ => Ok(()),
    }
}

/// An export under way.
struct Session<'a> {
    args: &'a ExportArgs,
    run: &'a OpenRun,
    exporter: Exporter,
    folder: &'a RunFolder,
    verbosity: Verbosity,
}

impl Session<'_> {
    fn write(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        export::write_cameras(&self.run.scene, &self.folder.place(&[export::CAMERAS])?)?;
        if self.wants(ExportFormat::Ply) {
            self.write_branches(out)?;
        }
        if [ExportFormat::Splat, ExportFormat::Inria, ExportFormat::Glb].into_iter().any(|format| self.wants(format)) {
            self.write_still(out)?;
        }
        if self.wants(ExportFormat::Moving) {
            self.write_moving(out)?;
        }
        if self.wants(ExportFormat::Npz) {
            self.write_arrays(out)?;
        }
        if let Some(frames) = self.args.frames {
            if self.wants(ExportFormat::Npz) {
                self.write_array_frames(frames.get(), out)?;
            }
            if self.args.format.iter().any(|format| *format != ExportFormat::Npz) || self.args.format.is_empty() {
                self.write_frames(frames.get(), out)?;
            }
        }
        self.verbosity.wrote("export", self.folder.path());
        writeln!(out, "{:LABEL$}{}", "written to", self.folder.path().display())?;
        Ok(())
    }

    fn wants(&self, format: ExportFormat) -> bool {
        self.args.format.contains(&format)
    }

    /// The state of the dynamic Gaussians in files of a branch.
    fn moment(&self) -> Moment {
        self.args.time.map_or(Moment::Canonical, Moment::At)
    }

    /// The Gaussians of each branch, in separate files.
    fn write_branches(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        self.write_static(out)?;
        let gaussians = self.exporter.dynamic(self.moment())?;
        atomic::write(&self.folder.place(&[export::DYNAMIC])?, &gaussian_ply(&gaussians))?;
        tell(out, export::DYNAMIC, &gaussians)
    }

    /// The static Gaussians, if there are any.
    fn write_static(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let Some(gaussians) = self.exporter.static_()? else { return Ok(()) };
        atomic::write(&self.folder.place(&[export::STATIC])?, &gaussian_ply(&gaussians))?;
        tell(out, export::STATIC, &gaussians)
    }

    /// The formats that show both branches at one time. Canonical Gaussians do not belong to any time.
    fn write_still(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let time = self.args.time.unwrap_or(0.0);
        let gaussians = &self.exporter.scene(Moment::At(time))?;
        let fidelity = self.fidelity(ComparedTimes::At(&[time]))?;
        if self.wants(ExportFormat::Splat) {
            // The format has no other colours than constant ones.
            let flat = without_directions(gaussians.clone(), &export::eyes(&self.run.scene));
            let bytes = export::encode_splat(&flat);
            atomic::write(&self.folder.place(&[export::SPLAT])?, &bytes)?;
            tell(out, export::SPLAT, &flat)?;
            // As others will read it, with bytes for colours, opacities and rotations.
            tell_loss(out, &fidelity.loss(|_| Ok(export::decode_splat(&bytes).into()))?)?;
        }
        if !self.wants(ExportFormat::Inria) && !self.wants(ExportFormat::Glb) {
            return Ok(());
        }
        if self.wants(ExportFormat::Inria) {
            let OpenRun { config, scene, trained, .. } = self.run;
            let model = InriaModel { gaussians, scene, config, steps: trained.steps };
            export::write_inria(&model, self.folder)?;
            tell(out, "point_cloud", gaussians)?;
        }
        if self.wants(ExportFormat::Glb) {
            let bytes = export::encode_glb(gaussians, &self.run.scene, time)?;
            atomic::write(&self.folder.place(&[export::GLB])?, &bytes)?;
            writeln!(out, "{:LABEL$}{} Gaussians, {}", export::GLB, gaussians.len(), size(bytes.len()))?;
        }
        tell_loss(out, &fidelity.loss(|_| Ok(gaussians.clone().into()))?)
    }

    /// The whole scene in motion.
    fn write_moving(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let clock = Clock::of(&self.exporter.context.timeline);
        let precision = self.args.precision.unwrap_or_default();
        let count = Samples::count(self.args.samples.map(usize::from), clock, precision)?;
        let mut progress = Progress::new("samples", 2 * count + 1, self.verbosity);
        let static_ = self.exporter.static_()?;
        let scene_at = |time: f64| -> Result<GaussianCloud, ModelError> {
            let dynamic = self.exporter.dynamic_without_masks(Moment::At(time))?;
            progress.advance();
            Ok(match &static_ {
                Some(static_) => static_.clone().joined(dynamic),
                None => dynamic,
            })
        };
        let eyes = export::eyes(&self.run.scene);
        let samples = Samples::take(count, clock, precision, &eyes, scene_at)?;
        progress.finish();
        let path = self.folder.place(&[export::MOVING])?;
        let bytes = samples.encode()?;
        atomic::write(&path, &bytes)?;
        let (gaussians, size) = (samples.gaussians(), size(bytes.len()));
        writeln!(out, "{:LABEL$}{gaussians} Gaussians at {count} times, {size}", export::MOVING)?;
        // The file as others will read it, not what was meant to be in it.
        let mut file = MovingFile::open(&path)?;
        let found = file.check(&samples)?;
        writeln!(out, "{:LABEL$}{}", "error bound", file.bounds())?;
        writeln!(out, "{:LABEL$}{found}", "largest error")?;
        let fidelity = self.fidelity(ComparedTimes::OfViews)?;
        tell_loss(out, &fidelity.loss(|time| Ok(file.cloud_at(clock.second(time))?.into()))?)
    }

    /// The whole scene at evenly spaced times.
    fn write_frames(&self, frames: usize, out: &mut dyn Write) -> anyhow::Result<()> {
        let is_shared = self.args.shared_static && self.exporter.model.static_.is_some();
        let scene_at = |time: f64| match is_shared {
            true => self.exporter.dynamic_without_masks(Moment::At(time)),
            false => self.exporter.scene(Moment::At(time)),
        };
        if is_shared && !self.wants(ExportFormat::Ply) {
            self.write_static(out)?;
        }
        let times = self.frame_times(frames);
        let first = gaussian_ply(&scene_at(times[0])?);
        tell_frames(out, frames, first.len())?;
        let mut progress = Progress::new("frames", frames, self.verbosity);
        for (frame, &time) in times.iter().enumerate() {
            let bytes = if frame == 0 { first.clone() } else { gaussian_ply(&scene_at(time)?) };
            atomic::write(&self.folder.place(&[export::FRAMES, &export::frame_name(frame, "ply")])?, &bytes)?;
            progress.advance();
        }
        progress.finish();
        // These are the numbers of the files; with shared static Gaussians, of both files together.
        let whole = |time: f64| Ok(self.exporter.scene(Moment::At(time))?.into());
        tell_loss(out, &self.fidelity(ComparedTimes::At(&times))?.loss(whole)?)
    }

    /// The Gaussians of each branch as arrays, in separate files.
    fn write_arrays(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        if let Some(gaussians) = self.exporter.static_()? {
            self.write_npz(&[export::STATIC_NPZ], &gaussians, None)?;
            tell(out, export::STATIC_NPZ, &gaussians)?;
        }
        let gaussians = self.exporter.dynamic(self.moment())?;
        self.write_npz(&[export::DYNAMIC_NPZ], &gaussians, self.args.time)?;
        tell(out, export::DYNAMIC_NPZ, &gaussians)
    }

    /// The dynamic branch as arrays at evenly spaced times.
    fn write_array_frames(&self, frames: usize, out: &mut dyn Write) -> anyhow::Result<()> {
        let times = self.frame_times(frames);
        let mut progress = Progress::new("frames", frames, self.verbosity);
        for (frame, &time) in times.iter().enumerate() {
            let gaussians = self.exporter.dynamic(Moment::At(time))?;
            let bytes = self.write_npz(&[export::FRAMES, &export::frame_name(frame, "npz")], &gaussians, Some(time))?;
            if frame == 0 {
                tell_frames(out, frames, bytes)?;
            }
            progress.advance();
        }
        progress.finish();
        Ok(())
    }

    /// Writes an archive of arrays; returns its size in bytes.
    fn write_npz(&self, path: &[&str], gaussians: &GaussianCloud, time: Option<f64>) -> anyhow::Result<usize> {
        let bytes = gaussian_npz(gaussians, time).context("cannot pack the arrays")?;
        atomic::write(&self.folder.place(path)?, &bytes)?;
        Ok(bytes.len())
    }

    fn frame_times(&self, frames: usize) -> Vec<f64> {
        let last = self.exporter.context.timeline.times().last().copied().unwrap_or(0.0);
        export::frame_times(frames, last)
    }

    /// The renders that exported Gaussians are compared with.
    fn fidelity(&self, times: ComparedTimes<'_>) -> anyhow::Result<Fidelity<'_>> {
        Fidelity::new(self.run, &self.exporter, times, self.verbosity)
    }
}

fn tell(out: &mut dyn Write, name: &str, gaussians: &GaussianCloud) -> anyhow::Result<()> {
    Ok(writeln!(out, "{name:LABEL$}{} Gaussians", gaussians.len())?)
}

/// How much a sequence takes, before it is written. All frames have as many Gaussians, so they are equally large.
fn tell_frames(out: &mut dyn Write, frames: usize, bytes: usize) -> anyhow::Result<()> {
    let (each, all) = (size(bytes), size(bytes * frames));
    writeln!(out, "{:LABEL$}{frames} files of {each}, {all} in all", export::FRAMES)?;
    Ok(out.flush()?)
}

/// What the last file costs.
fn tell_loss(out: &mut dyn Write, loss: &Loss) -> anyhow::Result<()> {
    Ok(writeln!(out, "{:LABEL$}{loss}", "PSNR")?)
}

/// A number of bytes, in the units of disks.
fn size(bytes: usize) -> String {
    ByteSize(bytes as u64).display().si().to_string()
}
