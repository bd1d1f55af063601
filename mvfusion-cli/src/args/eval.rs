//! The arguments of `mvfusion eval`.

use std::path::PathBuf;

use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use mvfusion_model::evaluation::{Protocol, Replacement};
use mvfusion_model::model::motion::MotionModule;

use super::compute::ComputeArgs;

/// `mvfusion eval`.
#[derive(Clone, Debug, Args)]
#[command(allow_negative_numbers = true)]
pub struct EvalArgs {
    /// Run folder
    #[arg(value_name = "RUN")]
    pub run: PathBuf,
    /// Scene folder, if it has moved since training
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Folder of masks (white = dynamic), if they have moved or were added later; see eval.dynamic_masks
    #[arg(long, value_name = "DIR")]
    pub masks: Option<PathBuf>,
    /// Folder with the LPIPS weights (docs/evaluation.md), if they have moved or training had none; or none
    #[arg(long, value_name = "DIR")]
    pub lpips_weights: Option<PathBuf>,
    /// Evaluation protocol: mvfusion (all metrics), or that of degauss, 3dgs or nerfbaselines
    #[arg(long, value_name = "NAME", default_value = Protocol::default().name(), value_parser = protocols())]
    pub protocol: Protocol,
    /// Frames for measuring the frame rate, with and without MFTA, after 20 warm-up frames; 0 skips the measurement,
    /// which can take minutes for large images on a CPU; --replace measures none
    #[arg(long, value_name = "N", default_value_t = 300)]
    pub speed_frames: usize,
    /// Evaluate with a motion-aware module's output replaced, instead of the run as it is: MODULE=WHAT, or `all`
    ///
    /// MODULE is mvg or mfta. WHAT is constant (the mean over all Gaussians and times), mean (each Gaussian's mean over
    /// time), or shuffled (the output of another Gaussian at the same time). May be given more than once; each one is
    /// evaluated by itself. With --write, the metrics go to replacements.json and the report.
    #[arg(long, value_name = "MODULE=WHAT", value_parser = parse_replacement, conflicts_with = "protocol")]
    pub replace: Vec<ReplacementChoice>,
    /// Device and threads.
    #[command(flatten)]
    pub compute: ComputeArgs,
    /// Write metrics, images and report to the run folder; by default, nothing is written
    #[arg(long)]
    pub write: bool,
    /// Print the metrics as JSON, with the keys of results.json, or with --replace of replacements.json
    #[arg(long)]
    pub json: bool,
}

/// What `--replace` names: one output and what replaces it, or all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReplacementChoice {
    /// Every module with every replacement.
    All,
    /// One of them.
    One(MotionModule, Replacement),
}

/// Parses the name of a protocol.
fn protocols() -> impl TypedValueParser<Value = Protocol> {
    // Proof: the preceding parser accepts nothing else.
    let protocol = |name: String| name.parse::<Protocol>().expect("one of the names");
    PossibleValuesParser::new(Protocol::ALL.map(Protocol::name)).map(protocol)
}

/// Parses a value of `--replace`.
fn parse_replacement(text: &str) -> Result<ReplacementChoice, String> {
    if text == "all" {
        return Ok(ReplacementChoice::All);
    }
    let (module, replacement) =
        text.split_once('=').ok_or("give a module and what replaces its output, such as mvg=constant, or all")?;
    let module = MotionModule::ALL.into_iter().find(|known| known.name() == module);
    let replacement = Replacement::ALL.into_iter().find(|known| known.name() == replacement);
    Ok(ReplacementChoice::One(
        module.ok_or("the modules are mvg and mfta")?,
        replacement.ok_or("the replacements are constant, mean and shuffled")?,
    ))
}
