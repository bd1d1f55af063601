//! The tables in Markdown.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

use super::cells::{Cell, DEGAUSS, FOUR_DGS, FOUR_DGS_MOTION, FULL, METHODS, Method, SCENES};
use super::figures::Figures;

/// A figure of a run.
type Figure = fn(&Figures) -> Option<f64>;

/// The columns of the main table: head, figure, digits.
const COLUMNS: [(&str, Figure, usize); 14] = [
    ("composed PSNR", |f| f.composed.psnr, 2),
    ("composed SSIM", |f| f.composed.ssim, 4),
    ("composed LPIPS-alex", |f| f.composed.lpips, 4),
    ("static PSNR", |f| f.static_.psnr, 2),
    ("static SSIM", |f| f.static_.ssim, 4),
    ("static LPIPS-alex", |f| f.static_.lpips, 4),
    ("dynamic region PSNR", |f| f.dynamic.psnr, 2),
    ("dynamic region SSIM", |f| f.dynamic.ssim, 4),
    ("dynamic region LPIPS-alex", |f| f.dynamic.lpips, 4),
    ("movers PSNR", |f| f.movers.psnr, 2),
    ("movers SSIM", |f| f.movers.ssim, 4),
    ("dynamic - still region PSNR", |f| f.dynamic_minus_still, 2),
    ("small movers recall", |f| f.small_movers_recall, 3),
    ("dynamic Gaussians", |f| f.dynamic_gaussians, 0),
];

/// The column of time. Whatever else a machine does makes a run slower and never faster, so it is the fastest run that
/// tells what a step takes.
const TIME: &str = "ms a step, fastest run";

/// What the claim of the paper is about, with its digits.
const CLAIMS: [(&str, Figure, usize); 7] = [
    ("composed PSNR", |f| f.composed.psnr, 2),
    ("static PSNR", |f| f.static_.psnr, 2),
    ("static LPIPS-alex", |f| f.static_.lpips, 4),
    ("dynamic region PSNR", |f| f.dynamic.psnr, 2),
    ("dynamic region LPIPS-alex", |f| f.dynamic.lpips, 4),
    ("movers PSNR", |f| f.movers.psnr, 2),
    ("dynamic - still region PSNR", |f| f.dynamic_minus_still, 2),
];

/// The methods that are compared: the refined one first.
const PAIRS: [(Method, Method); 2] = [(FULL, DEGAUSS), (FOUR_DGS_MOTION, FOUR_DGS)];

/// Both tables, and below the first what the dynamic regions are, and why there is no LPIPS where there is none.
pub fn write(runs: &[(Cell, Figures)]) -> String {
    let mut text = String::new();
    head(&mut text, &["scene", "method", "seeds"], COLUMNS.into_iter().map(|(name, ..)| name).chain([TIME]));
    for scene in SCENES {
        for method in METHODS {
            let figures: Vec<&Figures> = of(runs, scene.name, method).map(|(_, figures)| figures).collect();
            if figures.is_empty() {
                continue;
            }
            let cells = COLUMNS.map(|(_, figure, digits)| mean(figures.iter().copied().filter_map(figure), digits));
            let labels = [scene.name.into(), method.name.into(), figures.len().to_string()];
            line(&mut text, &labels, cells.into_iter().chain([fastest(&figures)]));
        }
    }
    text.push('\n');
    masks(&mut text, runs);
    reasons(&mut text, runs);
    head(&mut text, &["scene", "difference, same seeds", "seeds"], CLAIMS.map(|(name, ..)| name));
    for scene in SCENES {
        for (refined, base) in PAIRS {
            let pairs: Vec<(&Figures, &Figures)> = of(runs, scene.name, refined)
                .filter_map(|(seed, refined)| {
                    let (_, base) = of(runs, scene.name, base).find(|&(other, _)| other == seed)?;
                    Some((refined, base))
                })
                .collect();
            if pairs.is_empty() {
                continue;
            }
            let cells = CLAIMS.map(|(_, figure, digits)| difference(&pairs, figure, digits));
            let name = format!("{} - {}", refined.name, base.name);
            line(&mut text, &[scene.name.into(), name, pairs.len().to_string()], cells);
        }
    }
    text
}

/// The runs of a method on a scene, by seed.
fn of<'a>(
    runs: &'a [(Cell, Figures)],
    scene: &'a str,
    method: Method,
) -> impl Iterator<Item = (u64, &'a Figures)> + 'a {
    let wanted = move |cell: &Cell| cell.scene.name == scene && cell.method == method;
    runs.iter().filter(move |(cell, _)| wanted(cell)).map(|(cell, figures)| (cell.seed, figures))
}

/// Which masks the dynamic regions were taken from: a paragraph, unless no run has a region. Published figures of one
/// region by different masks are 7 dB apart.
fn masks(text: &mut String, runs: &[(Cell, Figures)]) {
    let mut scenes: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
    for (cell, figures) in runs {
        let Some(source) = &figures.region_source else { continue };
        scenes.entry(source.replace('_', " ")).or_default().insert(cell.scene.name);
    }
    let of = |(source, scenes): (&String, &BTreeSet<&str>)| {
        let scenes: Vec<String> = scenes.iter().map(|scene| format!("`{scene}`")).collect();
        format!("{source} ({})", scenes.join(", "))
    };
    let sources: Vec<String> = scenes.iter().map(of).collect();
    if !sources.is_empty() {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "Dynamic and still regions: {}. Movers: true masks.\n", sources.join("; "));
    }
}

/// Why runs have no LPIPS: a paragraph, unless all have one.
fn reasons(text: &mut String, runs: &[(Cell, Figures)]) {
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for reason in runs.iter().filter_map(|(_, figures)| figures.why_no_lpips.as_deref()) {
        *counts.entry(reason).or_default() += 1;
    }
    if counts.is_empty() {
        return;
    }
    for (reason, count) in counts {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{count} of {} runs have no LPIPS: {reason}.", runs.len());
    }
    text.push('\n');
}

/// Mean and standard deviation of the known values.
fn mean(values: impl Iterator<Item = f64>, digits: usize) -> String {
    match spread(&values.collect::<Vec<_>>()) {
        Some((mean, Some(deviation))) => format!("{mean:.digits$} ± {deviation:.digits$}"),
        Some((mean, None)) => format!("{mean:.digits$}"),
        None => "-".to_owned(),
    }
}

/// Milliseconds that a step took in the fastest of the runs.
fn fastest(runs: &[&Figures]) -> String {
    let seconds = runs.iter().filter_map(|figures| figures.seconds_a_step).min_by(f64::total_cmp);
    seconds.map_or("-".to_owned(), |seconds| format!("{:.0}", 1000.0 * seconds))
}

fn difference(pairs: &[(&Figures, &Figures)], figure: Figure, digits: usize) -> String {
    let differences: Vec<f64> =
        pairs.iter().filter_map(|(refined, base)| Some(figure(refined)? - figure(base)?)).collect();
    match spread(&differences) {
        Some((mean, Some(deviation))) => format!("{mean:+.digits$} ± {deviation:.digits$}"),
        Some((mean, None)) => format!("{mean:+.digits$}"),
        None => "-".to_owned(),
    }
}

/// Mean and sample standard deviation; a single value has none, and no value has neither.
fn spread(values: &[f64]) -> Option<(f64, Option<f64>)> {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let squares: f64 = values.iter().map(|value| (value - mean).powi(2)).sum();
    let deviation = (values.len() > 1).then(|| (squares / (count - 1.0)).sqrt());
    (!values.is_empty()).then_some((mean, deviation))
}

fn head<'a>(text: &mut String, labels: &[&'a str], columns: impl IntoIterator<Item = &'a str>) {
    let all: Vec<&str> = labels.iter().copied().chain(columns).collect();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "| {} |\n|{}", all.join(" | "), "---|".repeat(all.len()));
}

fn line(text: &mut String, labels: &[String], cells: impl IntoIterator<Item = String>) {
    let all: Vec<String> = labels.iter().cloned().chain(cells).collect();
    let _ = writeln!(text, "| {} |", all.join(" | "));
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::cells::all;
    use crate::results::figures::Layer;

    #[test]
    fn runs_become_means_with_spread_and_paired_differences() {
        let psnr = |cell: &Cell| 20.0 + cell.seed as f64 + if cell.method == FULL { 0.5 } else { 0.0 };
        let runs: Vec<(Cell, Figures)> = all(None, None, &[1, 3])
            .into_iter()
            .map(|cell| {
                let composed = Layer { psnr: Some(psnr(&cell)), ..Layer::default() };
                (cell, Figures { composed, ..Figures::default() })
            })
            .collect();
        let text = write(&runs);
        assert!(text.contains("| video | MVFusion-GS | 2 | 22.50 ± 1.41 | - |"), "{text}");
        assert!(text.contains("| casual | MVFusion-GS - DeGauss | 2 | +0.50 ± 0.00 | - | - | - | - |"), "{text}");
        assert!(write(&runs[..8]).contains("| casual | MVFusion-GS - DeGauss | 1 | +0.50 | - | - | - | - |"));
        assert!(!text.contains("have no LPIPS"), "{text}");
    }

    #[test]
    fn the_table_names_the_masks_of_its_regions_by_scene() {
        let runs: Vec<(Cell, Figures)> = all(None, None, &[1])
            .into_iter()
            .map(|cell| {
                let source = if cell.scene.name == "casual" { "given_masks" } else { "true_masks" };
                (cell, Figures { region_source: Some(source.into()), ..Figures::default() })
            })
            .collect();
        let note = "Dynamic and still regions: given masks (`casual`); true masks (`video`).";
        assert!(write(&runs).contains(note), "{}", write(&runs));
        assert!(!write(&[]).contains("regions:"));
    }

    #[test]
    fn time_is_that_of_the_fastest_run() {
        let run = |seconds_a_step| Figures { seconds_a_step, ..Figures::default() };
        let runs = [run(Some(0.25)), run(None), run(Some(0.1236)), run(Some(3.0))];
        assert_eq!(fastest(&runs.iter().collect::<Vec<_>>()), "124");
        assert_eq!(fastest(&[&runs[1]]), "-");
    }

    #[test]
    fn every_head_names_its_figure() {
        let heads: BTreeSet<&str> = COLUMNS.iter().map(|&(head, ..)| head).collect();
        assert_eq!(heads.len(), COLUMNS.len());
        let known = Figures {
            composed: Layer { psnr: Some(1.0), ssim: Some(2.0), lpips: Some(3.0) },
            static_: Layer { psnr: Some(4.0), ssim: Some(5.0), lpips: Some(6.0) },
            dynamic: Layer { psnr: Some(7.0), ssim: Some(8.0), lpips: Some(9.0) },
            movers: Layer { psnr: Some(10.0), ssim: Some(11.0), lpips: None },
            dynamic_minus_still: Some(12.0),
            small_movers_recall: Some(13.0),
            ..Figures::default()
        };
        let numbers = COLUMNS.map(|(_, figure, _)| figure(&known));
        assert_eq!(numbers[..13], std::array::from_fn::<_, 13, _>(|place| Some((place + 1) as f64)));
        assert_eq!(numbers[13], None, "the count of Gaussians");
        // The same name is the same figure in both tables.
        for (head, figure, digits) in CLAIMS {
            let same = COLUMNS.into_iter().find(|&(other, ..)| other == head);
            let (_, other, others_digits) = same.expect("a column of the main table");
            assert_eq!((other(&known), others_digits), (figure(&known), digits), "{head}");
        }
        let text = write(&[]);
        for layer in ["composed", "static", "dynamic region"] {
            assert!(text.contains(&format!("| {layer} PSNR | {layer} SSIM | {layer} LPIPS-alex |")), "{text}");
        }
    }

    #[test]
    fn without_lpips_the_table_says_why_below_and_has_no_zeros() {
        let reason = |cell: &Cell| match cell.seed {
            1 => Some("no folder of weights was given".to_owned()),
            _ => None,
        };
        let runs: Vec<(Cell, Figures)> = all(None, None, &[1, 3])
            .into_iter()
            .map(|cell| {
                let lpips = reason(&cell).is_none().then_some(0.25);
                let composed = Layer { lpips, ..Layer::default() };
                let figures = Figures { composed, why_no_lpips: reason(&cell), ..Figures::default() };
                (cell, figures)
            })
            .collect();
        let text = write(&runs);
        let note = "|\n\n8 of 16 runs have no LPIPS: no folder of weights was given.\n\n| scene | difference";
        assert!(text.contains(note), "{text}");
        assert!(text.contains("| video | DeGauss | 2 | - | - | 0.2500 | - |"), "{text}");
        assert!(write(&runs[..8]).contains("| video | DeGauss | 1 | - | - | - | - |"));
    }
}
