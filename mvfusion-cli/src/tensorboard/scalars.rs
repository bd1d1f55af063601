//! The names of a run's curves in TensorBoard. It makes a group of all names with the same part before the slash.

use mvfusion_model::train::optim::{GaussianRates, Rates};

use super::file::Value;
use crate::run::{MetricsLine, Results};

/// The values of a log step: those of `metrics.jsonl`, and the learning rates that decay.
pub fn of_step(line: &MetricsLine, rates: &Rates) -> Vec<Value> {
    let mut values = vec![Value::scalar("train/loss", f64::from(line.loss))];
    values.extend(line.psnr.map(|psnr| Value::scalar("train/psnr", psnr)));
    values.push(Value::scalar("train/steps_per_second", line.steps_per_second));
    values.push(Value::scalar("train/skipped_steps", line.skipped as f64));
    values.extend(line.gaussians.static_.map(|count| Value::scalar("gaussians/static", count as f64)));
    values.push(Value::scalar("gaussians/dynamic", line.gaussians.dynamic as f64));
    let has_static = line.gaussians.static_.is_some();
    let branches = [("dynamic", Some(&rates.dynamic)), ("static", has_static.then_some(&rates.static_))];
    for (branch, GaussianRates { means, sh_rest, mask_logits, .. }) in
        branches.into_iter().filter_map(|(name, rates)| Some((name, rates?)))
    {
        values.push(Value::scalar(format!("rates/{branch}.means"), *means));
        values.push(Value::scalar(format!("rates/{branch}.sh_rest"), *sh_rest));
        if branch == "dynamic" && has_static {
            values.push(Value::scalar("rates/dynamic.mask_logits", *mask_logits));
        }
    }
    let Rates { deformation, mask_heads, grid, motion, exposure, .. } = *rates;
    for (name, rate) in [("deformation", deformation), ("grid", grid), ("motion", motion), ("exposure", exposure)] {
        values.push(Value::scalar(format!("rates/{name}"), rate));
    }
    if has_static {
        values.push(Value::scalar("rates/mask_heads", mask_heads));
    }
    values
}

/// The metrics of a trained model, by their names in `results.json`: `test/composed.psnr`.
pub fn of_results(results: &Results) -> Vec<Value> {
    // The numbers of Gaussians have curves.
    let metrics = results.metrics().into_iter().filter(|(name, _)| !name.starts_with("gaussians."));
    metrics.map(|(name, value)| Value::scalar(name.replacen('.', "/", 1), value)).collect()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use mvfusion_model::evaluation::{LayerScores, Scores};

    use super::*;
    use crate::run::{GaussianCounts, specimen};

    fn tags(values: &[Value]) -> BTreeSet<String> {
        let tags: BTreeSet<String> = values.iter().map(|value| value.tag().to_owned()).collect();
        assert_eq!(tags.len(), values.len(), "a name appears twice");
        tags
    }

    #[test]
    fn a_model_with_one_branch_has_no_curves_of_the_other() {
        let line = |static_| MetricsLine {
            step: 4,
            stage: "geometry",
            stage_step: 4,
            loss: 0.5,
            psnr: None,
            gaussians: GaussianCounts { static_, dynamic: 3 },
            skipped: 0,
            steps_per_second: 2.0,
            elapsed: 2.0,
            ms: Default::default(),
        };
        let rates = Rates::at(1, 1.0, &Default::default());
        let both = tags(&of_step(&line(Some(12)), &rates));
        let one = tags(&of_step(&line(None), &rates));
        assert!(one.contains("train/loss") && one.contains("rates/dynamic.means") && !one.contains("train/psnr"));
        let missing: Vec<&str> = both.difference(&one).map(String::as_str).collect();
        assert_eq!(
            missing,
            [
                "gaussians/static",
                "rates/dynamic.mask_logits",
                "rates/mask_heads",
                "rates/static.means",
                "rates/static.sh_rest"
            ]
        );
    }

    #[test]
    fn metrics_are_grouped_by_the_views_that_they_are_of() {
        let composed = LayerScores { psnr: Some(20.0), ..Default::default() };
        let test = Scores { composed, mask_iou: Some(0.5), ..Default::default() };
        let found = tags(&of_results(&specimen(test)));
        assert_eq!(found.into_iter().collect::<Vec<_>>(), ["test/composed.psnr", "test/mask_iou"]);
    }
}
