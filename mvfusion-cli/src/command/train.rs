//! `mvfusion train`.

use std::io::Write;
use std::path::{Path, PathBuf};

use mvfusion_data::{BuiltinKind, Scene};
use mvfusion_model::evaluation::{Evaluator, Protocol};
use mvfusion_model::files::sha256;
use mvfusion_model::train::{Losses, Position, TrainedModel, Trainer};
use mvfusion_model::{Config, ModelError};
use tracing::{info, warn};

use super::score::{self, Scoring};
use crate::args::TrainArgs;
use crate::config::{self, Resolved};
use crate::device::{self, OpenDevice};
use crate::progress::{Pace, Progress, Verbosity};
use crate::run::{
    self, Existing, GaussianCounts, MetricsLine, MetricsLog, PicturesWriter, RunFolder, RunPlan, RunRecord, TrainTime,
    milliseconds, write_ply,
};
use crate::{atomic, report, scene, table};

/// Parent folder of the runs, unless `--out` is given.
const RUNS: &str = "runs";

/// Trains on a scene, evaluates, and writes a run folder.
///
/// # Errors
/// For an invalid command line, before anything is written. Later, if the device fails, the loss is not finite, or a
/// file cannot be written.
pub fn train(args: &TrainArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let mut resolved = config::resolve(&args.sources, args.data.as_deref())?;
    if let Some(note) = &resolved.note {
        verbosity.note(note);
    }
    if let Some(weights) = &args.lpips_weights {
        resolved.config.eval.lpips_weights = Some(std::path::absolute(weights)?);
    }
    let device = device::open(&args.compute.device)?;
    let path = args.out.clone().unwrap_or_else(|| default_folder(&resolved));
    let existing = if args.force { Existing::Replace } else { Existing::Keep };
    let plan = RunPlan::new(&path, existing)?;
    let scene = scene::open(&resolved.config)?;
    // Adapted before it is written: the trained configuration must stay valid even if the scene gains a photo.
    let given = std::mem::take(&mut resolved.config);
    resolved.config = given.for_times_of(&scene);
    let trainer = Trainer::new(resolved.config.scaled(), &scene, &device.device)?
        .with_image_cache(&scene, args.image_cache.as_u64())?;
    let weights = resolved.config.eval.lpips_weights.as_deref();
    let evaluator = score::evaluator(Protocol::Mvfusion, weights, &device.device)?;
    verbosity.note(&format!("device: {}", device.reason));
    verbosity.note(&format!("scene:  {}", scene::describe(&scene)));
    if let Some(sentence) = times_sentence(&given, &resolved.config) {
        verbosity.note(&format!("times:  {sentence}"));
    }
    if let Some(seeding) = trainer.seeding() {
        verbosity.note(&format!("motion: {seeding}"));
    }
    verbosity.note(&format!("run:    {}", path.display()));
    warn_of_placement(&trainer, &scene)?;

    let folder = plan.create()?;
    Session { resolved, device, scene, trainer, evaluator, folder, verbosity }.run(out)
}

/// Warns if too few dynamic Gaussians start on moving pixels: the result of such a run would be blurred.
fn warn_of_placement(trainer: &Trainer, scene: &Scene) -> Result<(), ModelError> {
    let Some(placement) = trainer.placement(scene)? else { return Ok(()) };
    match placement.advice() {
        Some(advice) => warn!("{placement}; {advice}"),
        None => info!("{placement}"),
    }
    Ok(())
}

/// The keys that were adapted to the scene's times, with both values; `None` if there are none.
fn times_sentence(given: &Config, fitted: &Config) -> Option<String> {
    let numbers = |config: &Config| {
        let Config { model, motion, .. } = config;
        [
            ("model.grid.resolution[3]", model.grid.resolution[3]),
            ("motion.window", motion.window),
            ("motion.knots", motion.knots),
        ]
    };
    let changed = numbers(given).into_iter().zip(numbers(fitted)).filter(|(given, fitted)| given != fitted);
    let said: Vec<String> = changed.map(|((key, given), (_, fitted))| format!("{key} {given} -> {fitted}")).collect();
    (!said.is_empty()).then(|| said.join(", "))
}

/// `runs/NAME-SEED`. NAME is the name of the scene folder, or of the preset, followed by `-casual` for the second
/// built-in scene.
fn default_folder(resolved: &Resolved) -> PathBuf {
    let options = &resolved.config.scene;
    let name = match &options.data {
        Some(folder) => folder.file_name().map_or("scene".into(), |name| name.to_string_lossy().into_owned()),
        None if options.kind == BuiltinKind::Casual => format!("{}-casual", resolved.preset.name),
        None => resolved.preset.name.to_owned(),
    };
    Path::new(RUNS).join(format!("{name}-{}", resolved.config.seed))
}

/// A training in progress.
struct Session {
    resolved: Resolved,
    device: OpenDevice,
    scene: Scene,
    trainer: Trainer,
    evaluator: Evaluator,
    folder: RunFolder,
    verbosity: Verbosity,
}

impl Session {
    fn run(mut self, out: &mut dyn Write) -> anyhow::Result<()> {
        let seed = self.resolved.config.seed;
        let record = RunRecord::begin(self.resolved.preset.name, &self.scene, seed, &self.device.name);
        let written = config::to_toml(&self.resolved.config)?;
        atomic::write(&self.folder.place(&[run::CONFIG])?, written.as_bytes())?;
        atomic::write_json(&self.folder.place(&[run::RECORD])?, &record)?;

        let time = self.train()?;
        self.save(run::FINAL)?;
        self.write_gaussians(time.steps)?;
        self.evaluate(time, sha256(written.as_bytes()), out)?;
        atomic::write_json(&self.folder.place(&[run::RECORD])?, &record.finished())?;
        // Last, because the report is built from all other files.
        let report = report::write(self.folder.path())?;
        Ok(writeln!(out, "{:16}{}", "report", report.display())?)
    }

    /// All steps of all stages.
    fn train(&mut self) -> anyhow::Result<TrainTime> {
        let total = self.trainer.config().train.stages.total();
        let every = self.trainer.config().train.checkpoint_interval.0;
        let log = MetricsLog::create(&self.folder.place(&[run::METRICS])?)?;
        let mut watch = Watch {
            log,
            progress: Progress::new("training", total, self.verbosity),
            pace: Pace::default(),
            logged: 0,
            total,
        };
        while let Some(position) = self.trainer.position() {
            let Some(loss) = self.trainer.step()? else { break };
            let done = self.trainer.state().completed;
            if self.trainer.log_due(&position) {
                watch.log_step(&self.trainer, &position, &loss)?;
            }
            watch.progress.advance();
            if every > 0 && done.is_multiple_of(every) && done < total {
                self.save(&format!("step_{done}.safetensors"))?;
            }
        }
        watch.progress.finish();
        Ok(TrainTime { seconds: watch.pace.elapsed(), steps: self.trainer.state().completed })
    }

    /// Writes the state. After the first one, the folder is kept even if the run fails.
    fn save(&mut self, name: &str) -> anyhow::Result<()> {
        self.trainer.state().save(&self.folder.place(&[run::CHECKPOINTS, name])?)?;
        self.folder.keep();
        Ok(())
    }

    fn write_gaussians(&self, steps: usize) -> anyhow::Result<()> {
        let iteration = format!("iteration_{steps}");
        let model = self.trainer.state().model.plain();
        for (name, branch) in model.branches() {
            let file = format!("{name}.ply");
            let cloud = branch.to_cloud()?;
            write_ply(&cloud, &self.folder.place(&[run::POINT_CLOUD, &iteration, &file])?)?;
        }
        Ok(())
    }

    /// Scores the model, writes metrics and images, and prints the table.
    fn evaluate(&self, time: TrainTime, config_sha256: String, out: &mut dyn Write) -> anyhow::Result<()> {
        let config = self.trainer.config();
        let pictures = PicturesWriter::new(self.folder.path(), &config.eval, self.scene.test.len());
        let trained = TrainedModel::from(self.trainer.state());
        let scoring = Scoring {
            trained: &trained,
            scene: &self.scene,
            config,
            config_sha256,
            evaluator: &self.evaluator,
            speed_frames: 0,
            time: Some(time),
            device: &self.device.name,
        };
        let scored = scoring.score(Some(&pictures), self.verbosity)?;
        scored.write(self.folder.path())?;
        table::write(&scored.results, self.evaluator.protocol(), out)?;
        writeln!(out, "{:16}{}", "run", self.folder.path().display())?;
        if let Some(strip) = pictures.strip_to_see() {
            writeln!(out, "{:16}{}", "start with", strip.display())?;
            writeln!(out, "{:16}({})", "", run::legend(&self.trainer.state().model))?;
        }
        Ok(())
    }
}

/// Observers of a training: log, progress, pace.
struct Watch {
    log: MetricsLog,
    progress: Progress,
    pace: Pace,
    /// Steps done at the last line.
    logged: usize,
    total: usize,
}

impl Watch {
    /// Reads the losses of a step, which waits for the device, and logs them.
    fn log_step(&mut self, trainer: &Trainer, position: &Position, loss: &Losses) -> anyhow::Result<()> {
        let (loss, squared_error) = read(loss)?;
        let state = trainer.state();
        let done = state.completed;
        self.pace.mark(done);
        let line = MetricsLine {
            step: done,
            stage: position.stage.name(),
            stage_step: position.stage_step,
            loss,
            psnr: (squared_error > 0.0).then(|| -10.0 * f64::from(squared_error).log10()),
            gaussians: GaussianCounts::of(&state.model),
            steps_per_second: self.pace.steps_per_second(),
            elapsed: self.pace.elapsed(),
            ms: milliseconds(done - self.logged),
        };
        self.logged = done;
        self.log.add(&line)?;
        self.progress.say(self.sentence(&line));
        Ok(())
    }

    /// The progress line. Parts that a narrow terminal may cut off come last.
    fn sentence(&self, line: &MetricsLine) -> String {
        let psnr = line.psnr.map_or("-".to_owned(), |psnr| format!("{psnr:.2}"));
        format!(
            "{}  {:.1} step/s  {}  loss {:.4}  PSNR {psnr} dB  {}",
            line.stage,
            line.steps_per_second,
            self.pace.left(self.total - line.step),
            line.loss,
            line.gaussians.sentence(" + "),
        )
    }
}

/// Loss and squared error of a step. Waits for the device.
fn read(loss: &Losses) -> Result<(f32, f32), ModelError> {
    let total = loss.total.clone().try_into_scalar::<f32>();
    let squared_error = loss.squared_error.clone().try_into_scalar::<f32>();
    let failed = |error: &dyn std::fmt::Display| ModelError::Device(error.to_string());
    Ok((total.map_err(|error| failed(&error))?, squared_error.map_err(|error| failed(&error))?))
}
