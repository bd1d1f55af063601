//! What the motion-aware modules contribute: the figures of their outputs, and the metrics without them.

use maud::{Markup, html};
use mvfusion_model::evaluation::{ModuleFigures, RefinementFigures, Replacement};

use super::files::RunFiles;
use super::snippet::{notice, number};
use crate::run::{PsnrChanges, Replacements};

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
                    th scope="col" title="mean share of hidden units that are active" { "active units" }
                    th scope="col" title="share of Gaussians of which no hidden unit is active" { "silent" }
                } }
                tbody {
                    @for (name, figures) in rows {
                        @if let Some(figures) = figures { tr {
                            th scope="row" { (name) }
                            td { (number(figures.norm, 3)) }
                            @for share in shares_of(&figures) { td {
                                @match share {
                                    Some(share) => { (number(1e2 * share, 1)) " %" }
                                    None => { "-" }
                                }
                            } }
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

/// The shares of a row of that table. Earlier versions did not count units.
fn shares_of(figures: &ModuleFigures) -> [Option<f64>; 5] {
    let ModuleFigures { norm: _, constant, over_gaussians, over_time, active, silent } = *figures;
    [Some(constant), Some(over_gaussians), Some(over_time), active, silent]
}

fn replaced(found: &Replacements, files: &RunFiles) -> Markup {
    let is_stale = files.results.as_ref().is_ok_and(|results| results.params_sha256 != found.params_sha256);
    html! {
        @if is_stale {
            p.note { "The parameters have changed since the outputs were replaced." }
        }
        @for changes in found.psnr_changes() { (differences(&changes)) }
    }
}

/// PSNR as trained, and the differences with an output replaced.
fn differences(changes: &PsnrChanges) -> Markup {
    let signed = |change: Option<f64>| change.map_or("\u{2013}".to_owned(), |change| format!("{change:+.2}"));
    html! {
        div.scroll {
            table.scores {
                caption { "PSNR of the " (changes.views) " in dB, and its change if an output is replaced" }
                thead { tr {
                    th scope="col" {}
                    @for layer in &changes.layers { th scope="col" { (layer) } }
                } }
                tbody {
                    tr {
                        th scope="row" { "as trained" }
                        @for psnr in &changes.own { td { @if let Some(psnr) = psnr { (number(*psnr, 2)) } } }
                    }
                    @for (module, replacement, changes) in &changes.changes { tr {
                        th scope="row" title=(meaning(*replacement)) {
                            (module.name().to_uppercase()) " " (replacement.name())
                        }
                        @for change in changes { td { (signed(*change)) } }
                    } }
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
