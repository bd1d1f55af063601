//! `mvfusion render`.

use std::io::Write;

use mvfusion_model::evaluation::{Layer, LayerRenderer};
use mvfusion_model::timeline::spread;

use crate::args::RenderArgs;
use crate::memory::{self, MemoryRule};
use crate::progress::{Pace, Progress, Verbosity};
use crate::render::{FileFormat, Film, OutputsPlan, Reframing, Selection, chosen_layers};
use crate::run::{self, FolderLock, MasksRequest, OpenRun, RunRequest};

/// Number of frames whose depths determine the common scale of all depth images.
const DEPTH_FRAMES: usize = 8;

/// Renders a trained run in layers.
///
/// # Errors
/// If the run has no checkpoint, its scene is missing, a camera path cannot be used, the model lacks a layer, files
/// would be overwritten, the device fails, or a file cannot be written.
pub fn render(args: &RenderArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let request = RunRequest {
        run: &args.run,
        data: args.data.as_deref(),
        masks: MasksRequest::Unused,
        device: &args.compute.device,
    };
    let run = OpenRun::open(&request, verbosity)?;
    let (level, context) = (run.level(), run.render_context());
    let model = args.crop.crop(run.model(args.no_mfta, verbosity), level, &context, verbosity)?;
    let OpenRun { config, scene, device, .. } = run;
    let film = args.views.film(&scene, &selection(args))?;
    let is_clean = film.is_clean && model.static_.is_some();
    let film = Film { fps: args.fps.unwrap_or(film.fps), is_clean, ..film };
    let layers = chosen_layers(&args.layers, &model, level);
    let largest = film.frames.iter().map(|frame| (frame.camera.width, frame.camera.height));
    let largest = largest.max_by_key(|(width, height)| width * height).unwrap_or_default();
    let rule = MemoryRule::of_flag(args.force_memory);
    memory::check_rendering(&model, &config, largest, layers.len(), &device, rule)?;
    let folder = args.out.clone().unwrap_or_else(|| args.run.join(run::FILMS).join(args.views.name()));
    let _lock = FolderLock::take(&folder)?;
    let plan = OutputsPlan::new(&folder, &layers, &FileFormat::choose(&args.format, film.frames.len(), verbosity)?);
    match args.force {
        false => plan.check_free()?,
        true if args.out.is_some() => plan.check_own()?,
        // Within the run, all renders are ours.
        true => {}
    }
    // Created last, because it may measure trajectories, which takes time.
    let weights = args.motion_weights.unwrap_or(config.motion.weights);
    let renderer = LayerRenderer::new(&model, level, &context, &layers, weights)?;
    let renderer = if plan.has_pictures() { with_depths(renderer, &film)? } else { renderer };
    let plan = write(&film, &renderer, plan, verbosity)?;
    verbosity.wrote("frames", &folder);
    tell(&film, &layers, &plan, out)
}

/// The frames that the command line selects.
fn selection(args: &RenderArgs) -> Selection {
    let reframing = match (args.size, args.downscale) {
        (Some((width, height)), _) => Reframing::Size(width, height),
        (None, Some(times)) => Reframing::Downscale(times),
        (None, None) => Reframing::AsItIs,
    };
    Selection { frames: args.frames, time: args.time, camera: args.camera.clone(), reframing }
}

/// The renderer with a common depth scale for all frames.
fn with_depths<'a>(renderer: LayerRenderer<'a>, film: &Film) -> anyhow::Result<LayerRenderer<'a>> {
    if !renderer.layers().contains(&Layer::Depth) {
        return Ok(renderer);
    }
    let chosen = spread(film.frames.len(), DEPTH_FRAMES);
    let frames = chosen.into_iter().map(|index| (film.frames[index].camera, film.moment(index)));
    Ok(renderer.with_depths_of(frames)?)
}

/// Renders all frames in order.
fn write(
    film: &Film,
    renderer: &LayerRenderer<'_>,
    plan: OutputsPlan,
    verbosity: Verbosity,
) -> anyhow::Result<OutputsPlan> {
    let camera = &film.frames[0].camera;
    let mut outputs = plan.create((camera.width, camera.height), film.fps)?;
    let mut progress = Progress::new("rendering", film.frames.len(), verbosity);
    let mut pace = Pace::default();
    for (done, frame) in film.frames.iter().enumerate() {
        let rendered = renderer.render(&frame.camera, film.moment(done))?;
        outputs.add(frame.number, &rendered, renderer)?;
        pace.mark(done + 1);
        progress.say(format!("{:.1} FPS  {}", pace.steps_per_second(), pace.left(film.frames.len() - done - 1)));
        progress.advance();
    }
    let plan = outputs.finish()?;
    progress.finish();
    Ok(plan)
}

/// Prints which files were written, and where.
fn tell(film: &Film, layers: &[Layer], plan: &OutputsPlan, out: &mut dyn Write) -> anyhow::Result<()> {
    let camera = &film.frames[0].camera;
    writeln!(out, "{:16}{} at {}x{}", "frames", film.frames.len(), camera.width, camera.height)?;
    if film.is_clean {
        writeln!(
            out,
            "{:16}the static branch, because held-out photos have no trained time; --time T sets one",
            "shown"
        )?;
    }
    let names: Vec<&str> = layers.iter().map(|layer| layer.name()).collect();
    writeln!(out, "{:16}{}", "layers", names.join(", "))?;
    for (kind, place) in plan.describe() {
        writeln!(out, "{kind:16}{place}")?;
    }
    Ok(())
}
