//! `mvfusion eval --replace`: what the outputs of the motion-aware modules are worth.

use std::io::Write;

use anyhow::bail;
use mvfusion_model::evaluation::{AttentionFigures, ModuleFigures, RefinementFigures, Replacement};
use mvfusion_model::model::motion::MotionModule;
use mvfusion_model::model::{Model, RenderContext};
use mvfusion_model::train::parameter_hash;

use super::json;
use super::score::Scoring;
use crate::args::{EvalArgs, ReplacementChoice};
use crate::progress::Verbosity;
use crate::run::{self, PsnrChanges, Replaced, Replacements};
use crate::{atomic, report};

/// Scores the held-out views with the outputs of modules replaced, one at a time, and prints the differences.
pub(super) fn replace(
    args: &EvalArgs,
    scoring: &Scoring<'_>,
    verbosity: Verbosity,
    out: &mut dyn Write,
) -> anyhow::Result<()> {
    let model = &scoring.trained.model;
    let context = RenderContext::new(scoring.config, scoring.scene);
    let Some(survey) = scoring.survey(model, &context)? else {
        bail!("the model has no motion-aware module, or motion was not measured, so there is no output to replace");
    };
    let mut replacements = Vec::new();
    for (module, replacement) in chosen(&args.replace) {
        match survey.substitutes(module, replacement) {
            Some(substitutes) => replacements.push((module, replacement, substitutes)),
            None => verbosity.note(&format!("note:   the model was trained without {}", module.name())),
        }
    }
    if replacements.is_empty() {
        bail!("the model has none of these modules. Nothing was evaluated");
    }
    let (test, training_views) = scoring.means(model, &context, verbosity)?;
    let params_sha256 = parameter_hash(model)?;
    let mut found = Replacements { params_sha256, test, training_views, replaced: Vec::new() };
    for (module, replacement, substitutes) in replacements {
        let (test, training_views) = scoring.means(&Model { substitutes, ..model.clone() }, &context, verbosity)?;
        found.replaced.push(Replaced { module, replacement, test, training_views });
    }
    if args.write {
        let path = args.run.join(run::REPLACEMENTS);
        atomic::write_json(&path, &found)?;
        verbosity.wrote("replacements", &path);
        verbosity.wrote("report", &report::write(&args.run)?);
    }
    match args.json {
        true => json::print(&found, out),
        false => print(&found, survey.figures(), out),
    }
}

/// The replacements that are asked for, each once.
fn chosen(choices: &[ReplacementChoice]) -> Vec<(MotionModule, Replacement)> {
    let all =
        MotionModule::ALL.into_iter().flat_map(|module| Replacement::ALL.map(|replacement| (module, replacement)));
    let is_chosen = |&(module, replacement): &(MotionModule, Replacement)| {
        choices.contains(&ReplacementChoice::All) || choices.contains(&ReplacementChoice::One(module, replacement))
    };
    all.filter(is_chosen).collect()
}

/// Prints the PSNR of every layer and how it changes, then the figures of the modules.
fn print(found: &Replacements, figures: RefinementFigures, out: &mut dyn Write) -> anyhow::Result<()> {
    for changes in found.psnr_changes() {
        print_changes(&changes, out)?;
    }
    for (name, figures) in [("MVG", figures.mvg), ("MFTA", figures.mfta)] {
        let Some(ModuleFigures { norm, constant, over_gaussians, over_time, active, silent }) = figures else {
            continue;
        };
        let [constant, over_gaussians, over_time] = [constant, over_gaussians, over_time].map(|share| 1e2 * share);
        writeln!(
            out,
            "{name:LABEL$}{norm:.3} of the feature's norm; {constant:.1} % constant, {over_gaussians:.1} % over \
             Gaussians, {over_time:.1} % over time"
        )?;
        if let (Some(active), Some(silent)) = (active, silent) {
            let [active, silent] = [active, silent].map(|share| 1e2 * share);
            writeln!(
                out,
                "{:LABEL$}{active:.1} % of the hidden units are active; {silent:.1} % of the Gaussians have none",
                ""
            )?;
        }
    }
    if let Some(AttentionFigures { entropy, uniform_entropy }) = figures.attention {
        writeln!(out, "{:LABEL$}entropy {entropy:.3} of {uniform_entropy:.3} nats", "attention")?;
    }
    Ok(())
}

/// Width of the first column.
const LABEL: usize = 16;

/// Prints the PSNR of a set of views in dB, and the differences with replaced outputs.
fn print_changes(changes: &PsnrChanges, out: &mut dyn Write) -> anyhow::Result<()> {
    let mut line = |name: &str, cells: Vec<String>| {
        let cells =
            changes.layers.iter().zip(cells).map(|(layer, cell)| format!("  {cell:>width$}", width = layer.len()));
        writeln!(out, "{name:LABEL$}{}", cells.collect::<String>())
    };
    let shown = |value: &Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.2} dB"));
    let signed = |value: &Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:+.2}"));
    line(changes.views, changes.layers.clone())?;
    line("as trained", changes.own.iter().map(shown).collect())?;
    for (module, replacement, changes) in &changes.changes {
        line(&format!("{}={}", module.name(), replacement.name()), changes.iter().map(signed).collect())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_replacement_is_evaluated_once() {
        let constant = ReplacementChoice::One(MotionModule::Mfta, Replacement::Constant);
        assert_eq!(chosen(&[constant, constant]), [(MotionModule::Mfta, Replacement::Constant)]);
        assert_eq!(chosen(&[constant, ReplacementChoice::All]).len(), 6);
    }
}
