//! What the columns of a table are: labels, units, digits, and which way a figure is better.

use mvfusion_model::evaluation::{Backbone, Better, Metric};

/// A figure by its name, and how it is written.
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

/// A figure by the last part of its name.
struct Kind {
    label: &'static str,
    unit: Option<&'static str>,
    decimals: usize,
    better: Option<Better>,
}

const fn kind(label: &'static str, unit: Option<&'static str>, decimals: usize, better: Option<Better>) -> Kind {
    Kind { label, unit, decimals, better }
}

/// Label, unit, digits and direction of the figures that are known by the last part of their names.
fn known(name: &str) -> Option<Kind> {
    use Better::{Higher, Lower};
    if let Some(figure) = Metric::ALL.into_iter().find(|figure| figure.name() == name) {
        return Some(kind(figure.label(), figure.unit(), figure.decimals(), Some(figure.better())));
    }
    Some(match name {
        "t_lpips_alex" => kind("T-LPIPS-alex", None, 4, Some(Lower)),
        "t_lpips_vgg" => kind("T-LPIPS-vgg", None, 4, Some(Lower)),
        // Motion is a part of these, so that neither a high nor a low one is good.
        "consecutive_lpips_alex" => kind("consecutive LPIPS-alex", None, 4, None),
        "consecutive_lpips_vgg" => kind("consecutive LPIPS-vgg", None, 4, None),
        // A run that gets worse where nothing moves has a higher one, too.
        "dynamic_minus_still_psnr" => kind("dynamic - still region PSNR", Some("dB"), 2, None),
        "recall" => kind("recall", None, 3, Some(Higher)),
        "components" => kind("components", None, 0, None),
        "mask_iou" => kind("mask IoU", None, 3, Some(Higher)),
        "fps" => kind("FPS", None, 1, Some(Higher)),
        "fps_without_mfta" => kind("FPS without MFTA", None, 1, Some(Higher)),
        "seconds" => kind("time", Some("s"), 0, Some(Lower)),
        "ms_per_step" => kind("step", Some("ms"), 1, Some(Lower)),
        _ => return None,
    })
}

/// What a part of a name in front of the last adds to the label.
fn place(part: &str) -> Option<String> {
    match part {
        "test" | "composed" | "temporal" | "speed" => None,
        "train" | "training_views" => Some("training ".to_owned()),
        "eval" => Some("evaluation ".to_owned()),
        other => Some(format!("{} ", other.replace('_', " "))),
    }
}

/// The network that a figure is told by; absent where it is told by none.
pub fn lpips_network(name: &str) -> Option<Backbone> {
    let last = name.rsplit('.').next().unwrap_or(name);
    Backbone::ALL.into_iter().find(|network| last.contains(&format!("lpips_{}", network.name())))
}

impl TableMetric {
    /// The figure of a name; one that is not known is shown by its name, with four digits.
    pub fn of(name: &str) -> Self {
        let (places, last) = name.rsplit_once('.').unwrap_or(("", name));
        if places == "gaussians" {
            let label = format!("{last} Gaussians");
            let (decimals, better) = (0, Some(Better::Lower));
            return Self { name: name.to_owned(), label, unit: None, decimals, is_count: true, better };
        }
        let Some(Kind { label, unit, decimals, better }) = known(last) else {
            let label = name.to_owned();
            return Self { name: name.to_owned(), label, unit: None, decimals: 4, is_count: false, better: None };
        };
        let places: String = places.split('.').filter(|part| !part.is_empty()).filter_map(place).collect();
        Self { name: name.to_owned(), label: format!("{places}{label}"), unit, decimals, is_count: false, better }
    }

    /// Label, unit and an arrow to the better side: `PSNR (dB) ↑`.
    pub fn heading(&self) -> String {
        let unit = self.unit.map_or(String::new(), |unit| format!(" ({unit})"));
        let arrow = self.better.map_or(String::new(), |better| format!(" {}", better.arrow()));
        format!("{}{unit}{arrow}", self.label)
    }

    /// A value with the digits that this figure is shown with.
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
    fn every_figure_knows_its_network() {
        for figure in Metric::ALL {
            let network = match figure {
                Metric::Lpips(variant) => Some(variant.backbone),
                _ => None,
            };
            assert_eq!(lpips_network(&format!("static.{}", figure.name())), network, "{figure:?}");
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
            ("speed.fps", "FPS \u{2191}"),
            ("speed.fps_without_mfta", "FPS without MFTA \u{2191}"),
            ("some.new_figure", "some.new_figure"),
        ] {
            assert_eq!(TableMetric::of(name).heading(), heading, "{name}");
        }
    }

    #[test]
    fn every_figure_has_its_digits() {
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
