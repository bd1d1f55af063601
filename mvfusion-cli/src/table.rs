//! The table at the end of a run.

use std::collections::BTreeMap;
use std::io::{self, Write};

use mvfusion_model::evaluation::{HeldOutPhoto, LayerScores, Metric, Protocol, Scores};

use crate::clock::spoken;
use crate::progress::Verbosity;
use crate::run::{LpipsWeights, RenderSpeed, Results};

/// Minimum width of the first column.
const LABEL: usize = 16;

/// Maximum number of metrics per layer: the first ones of the protocol. More are shown on request.
const FIGURES: usize = 4;

/// Terminal width that a line must fit.
const LINE: usize = 80;

/// The smallest images of the networks, as in `Lpips::distances`.
const LEAST_SIDES: &str = "alex needs 31 pixels per side, vgg 16";

/// Writes the metrics of a run under a protocol, one line per layer: the main ones that fit into a line, or all of them
/// if the user wants to see more.
///
/// # Errors
/// If `out` cannot be written to.
pub fn write(results: &Results, protocol: Protocol, verbosity: Verbosity, out: &mut dyn Write) -> io::Result<()> {
    let label = label_width(results);
    let metrics = match verbosity.all_metrics {
        true => known(results, protocol.metrics()).collect(),
        false => main_metrics(results, protocol, label),
    };
    let heads: String =
        metrics.iter().map(|&metric| format!("{:>width$}", head(metric), width = width(metric))).collect();
    writeln!(out, "{:label$}{heads}", "held-out views")?;
    write_layers(&results.test, &metrics, label, out)?;
    if let Some(shown) = results.test.composed_shows {
        writeln!(out, "{:LABEL$}{}", "composed shows", what_photos_show(shown))?;
    }
    write_beside(&results.test, out)?;
    write_flicker(results, out)?;
    write_absent(results, out)?;
    if let Some(scores) = &results.training_views {
        writeln!(out, "training views")?;
        write_layers(scores, &metrics, label, out)?;
        write_beside(scores, out)?;
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

/// What the composed render of a held-out photo shows, in words.
pub(crate) fn what_photos_show(shown: HeldOutPhoto) -> &'static str {
    match shown {
        HeldOutPhoto::StaticBranch => "the static branch, because held-out photos have no trained time",
        HeldOutPhoto::AllBranches => "the held-out photos' own times, which were not trained",
    }
}

/// Those of the metrics that any layer has.
fn known(results: &Results, metrics: &'static [Metric]) -> impl Iterator<Item = Metric> {
    let is_known = |metric: &Metric| results.test.layers().any(|(_, scores)| metric.of(scores).is_some());
    metrics.iter().copied().filter(is_known)
}

/// The first main metrics of the protocol that any layer has, as many as fit into a line.
fn main_metrics(results: &Results, protocol: Protocol, label: usize) -> Vec<Metric> {
    let mut room = LINE.saturating_sub(label);
    let fits = |metric: &Metric| {
        let left = room.checked_sub(width(*metric));
        room = left.unwrap_or(0);
        left.is_some()
    };
    known(results, protocol.main_metrics()).take(FIGURES).take_while(fits).collect()
}

/// Width of the first column. The name of a region includes the source of its masks.
fn label_width(results: &Results) -> usize {
    let sets = std::iter::once(&results.test).chain(&results.training_views);
    let labels = sets.flat_map(|set| set.layers().map(|(layer, _)| set.label(layer).len() + 1));
    labels.max().unwrap_or(0).max(LABEL)
}

fn head(metric: Metric) -> String {
    match metric.unit() {
        Some(unit) => format!("{} ({unit})", metric.label()),
        None => metric.label().to_owned(),
    }
}

fn width(metric: Metric) -> usize {
    (head(metric).len() + 2).max(10)
}

fn write_layers(scores: &Scores, metrics: &[Metric], label: usize, out: &mut dyn Write) -> io::Result<()> {
    scores.layers().try_for_each(|(layer, metrics_of_layer)| {
        let cells: String = metrics.iter().map(|&metric| cell(metric, metrics_of_layer)).collect();
        writeln!(out, "{:label$}{cells}", scores.label(layer))
    })
}

/// The metrics that do not belong to a layer.
fn write_beside(scores: &Scores, out: &mut dyn Write) -> io::Result<()> {
    if let Some(difference) = scores.dynamic_minus_still_psnr {
        writeln!(out, "{:LABEL$}{difference:>+10.2} dB", "dynamic - still")?;
    }
    if let Some(overlap) = scores.mask_iou {
        writeln!(out, "{:LABEL$}{overlap:>10.3}", "mask IoU")?;
    }
    if let Some(small) = scores.small_movers {
        writeln!(out, "{:LABEL$}{:>10.3} recall, {} components", "small movers", small.recall, small.components)?;
    }
    Ok(())
}

fn cell(metric: Metric, scores: &LayerScores) -> String {
    let digits = metric.decimals();
    let value = metric.of(scores).map_or("-".to_owned(), |value| format!("{value:.digits$}"));
    format!("{value:>width$}", width = width(metric))
}

/// T-LPIPS, and the mean LPIPS of consecutive renders, which also contains the motion.
fn write_flicker(results: &Results, out: &mut dyn Write) -> io::Result<()> {
    let Some(temporal) = results.test.temporal else { return Ok(()) };
    for (label, alex, vgg) in [
        ("T-LPIPS", temporal.t_lpips_alex, temporal.t_lpips_vgg),
        ("consecutive LPIPS", temporal.consecutive_lpips_alex, temporal.consecutive_lpips_vgg),
    ] {
        let known = [("alex", alex), ("vgg", vgg)];
        let metrics = known.into_iter().filter_map(|(network, metric)| Some(format!("{:.4} ({network})", metric?)));
        let metrics: Vec<String> = metrics.collect();
        if !metrics.is_empty() {
            writeln!(out, "{:LABEL$}{}", format!("{label} "), metrics.join(", "))?;
        }
    }
    Ok(())
}

/// Lists the networks without metrics, and why they are missing.
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
        writeln!(out, "{:LABEL$}absent ({}): {reason}; see `mvfusion lpips-weights`", "LPIPS", networks.join(", "))
    })?;
    let silent = silent_networks(results).join(", ");
    match silent.is_empty() {
        true => Ok(()),
        false => writeln!(out, "{:LABEL$}absent ({silent}): the images are too small; {LEAST_SIDES}", "LPIPS"),
    }
}

/// The networks that have weights and no metric of any view. The only other reason is that the images are too small.
fn silent_networks(results: &Results) -> Vec<&str> {
    let known: Vec<Metric> = known(results, &Metric::ALL).collect();
    let is_silent = |network: &str| {
        !known.iter().any(|metric| matches!(metric, Metric::Lpips(variant) if variant.backbone.name() == network))
    };
    let there = results.lpips.iter().filter(|(_, weights)| matches!(weights, LpipsWeights::WeightsSha256(_)));
    // Without any metric, there is no view.
    there.map(|(network, _)| network.as_str()).filter(|network| !known.is_empty() && is_silent(network)).collect()
}

fn speed_sentence(speed: &RenderSpeed) -> String {
    let without = speed.fps_without_mfta.map_or(String::new(), |fps| format!(", {fps:.1} without MFTA"));
    format!("{:.1} FPS{without}, at {}x{} over {} frames", speed.fps, speed.width, speed.height, speed.frames)
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::{RegionSource, SmallMoversRecall, TemporalScores};

    use super::*;
    use crate::run::specimen;

    fn table(results: &Results, protocol: Protocol) -> String {
        seen(results, protocol, Verbosity::NORMAL)
    }

    fn seen(results: &Results, protocol: Protocol, verbosity: Verbosity) -> String {
        let mut text = Vec::new();
        write(results, protocol, verbosity, &mut text).expect("written");
        String::from_utf8(text).expect("text")
    }

    #[test]
    fn variants_of_a_metric_are_shown_on_request() {
        let composed = LayerScores {
            psnr: Some(27.0),
            psnr_exact: Some(27.01),
            ssim: Some(0.9),
            ssim_valid: Some(0.91),
            lpips_alex: Some(0.125),
            lpips_alex_raw: Some(0.25),
            ..Default::default()
        };
        let results = specimen(Scores { composed, ..Default::default() });
        let head = |verbosity| {
            let table = seen(&results, Protocol::Mvfusion, verbosity);
            table.lines().next().expect("a line").split_whitespace().skip(2).collect::<Vec<_>>().join(" ")
        };
        assert_eq!(head(Verbosity::NORMAL), "PSNR (dB) SSIM LPIPS-alex");
        assert_eq!(
            head(Verbosity { all_metrics: true, ..Verbosity::NORMAL }),
            "PSNR (dB) SSIM LPIPS-alex PSNR unrounded (dB) SSIM without border LPIPS-alex on [0,1]"
        );
    }

    #[test]
    fn metrics_that_are_not_known_are_dashes_or_absent() {
        let results = specimen(Scores {
            composed: LayerScores { psnr: Some(27.345), ssim: Some(0.9), ..Default::default() },
            composed_shows: Some(HeldOutPhoto::StaticBranch),
            dynamic_region: Some(LayerScores { psnr: Some(21.0), ..Default::default() }),
            ..Default::default()
        });
        insta::assert_snapshot!(table(&results, Protocol::Mvfusion), @"
        held-out views    PSNR (dB)      SSIM
        composed              27.34    0.9000
        dynamic region        21.00         -
        composed shows  the static branch, because held-out photos have no trained time
        LPIPS           absent (alex, vgg): no folder of weights was given; see `mvfusion lpips-weights`
        Gaussians       12 static, 3 dynamic
        time            training 2 min 51 s (1400 steps), evaluation 9 s
        device          flex, 2 threads
        ");
    }

    #[test]
    fn images_that_are_too_small_for_a_network_are_told() {
        let weights = || LpipsWeights::WeightsSha256("0".into());
        let lpips = BTreeMap::from([("alex".into(), weights()), ("vgg".into(), weights())]);
        let composed = LayerScores { psnr: Some(27.0), lpips_vgg: Some(0.125), ..Default::default() };
        let temporal = TemporalScores { consecutive_lpips_vgg: Some(0.25), ..Default::default() };
        let scores = Scores { composed, temporal: Some(temporal), ..Default::default() };
        let shown = table(&Results { lpips: lpips.clone(), ..specimen(scores) }, Protocol::Mvfusion);
        let words = "absent (alex): the images are too small; alex needs 31 pixels per side, vgg 16\n";
        assert!(shown.contains(words), "{shown}");
        assert!(shown.contains("consecutive LPIPS 0.2500 (vgg)\n"), "{shown}");
        let shown = table(&Results { lpips, ..specimen(Scores::default()) }, Protocol::Mvfusion);
        assert!(!shown.contains("absent"), "without views, nothing is too small: {shown}");
    }

    #[test]
    fn regions_name_their_masks_and_movers_have_a_row() {
        let layer = |psnr| LayerScores { psnr: Some(psnr), ssim: Some(0.5), ..Default::default() };
        let results = specimen(Scores {
            composed: layer(27.345),
            dynamic_region: Some(layer(21.0)),
            still_region: Some(layer(30.5)),
            region_source: Some(RegionSource::TrueMasks),
            dynamic_minus_still_psnr: Some(-9.5),
            movers: Some(layer(17.25)),
            small_movers: Some(SmallMoversRecall { recall: 0.625, components: 12 }),
            mask_iou: Some(0.75),
            ..Default::default()
        });
        let table = table(&results, Protocol::Mvfusion);
        let metrics = table.split("LPIPS ").next().expect("metrics");
        insta::assert_snapshot!(metrics, @"
        held-out views                PSNR (dB)      SSIM
        composed                          27.34    0.5000
        dynamic region (true masks)       21.00    0.5000
        still region (true masks)         30.50    0.5000
        movers (true masks)               17.25    0.5000
        dynamic - still      -9.50 dB
        mask IoU             0.750
        small movers         0.625 recall, 12 components
        ");
    }

    #[test]
    fn a_protocol_shows_its_own_columns_as_far_as_a_line_goes() {
        let composed = LayerScores {
            psnr: Some(27.0),
            psnr_exact: Some(27.01),
            ssim_valid: Some(0.91),
            lpips_alex: Some(0.125),
            lpips_alex_raw: Some(0.25),
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
        held-out views    PSNR (dB)  SSIM without border  LPIPS-alex
        composed              27.00               0.9100      0.1250
        T-LPIPS         0.0125 (alex)
        Gaussians       12 static, 3 dynamic
        time            training 2 min 51 s (1400 steps), evaluation 9 s
        speed           62.7 FPS, 71.0 without MFTA, at 8x6 over 300 frames
        device          flex, 2 threads
        ");
    }
}
