//! What the motion-aware modules contribute: the figures of their outputs, and the metrics without them.

use maud::{Markup, html};
use mvfusion_model::evaluation::{Metric, ModuleFigures, RefinementFigures, Replacement, Scores};

use super::files::RunFiles;
use super::snippet::{notice, number};
use crate::run::{Replaced, Replacements};

/// The section.
pub(super) fn modules(files: &RunFiles) -> Markup {
    let figures = files.results.as_ref().map(|results| results.refinement);
    html! {
        @match figures {
            Ok(Some(figures)) => (of_outputs(&figures)),
            Ok(None) => p.note {
                "The model has no motion-aware module, or the run\u{2019}s version did not measure it."
            },
            Err(missing) => (notice(missing)),
        }
        @match &files.replacements {
            Some(Ok(replacements)) => (replaced(replacements, files)),
            Some(Err(missing)) => (notice(missing)),
            None if figures.is_ok_and(|figures| figures.is_some()) => p.note {
                code { "mvfusion eval RUN --replace all --write" }
                " measures what the outputs are worth, without training."
            },
            None => {},
        }
    }
}

fn of_outputs(figures: &RefinementFigures) -> Markup {
    let rows = [("MVG", figures.mvg), ("MFTA", figures.mfta)];
    html! {
        div.scroll {
            table.scores {
                caption { "Outputs of the modules at the training times" }
                thead { tr {
                    th scope="col" {}
                    th scope="col" title="root mean square of the output over that of the base feature" { "norm" }
                    th scope="col" title="share of the mean square in the mean over everything" { "constant" }
                    th scope="col" title="share in the differences between Gaussians" { "over Gaussians" }
                    th scope="col" title="share in the changes over time" { "over time" }
                } }
                tbody {
                    @for (name, figures) in rows {
                        @if let Some(ModuleFigures { norm, constant, over_gaussians, over_time }) = figures { tr {
                            th scope="row" { (name) }
                            td { (number(norm, 3)) }
                            @for share in [constant, over_gaussians, over_time] { td { (number(1e2 * share, 1)) " %" } }
                        } }
                    }
                }
            }
        }
        @if let Some(attention) = figures.attention {
            p.note {
                "The entropy of MFTA\u{2019}s attention is " (number(attention.entropy, 3)) " of "
                (number(attention.uniform_entropy, 3)) " nats, that of uniform weights."
            }
        }
    }
}

fn replaced(found: &Replacements, files: &RunFiles) -> Markup {
    let is_stale = files.results.as_ref().is_ok_and(|results| results.params_sha256 != found.params_sha256);
    let training = found.training_views.as_ref().map(|own| {
        let of = |replaced: &Replaced| replaced.training_views;
        differences("Training views", own, found, of)
    });
    html! {
        @if is_stale {
            p.note { "The parameters have changed since the outputs were replaced." }
        }
        (differences("Held-out views", &found.test, found, |replaced| Some(replaced.test)))
        @if let Some(training) = training { (training) }
    }
}

/// PSNR as trained, and the differences with an output replaced.
fn differences(caption: &str, own: &Scores, found: &Replacements, of: impl Fn(&Replaced) -> Option<Scores>) -> Markup {
    let layers: Vec<(&str, Option<f64>)> =
        own.layers().map(|(layer, scores)| (layer, Metric::Psnr.of(scores))).collect();
    let change = |scores: &Scores, name: &str, before: Option<f64>| {
        let now = scores.layers().find(|(layer, _)| *layer == name).and_then(|(_, scores)| Metric::Psnr.of(scores));
        now.zip(before).map_or("\u{2013}".to_owned(), |(now, before)| format!("{:+.2}", now - before))
    };
    html! {
        div.scroll {
            table.scores {
                caption { (caption) ": PSNR in dB, and its change if an output is replaced" }
                thead { tr {
                    th scope="col" {}
                    @for (layer, _) in &layers { th scope="col" { (own.label(layer)) } }
                } }
                tbody {
                    tr {
                        th scope="row" { "as trained" }
                        @for (_, psnr) in &layers { td { @if let Some(psnr) = psnr { (number(*psnr, 2)) } } }
                    }
                    @for replaced in &found.replaced {
                        @if let Some(scores) = of(replaced) { tr {
                            th scope="row" title=(meaning(replaced.replacement)) {
                                (replaced.module.name().to_uppercase()) " " (replaced.replacement.name())
                            }
                            @for (layer, psnr) in &layers { td { (change(&scores, layer, *psnr)) } }
                        } }
                    }
                }
            }
        }
    }
}

fn meaning(replacement: Replacement) -> &'static str {
    match replacement {
        Replacement::Constant => "the mean over all Gaussians and times",
        Replacement::Mean => "the mean of each Gaussian over time",
        Replacement::Shuffled => "the output of another Gaussian at the same time",
    }
}
