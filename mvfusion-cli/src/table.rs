//! The table at the end of a run.

use std::collections::BTreeMap;
use std::io::{self, Write};

use mvfusion_model::evaluation::{Column, Figure, LayerScores, Protocol, Scores};

use crate::clock::spoken;
use crate::run::{LpipsWeights, RenderSpeed, Results};

/// Width of the first column.
const LABEL: usize = 16;

/// Figures of a layer that are shown at most: the first ones of the protocol, so that a line fits a terminal.
const FIGURES: usize = 4;

/// Writes the figures of a run by a protocol, a layer a line.
///
/// # Errors
/// If `out` cannot be written to.
pub fn write(results: &Results, protocol: Protocol, out: &mut dyn Write) -> io::Result<()> {
    let columns = columns(results, protocol);
    let heads: String =
        columns.iter().map(|column| format!("{:>width$}", head(column), width = width(column))).collect();
    writeln!(out, "{:LABEL$}{heads}", "held-out views")?;
    write_layers(&results.test, &columns, out)?;
    if let Some(overlap) = results.test.mask_iou {
        writeln!(out, "{:LABEL$}{overlap:>10.3}", "mask IoU")?;
    }
    write_flicker(results, out)?;
    write_absent(results, out)?;
    if let Some(scores) = &results.training_views {
        writeln!(out, "training views")?;
        write_layers(scores, &columns, out)?;
    }
    writeln!(out, "{:LABEL$}{}", "Gaussians", results.gaussians.sentence(", "))?;
    let training = results
        .train
        .as_ref()
        .map_or(String::new(), |train| format!("training {} ({} steps), ", spoken(train.seconds), train.steps));
    writeln!(out, "{:LABEL$}{training}evaluation {}", "time", spoken(results.eval.seconds))?;
    if let Some(speed) = &results.speed {
        writeln!(out, "{:LABEL$}{}", "speed", speed_sentence(speed))?;
    }
    let threads = if results.threads == 1 { "thread" } else { "threads" };
    writeln!(out, "{:LABEL$}{}, {} {threads}", "device", results.device, results.threads)
}

/// The first of the protocol's figures that any layer has.
fn columns(results: &Results, protocol: Protocol) -> Vec<Column> {
    let is_known = |column: &Column| results.test.layers().any(|(_, scores)| column.figure.of(scores).is_some());
    protocol.columns().iter().filter(|column| is_known(column)).take(FIGURES).copied().collect()
}

fn head(column: &Column) -> String {
    match column.figure {
        Figure::Psnr | Figure::PsnrExact => format!("{} (dB)", column.label),
        _ => column.label.to_owned(),
    }
}

fn width(column: &Column) -> usize {
    (head(column).len() + 2).max(10)
}

fn write_layers(scores: &Scores, columns: &[Column], out: &mut dyn Write) -> io::Result<()> {
    scores.layers().try_for_each(|(layer, scores)| {
        let figures: String = columns.iter().map(|column| cell(column, scores)).collect();
        writeln!(out, "{:LABEL$}{figures}", layer.replace('_', " "))
    })
}

fn cell(column: &Column, scores: &LayerScores) -> String {
    let digits = match column.figure {
        Figure::Psnr | Figure::PsnrExact => 2,
        _ => 4,
    };
    let figure = column.figure.of(scores).map_or("-".to_owned(), |value| format!("{value:.digits$}"));
    format!("{figure:>width$}", width = width(column))
}

/// T-LPIPS, and the mean LPIPS of consecutive pictures, of which motion is a part.
fn write_flicker(results: &Results, out: &mut dyn Write) -> io::Result<()> {
    let Some(temporal) = results.test.temporal else { return Ok(()) };
    for (label, alex, vgg) in [
        ("T-LPIPS", temporal.t_lpips_alex, temporal.t_lpips_vgg),
        ("plain mean", temporal.consecutive_lpips_alex, temporal.consecutive_lpips_vgg),
    ] {
        let known = [("alex", alex), ("vgg", vgg)];
        let figures = known.into_iter().filter_map(|(network, figure)| Some(format!("{:.4} ({network})", figure?)));
        let figures: Vec<String> = figures.collect();
        if !figures.is_empty() {
            writeln!(out, "{label:LABEL$}{}", figures.join(", "))?;
        }
    }
    Ok(())
}

/// Says which networks gave no figures and why.
fn write_absent(results: &Results, out: &mut dyn Write) -> io::Result<()> {
    let absent = results.lpips.iter().filter_map(|(network, weights)| match weights {
        LpipsWeights::Absent(reason) => Some((network, reason)),
        LpipsWeights::WeightsSha256(_) => None,
    });
    let mut by_reason: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (network, reason) in absent {
        by_reason.entry(reason).or_default().push(network);
    }
    by_reason.into_iter().try_for_each(|(reason, networks)| {
        writeln!(out, "{:LABEL$}absent ({}): {reason}; see --lpips-weights", "LPIPS", networks.join(", "))
    })
}

fn speed_sentence(speed: &RenderSpeed) -> String {
    let without = speed.fps_without_mfta.map_or(String::new(), |fps| format!(", {fps:.1} without MFTA"));
    format!(
        "{:.1} frames a second{without}, of {}x{} pixels, over {} frames",
        speed.fps, speed.width, speed.height, speed.frames
    )
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::TemporalScores;

    use super::*;
    use crate::run::specimen;

    fn table(results: &Results, protocol: Protocol) -> String {
        let mut text = Vec::new();
        write(results, protocol, &mut text).expect("written");
        String::from_utf8(text).expect("text")
    }

    #[test]
    fn figures_that_are_not_known_are_dashes_or_absent() {
        let results = specimen(Scores {
            composed: LayerScores { psnr: Some(27.345), ssim: Some(0.9), ..Default::default() },
            dynamic_region: Some(LayerScores { psnr: Some(21.0), ..Default::default() }),
            ..Default::default()
        });
        insta::assert_snapshot!(table(&results, Protocol::Mvfusion), @"
        held-out views    PSNR (dB)      SSIM
        composed              27.34    0.9000
        dynamic region        21.00         -
        LPIPS           absent (alex, vgg): no folder of weights was given; see --lpips-weights
        Gaussians       12 static, 3 dynamic
        time            training 2 min 51 s (1400 steps), evaluation 9 s
        device          flex, 2 threads
        ");
    }

    #[test]
    fn a_protocol_shows_its_own_columns() {
        let composed = LayerScores {
            psnr: Some(27.0),
            psnr_exact: Some(27.01),
            ssim_valid: Some(0.91),
            lpips_alex: Some(0.125),
            ..Default::default()
        };
        let temporal = TemporalScores { t_lpips_alex: Some(0.0125), ..Default::default() };
        let speed =
            RenderSpeed { width: 8, height: 6, warm_up: 20, frames: 300, fps: 62.7, fps_without_mfta: Some(71.0) };
        let results = Results {
            speed: Some(speed),
            lpips: BTreeMap::from([("alex".into(), LpipsWeights::WeightsSha256("0".into()))]),
            ..specimen(Scores { composed, temporal: Some(temporal), ..Default::default() })
        };
        insta::assert_snapshot!(table(&results, Protocol::DeGauss), @"
        held-out views    PSNR (dB)      SSIM  LPIPS-alex normalized
        composed              27.00    0.9100                 0.1250
        T-LPIPS         0.0125 (alex)
        Gaussians       12 static, 3 dynamic
        time            training 2 min 51 s (1400 steps), evaluation 9 s
        speed           62.7 frames a second, 71.0 without MFTA, of 8x6 pixels, over 300 frames
        device          flex, 2 threads
        ");
    }
}
