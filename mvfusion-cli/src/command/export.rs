//! `mvfusion export`.

use std::io::Write;

use mvfusion_data::GaussianCloud;
use mvfusion_data::write::gaussian_ply;
use mvfusion_model::train::final_level;

use crate::args::{ExportArgs, ExportFormat};
use crate::atomic;
use crate::export::{self, Exporter, InriaModel, Moment};
use crate::progress::{Progress, Verbosity};
use crate::run::{Existing, MasksRequest, OpenRun, RunFolder, RunPlan, RunRequest};

/// Width of the first column.
const LABEL: usize = 16;

/// Writes a run's Gaussians and cameras for other programs.
///
/// # Errors
/// If the run is not complete, its data are missing, the folder is not empty, the device fails, or a file cannot be
/// written.
pub fn export(args: &ExportArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let existing = if args.force { Existing::Replace } else { Existing::Keep };
    let plan = RunPlan::for_contents(&args.out, existing, export::CONTENTS)?;
    let data = args.data.as_deref();
    let request = RunRequest { run: &args.run, data, masks: MasksRequest::Unused, device: &args.compute.device };
    let run = OpenRun::open(&request, verbosity)?;
    let exporter = exporter(args, &run, verbosity);
    let mut folder = plan.create()?;
    Session { args, run: &run, exporter, folder: &folder }.write(verbosity, out)?;
    folder.finish();
    Ok(())
}

/// The model to export.
fn exporter(args: &ExportArgs, run: &OpenRun, verbosity: Verbosity) -> Exporter {
    let level = final_level(&run.config);
    Exporter { model: run.model(args.no_mfta, verbosity), level, context: run.render_context() }
}

/// An export under way.
struct Session<'a> {
    args: &'a ExportArgs,
    run: &'a OpenRun,
    exporter: Exporter,
    folder: &'a RunFolder,
}

impl Session<'_> {
    fn write(&self, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
        export::write_cameras(&self.run.scene, &self.folder.place(&[export::CAMERAS])?)?;
        let wanted = |format| self.args.format.contains(&format);
        if wanted(ExportFormat::Ply) {
            self.write_branches(out)?;
        }
        // These formats show the scene at one time. Canonical Gaussians do not belong to any time.
        let moment = Moment::At(self.args.time.unwrap_or(0.0));
        if wanted(ExportFormat::Splat) {
            let gaussians = self.exporter.scene(moment)?;
            export::write_splat(&gaussians, &self.folder.place(&[export::SPLAT])?)?;
            tell(out, export::SPLAT, &gaussians)?;
        }
        if wanted(ExportFormat::Inria) {
            let gaussians = &self.exporter.scene(moment)?;
            let OpenRun { config, scene, trained, .. } = self.run;
            let model = InriaModel { gaussians, scene, config, steps: trained.steps };
            export::write_inria(&model, self.folder)?;
            tell(out, "point_cloud", gaussians)?;
        }
        if let Some(frames) = self.args.frames {
            self.write_frames(frames.get(), verbosity)?;
            writeln!(out, "{:LABEL$}{frames}", export::FRAMES)?;
        }
        writeln!(out, "{:LABEL$}{}", "written to", self.folder.path().display())?;
        Ok(())
    }

    /// The Gaussians of each branch, in separate files.
    fn write_branches(&self, out: &mut dyn Write) -> anyhow::Result<()> {
        let moment = self.args.time.map_or(Moment::Canonical, Moment::At);
        let static_ = self.exporter.static_()?.map(|gaussians| (export::STATIC, gaussians));
        for (name, gaussians) in static_.into_iter().chain([(export::DYNAMIC, self.exporter.dynamic(moment)?)]) {
            atomic::write(&self.folder.place(&[name])?, &gaussian_ply(&gaussians))?;
            tell(out, name, &gaussians)?;
        }
        Ok(())
    }

    /// The whole scene at evenly spaced times.
    fn write_frames(&self, frames: usize, verbosity: Verbosity) -> anyhow::Result<()> {
        let last = self.exporter.context.timeline.times().last().copied().unwrap_or(0.0);
        let mut progress = Progress::new("frames", frames, verbosity);
        for (frame, time) in export::frame_times(frames, last).into_iter().enumerate() {
            let gaussians = self.exporter.scene(Moment::At(time))?;
            atomic::write(
                &self.folder.place(&[export::FRAMES, &export::frame_name(frame)])?,
                &gaussian_ply(&gaussians),
            )?;
            progress.advance();
        }
        progress.finish();
        Ok(())
    }
}

fn tell(out: &mut dyn Write, name: &str, gaussians: &GaussianCloud) -> std::io::Result<()> {
    writeln!(out, "{name:LABEL$}{} Gaussians", gaussians.len())
}
