//! The metrics that a table can show: names, labels, units, digits, and which way each is better.

use std::sync::LazyLock;

use mvfusion_model::evaluation::{Backbone, Better, Layer, Metric};

/// How the names of metrics of the training views begin.
pub(super) const TRAINING_VIEWS: &str = "training_views.";

/// The branches that `results.json` has metrics of, and what their labels begin with.
const BRANCHES: [(Layer, &str); 2] = [(Layer::Composed, ""), (Layer::Static, "static ")];

/// The regions of the composed render that have metrics of their own.
const REGIONS: [&str; 3] = ["dynamic_region", "still_region", "movers"];

/// Metrics of a set of views beside those of branches and regions.
static OF_VIEWS: LazyLock<[TableMetric; 8]> = LazyLock::new(|| {
    use Better::{Higher, Lower};
    [
        metric("mask_iou", "mask IoU", None, 3, Some(Higher)),
        // A run that gets worse where nothing moves has a higher one, too.
        metric("dynamic_minus_still_psnr", "dynamic - still region PSNR", Some("dB"), 2, None),
        metric("small_movers.recall", "small movers recall", None, 3, Some(Higher)),
        metric("small_movers.components", "small movers components", None, 0, None),
        metric("temporal.t_lpips_alex", "T-LPIPS-alex", None, 4, Some(Lower)),
        metric("temporal.t_lpips_vgg", "T-LPIPS-vgg", None, 4, Some(Lower)),
        // Motion is a part of these, so that neither a high nor a low one is good.
        metric("temporal.consecutive_lpips_alex", "consecutive LPIPS-alex", None, 4, None),
        metric("temporal.consecutive_lpips_vgg", "consecutive LPIPS-vgg", None, 4, None),
    ]
});

/// Metrics of a run beside those of views.
static OF_RUN: LazyLock<[TableMetric; 8]> = LazyLock::new(|| {
    use Better::{Higher, Lower};
    let count = |name, label| TableMetric { is_count: true, ..metric(name, label, None, 0, Some(Lower)) };
    [
        count("gaussians.static", "static Gaussians"),
        count("gaussians.dynamic", "dynamic Gaussians"),
        metric("train.seconds", "training time", Some("s"), 0, Some(Lower)),
        metric("train.ms_per_step", "training step", Some("ms"), 1, Some(Lower)),
        metric("train.peak_memory", "peak memory of training", Some("MiB"), 0, Some(Lower)),
        metric("eval.seconds", "evaluation time", Some("s"), 0, Some(Lower)),
        metric("speed.fps", "FPS", None, 1, Some(Higher)),
        metric("speed.fps_without_mfta", "FPS without MFTA", None, 1, Some(Higher)),
    ]
});

/// Figures of the motion-aware modules. None of them is better when high or low.
static OF_MODULES: LazyLock<Vec<TableMetric>> = LazyLock::new(|| {
    let mut metrics = Vec::new();
    for (module, label) in [("mvg", "MVG"), ("mfta", "MFTA")] {
        for (name, what) in [
            ("norm", "norm beside the feature"),
            ("constant", "constant share"),
            ("over_gaussians", "share over Gaussians"),
            ("over_time", "share over time"),
            ("active", "active hidden units"),
            ("silent", "Gaussians without active units"),
        ] {
            metrics.push(metric(&format!("refinement.{module}.{name}"), &format!("{label} {what}"), None, 3, None));
        }
    }
    metrics.push(metric("refinement.attention.entropy", "entropy of attention", Some("nats"), 3, None));
    metrics.push(metric("refinement.attention.uniform_entropy", "entropy of uniform attention", Some("nats"), 3, None));
    metrics
});

/// A metric by its name, and how it is written.
#[derive(Clone, Debug, PartialEq)]
pub struct TableMetric {
    /// Its name, as in results.json: `composed.psnr`.
    pub name: String,
    /// What people call it.
    pub label: String,
    /// Its unit.
    pub unit: Option<&'static str>,
    /// Digits behind the point.
    pub decimals: usize,
    /// Whether it is counted, so that its thousands are kept apart.
    pub is_count: bool,
    /// Which way it is better; absent where nobody can say.
    pub better: Option<Better>,
}

fn metric(name: &str, label: &str, unit: Option<&'static str>, decimals: usize, better: Option<Better>) -> TableMetric {
    TableMetric { name: name.to_owned(), label: label.to_owned(), unit, decimals, is_count: false, better }
}

/// Every metric that a run may have.
pub(super) fn all() -> Vec<TableMetric> {
    let mut of_views = OF_VIEWS.to_vec();
    for kind in Metric::ALL {
        let of = |place: &str, prefix: &str| {
            let (name, label) = (format!("{place}.{}", kind.name()), format!("{prefix}{}", kind.label()));
            metric(&name, &label, kind.unit(), kind.decimals(), Some(kind.better()))
        };
        of_views.extend(BRANCHES.map(|(layer, prefix)| of(layer.name(), prefix)));
        // A region has no scales.
        if !matches!(kind, Metric::MsSsim | Metric::DSsim) {
            of_views.extend(REGIONS.map(|region| of(region, &format!("{} ", region.replace('_', " ")))));
        }
    }
    let of_training = |metric: &TableMetric| TableMetric {
        name: format!("{TRAINING_VIEWS}{}", metric.name),
        label: format!("training {}", metric.label),
        ..metric.clone()
    };
    let of_training: Vec<TableMetric> = of_views.iter().map(of_training).collect();
    of_views.into_iter().chain(of_training).chain(OF_RUN.iter().chain(OF_MODULES.iter()).cloned()).collect()
}

/// The LPIPS network that a metric is computed by; absent where it needs none.
pub(super) fn lpips_network(name: &str) -> Option<Backbone> {
    let last = name.rsplit('.').next().unwrap_or(name);
    Backbone::ALL.into_iter().find(|network| last.contains(&format!("lpips_{}", network.name())))
}

impl TableMetric {
    /// The metric of a name; one that is not known is shown by its name, with four digits.
    pub fn of(name: &str) -> Self {
        let known = all().into_iter().find(|metric| metric.name == name);
        known.unwrap_or_else(|| metric(name, name, None, 4, None))
    }

    /// Label, unit and an arrow to the better side: `PSNR (dB) ↑`.
    pub fn heading(&self) -> String {
        let unit = self.unit.map_or(String::new(), |unit| format!(" ({unit})"));
        let arrow = self.better.map_or(String::new(), |better| format!(" {}", better.arrow()));
        format!("{}{unit}{arrow}", self.label)
    }

    /// A value with the digits that this metric is shown with.
    pub fn shown(&self, value: f64) -> String {
        self.rounded(value, self.decimals)
    }

    /// A difference, with its sign unless nothing is left of it.
    pub fn signed(&self, difference: f64) -> String {
        let shown = self.shown(difference);
        let is_nothing = !shown.contains(|digit: char| ('1'..='9').contains(&digit));
        if is_nothing || difference < 0.0 { shown } else { format!("+{shown}") }
    }

    /// A value with so many digits behind the point.
    pub fn rounded(&self, value: f64, decimals: usize) -> String {
        let text = format!("{:.decimals$}", value.abs());
        let is_nothing = !text.contains(|digit: char| ('1'..='9').contains(&digit));
        let sign = if value < 0.0 && !is_nothing { "-" } else { "" };
        if self.is_count { format!("{sign}{}", with_thousands_apart(&text)) } else { format!("{sign}{text}") }
    }
}

/// Digits in groups of three; what stands behind a point is left as it is.
fn with_thousands_apart(digits: &str) -> String {
    let (whole, rest) = digits.split_at(digits.find('.').unwrap_or(digits.len()));
    let mut grouped = String::new();
    for (index, digit) in whole.chars().enumerate() {
        if index > 0 && (whole.len() - index).is_multiple_of(3) {
            grouped.push(',');
        }
        grouped.push(digit);
    }
    grouped + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_metric_knows_its_network() {
        for kind in Metric::ALL {
            let network = match kind {
                Metric::Lpips(variant) => Some(variant.backbone),
                _ => None,
            };
            assert_eq!(lpips_network(&format!("static.{}", kind.name())), network, "{kind:?}");
        }
        assert_eq!(lpips_network("training_views.temporal.t_lpips_vgg"), Some(Backbone::Vgg));
        assert_eq!(lpips_network("temporal.consecutive_lpips_alex"), Some(Backbone::Alex));
        assert_eq!(lpips_network("train.seconds"), None);
    }

    #[test]
    fn names_become_headings() {
        for (name, heading) in [
            ("composed.psnr", "PSNR (dB) \u{2191}"),
            ("static.ssim", "static SSIM \u{2191}"),
            ("dynamic_region.lpips_vgg", "dynamic region LPIPS-vgg \u{2193}"),
            ("training_views.dynamic_region.psnr", "training dynamic region PSNR (dB) \u{2191}"),
            ("training_views.composed.psnr", "training PSNR (dB) \u{2191}"),
            ("training_views.temporal.t_lpips_vgg", "training T-LPIPS-vgg \u{2193}"),
            ("mask_iou", "mask IoU \u{2191}"),
            ("movers.psnr", "movers PSNR (dB) \u{2191}"),
            ("dynamic_minus_still_psnr", "dynamic - still region PSNR (dB)"),
            ("training_views.small_movers.recall", "training small movers recall \u{2191}"),
            ("composed.d_ssim", "D-SSIM \u{2193}"),
            ("temporal.t_lpips_alex", "T-LPIPS-alex \u{2193}"),
            ("temporal.consecutive_lpips_alex", "consecutive LPIPS-alex"),
            ("gaussians.dynamic", "dynamic Gaussians \u{2193}"),
            ("train.seconds", "training time (s) \u{2193}"),
            ("train.ms_per_step", "training step (ms) \u{2193}"),
            ("train.peak_memory", "peak memory of training (MiB) \u{2193}"),
            ("speed.fps", "FPS \u{2191}"),
            ("speed.fps_without_mfta", "FPS without MFTA \u{2191}"),
            ("some.new_metric", "some.new_metric"),
        ] {
            assert_eq!(TableMetric::of(name).heading(), heading, "{name}");
        }
    }

    #[test]
    fn every_metric_has_its_digits() {
        for (name, value, shown) in [
            ("composed.psnr", 27.3149, "27.31"),
            ("composed.ssim", 0.9, "0.9000"),
            ("composed.lpips_alex", 0.04567, "0.0457"),
            ("mask_iou", 0.81251, "0.813"),
            ("speed.fps", 62.75, "62.8"),
            ("train.seconds", 1234.5, "1234"),
            ("gaussians.static", 1_234_567.4, "1,234,567"),
            ("gaussians.static", 999.0, "999"),
            ("gaussians.static", -1000.0, "-1,000"),
            ("composed.psnr", -0.001, "0.00"),
        ] {
            assert_eq!(TableMetric::of(name).shown(value), shown, "{name} {value}");
        }
    }

    #[test]
    fn differences_have_signs_unless_they_are_nothing() {
        let psnr = TableMetric::of("composed.psnr");
        assert_eq!([-3.96, 0.125, -0.004, 0.004].map(|value| psnr.signed(value)), ["-3.96", "+0.12", "0.00", "0.00"]);
        assert_eq!(TableMetric::of("gaussians.dynamic").signed(12_000.0), "+12,000");
    }
}
