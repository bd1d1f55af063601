//! `mvfusion view`.

use std::io::Write;
use std::time::Duration;

use anyhow::Context;

use crate::args::ViewArgs;
use crate::interrupt::Signals;
use crate::progress::Verbosity;
use crate::run::{MasksRequest, OpenRun, RunRequest};
use crate::viewer::Viewer;
use crate::viewer::address::BoundSocket;
use crate::viewer::facts::RunFacts;
use crate::viewer::renderer::{FrameRenderer, MotionSource, Shown, unavailable_layers};
use crate::viewer::status::{Activity, Status};

/// Time from one look at the signals to the next, while nobody asks for anything.
const TIMEOUT: Duration = Duration::from_millis(200);

/// Serves the page of a trained run until a signal comes.
///
/// # Errors
/// If the port is taken, the run has no checkpoint, its scene is missing, or the device does not exist.
pub fn view(args: &ViewArgs, verbosity: Verbosity, out: &mut dyn Write) -> anyhow::Result<()> {
    let signals = Signals::watch().context("cannot watch for signals")?;
    // First, because it is quick to fail.
    let socket = BoundSocket::bind(&args.host, args.port)?;
    view_until(args, socket, verbosity, out, || signals.exit_code().is_some())
}

/// The same at a socket that listens already, until `is_over`, which is asked several times a second.
///
/// # Errors
/// As [`view`].
pub fn view_until(
    args: &ViewArgs,
    socket: BoundSocket,
    verbosity: Verbosity,
    out: &mut dyn Write,
    is_over: impl Fn() -> bool,
) -> anyhow::Result<()> {
    let request = RunRequest {
        run: &args.run,
        data: args.data.as_deref(),
        masks: MasksRequest::Unused,
        device: &args.compute.device,
    };
    let run = OpenRun::open(&request, verbosity)?;
    let (context, level, step) = (run.render_context(), run.level(), run.trained.steps);
    let source = MotionSource::Measured(run.config.motion.weights);
    let model = run.trained.model;
    let facts = RunFacts {
        run: &args.run,
        is_training: false,
        has_mfta: model.without_mfta(level).is_some(),
        has_static: model.static_.is_some(),
        background: context.background.grey,
    };
    let lines = socket.lines(false);
    let unavailable = unavailable_layers(&model, level, source);
    let mut renderer = FrameRenderer::new(context, run.scene.clone(), source);
    renderer.show(step, || Shown { model, level, step });
    let status = Status {
        activity: Activity::Shows,
        step,
        total: run.config.train.stages.total(),
        stage: None,
        steps_per_second: None,
        unavailable,
        saved: None,
    };
    let viewer = Viewer::start(socket, &run.scene, &facts, status)?;
    for (name, line) in lines {
        writeln!(out, "{name:16}{line}")?;
    }
    out.flush()?;
    verbosity.note("Open the address in a browser. Ctrl-C ends the viewer.");
    while !is_over() {
        viewer.serve_next(&mut renderer, TIMEOUT);
        // Nothing trains here, so commands are dropped.
        viewer.requests.take_commands();
    }
    Ok(())
}
