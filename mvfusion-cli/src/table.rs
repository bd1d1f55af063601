//! The table at the end of a run.

use std::io::{self, Write};

use mvfusion_model::evaluation::{LayerScores, Scores};

use crate::clock::spoken;
use crate::run::Results;

/// Width of the first column.
const LABEL: usize = 16;

/// Writes the figures of a run, a layer a line.
///
/// # Errors
/// If `out` cannot be written to.
pub fn write(results: &Results, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out, "{:LABEL$}{:>10}{:>10}", "held-out views", "PSNR (dB)", "SSIM")?;
    write_layers(&results.test, out)?;
    if let Some(overlap) = results.test.mask_iou {
        writeln!(out, "{:LABEL$}{overlap:>10.3}", "mask IoU")?;
    }
    if let Some(scores) = &results.training_views {
        writeln!(out, "training views")?;
        write_layers(scores, out)?;
    }
    writeln!(out, "{:LABEL$}{}", "Gaussians", results.gaussians.sentence(", "))?;
    let training = results
        .train
        .as_ref()
        .map_or(String::new(), |train| format!("training {} ({} steps), ", spoken(train.seconds), train.steps));
    writeln!(out, "{:LABEL$}{training}evaluation {}", "time", spoken(results.eval.seconds))?;
    let threads = if results.threads == 1 { "thread" } else { "threads" };
    writeln!(out, "{:LABEL$}{}, {} {threads}", "device", results.device, results.threads)
}

fn write_layers(scores: &Scores, out: &mut dyn Write) -> io::Result<()> {
    layers(scores).into_iter().try_for_each(|(label, scores)| {
        writeln!(out, "{label:LABEL$}{:>10}{:>10}", figure(scores.psnr, 2), figure(scores.ssim, 4))
    })
}

fn layers(scores: &Scores) -> Vec<(&'static str, LayerScores)> {
    let mut layers = vec![("composed", scores.composed)];
    layers.extend(scores.static_.map(|scores| ("static", scores)));
    layers.extend(scores.dynamic_region.map(|scores| ("dynamic region", scores)));
    layers
}

fn figure(value: Option<f64>, digits: usize) -> String {
    value.map_or("-".to_owned(), |value| format!("{value:.digits$}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{EvalTime, GaussianCounts, TrainTime};

    #[test]
    fn figures_that_are_not_known_are_dashes_or_absent() {
        let results = Results {
            protocol: String::new(),
            test: Scores {
                composed: LayerScores { psnr: Some(27.345), ssim: Some(0.9), ..Default::default() },
                dynamic_region: Some(LayerScores { psnr: Some(21.0), ..Default::default() }),
                ..Default::default()
            },
            training_views: None,
            gaussians: GaussianCounts { static_: Some(12), dynamic: 3 },
            train: Some(TrainTime { seconds: 171.2, steps: 1400 }),
            eval: EvalTime { seconds: 9.0 },
            params_sha256: String::new(),
            device: "flex".into(),
            threads: 2,
            seed: 0,
        };
        let mut text = Vec::new();
        write(&results, &mut text).expect("written");
        insta::assert_snapshot!(String::from_utf8(text).expect("text"), @"
        held-out views   PSNR (dB)      SSIM
        composed             27.34    0.9000
        dynamic region       21.00         -
        Gaussians       12 static, 3 dynamic
        time            training 2 min 51 s (1400 steps), evaluation 9 s
        device          flex, 2 threads
        ");
    }
}
