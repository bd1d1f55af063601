//! `replacements.json`: the metrics of a run with replaced outputs of its motion-aware modules.

use mvfusion_model::evaluation::{HeldOutPhoto, Metric, Replacement, Scores};
use mvfusion_model::model::motion::MotionModule;
use serde::{Deserialize, Serialize};

/// `replacements.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Replacements {
    /// SHA-256 of all learned parameters.
    pub params_sha256: String,
    /// Metrics of the held-out views, with the modules' own outputs.
    pub test: Scores,
    /// The same of the training views, if `eval.training_views` is set or the held-out ones show the static branch.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub training_views: Option<Scores>,
    /// The metrics with one output replaced.
    pub replaced: Vec<Replaced>,
}

/// Metrics with the output of one module replaced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Replaced {
    /// The module.
    pub module: MotionModule,
    /// What replaces its output.
    pub replacement: Replacement,
    /// Metrics of the held-out views.
    pub test: Scores,
    /// The same of the training views.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub training_views: Option<Scores>,
}

/// PSNR of the layers of a set of views, and how it changes with replaced outputs. Unknown values are `None`.
#[derive(Clone, Debug, PartialEq)]
pub struct PsnrChanges {
    /// Name of the set of views.
    pub views: &'static str,
    /// Labels of the layers.
    pub layers: Vec<String>,
    /// PSNR of each layer with the modules' own outputs, in dB.
    pub own: Vec<Option<f64>>,
    /// For each replacement, the change of PSNR of each layer, in dB.
    pub changes: Vec<(MotionModule, Replacement, Vec<Option<f64>>)>,
}

impl Replacements {
    /// The changes on the held-out views, unless these show the static branch alone, which no module changes; and those on
    /// the training views if they were evaluated.
    pub fn psnr_changes(&self) -> Vec<PsnrChanges> {
        let shows_modules = self.test.composed_shows != Some(HeldOutPhoto::StaticBranch);
        let test = shows_modules
            .then(|| PsnrChanges::of("held-out views", &self.test, &self.replaced, |replaced| Some(&replaced.test)));
        let training = self.training_views.as_ref().map(|own| {
            PsnrChanges::of("training views", own, &self.replaced, |replaced| replaced.training_views.as_ref())
        });
        test.into_iter().chain(training).collect()
    }
}

impl PsnrChanges {
    fn of(
        views: &'static str,
        own: &Scores,
        replaced: &[Replaced],
        scores: impl Fn(&Replaced) -> Option<&Scores>,
    ) -> Self {
        let psnr = |scores: &Scores, name: &str| {
            let layer = scores.layers().find(|(layer, _)| *layer == name);
            layer.and_then(|(_, scores)| Metric::Psnr.of(scores))
        };
        let names: Vec<&'static str> = own.layers().map(|(layer, _)| layer).collect();
        let change = |scores: &Scores, name: &str| Some(psnr(scores, name)? - psnr(own, name)?);
        let row = |replaced: &Replaced| {
            let scores = scores(replaced)?;
            let changes = names.iter().map(|name| change(scores, name)).collect();
            Some((replaced.module, replaced.replacement, changes))
        };
        Self {
            views,
            layers: names.iter().map(|layer| own.label(layer)).collect(),
            own: names.iter().map(|layer| psnr(own, layer)).collect(),
            changes: replaced.iter().filter_map(row).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_model::evaluation::LayerScores;

    use super::*;

    #[test]
    fn changes_are_those_of_each_layer_and_unknown_where_one_side_is() {
        let layer = |psnr| LayerScores { psnr, ..LayerScores::default() };
        let scores = |composed, static_| Scores {
            composed: layer(Some(composed)),
            static_: Some(layer(static_)),
            ..Scores::default()
        };
        let (module, replacement) = (MotionModule::Mvg, Replacement::Mean);
        let replaced = Replaced { module, replacement, test: scores(29.5, None), training_views: None };
        let found = Replacements {
            params_sha256: String::new(),
            test: scores(30.0, Some(20.0)),
            training_views: None,
            replaced: vec![replaced],
        };
        let [changes] = &found.psnr_changes()[..] else { panic!("the held-out views alone") };
        assert_eq!(
            (&changes.layers[..], &changes.own[..]),
            (&["composed".into(), "static".into()][..], &[Some(30.0), Some(20.0)][..])
        );
        assert_eq!(changes.changes, [(module, replacement, vec![Some(-0.5), None])]);
        let of_photos = Scores { composed_shows: Some(HeldOutPhoto::StaticBranch), ..found.test };
        let found = Replacements { training_views: Some(found.test), test: of_photos, ..found };
        let shown: Vec<&str> = found.psnr_changes().iter().map(|changes| changes.views).collect();
        assert_eq!(shown, ["training views"]);
    }
}
