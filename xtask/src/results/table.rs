//! The tables in Markdown.

use std::fmt::Write;

use super::cells::{Cell, DEGAUSS, FOUR_DGS, FOUR_DGS_MOTION, FULL, METHODS, Method, SCENES};
use super::figures::Figures;

/// A figure of a run.
type Figure = fn(&Figures) -> Option<f64>;

/// The columns of the main table: head, figure, digits.
const COLUMNS: [(&str, Figure, usize); 11] = [
    ("composed PSNR", |f| f.composed.psnr, 2),
    ("SSIM", |f| f.composed.ssim, 4),
    ("LPIPS", |f| f.composed.lpips, 4),
    ("static PSNR", |f| f.static_.psnr, 2),
    ("SSIM", |f| f.static_.ssim, 4),
    ("LPIPS", |f| f.static_.lpips, 4),
    ("dynamic region PSNR", |f| f.dynamic.psnr, 2),
    ("SSIM", |f| f.dynamic.ssim, 4),
    ("LPIPS", |f| f.dynamic.lpips, 4),
    ("dynamic Gaussians", |f| f.dynamic_gaussians, 0),
    ("ms a step", |f| f.seconds_a_step.map(|seconds| 1000.0 * seconds), 0),
];

/// What the claim of the paper is about, with its digits.
const CLAIMS: [(&str, Figure, usize); 5] = [
    ("composed PSNR", |f| f.composed.psnr, 2),
    ("static PSNR", |f| f.static_.psnr, 2),
    ("LPIPS", |f| f.static_.lpips, 4),
    ("dynamic region PSNR", |f| f.dynamic.psnr, 2),
    ("LPIPS", |f| f.dynamic.lpips, 4),
];

/// The methods that are compared: the refined one first.
const PAIRS: [(Method, Method); 2] = [(FULL, DEGAUSS), (FOUR_DGS_MOTION, FOUR_DGS)];

/// Both tables.
pub fn write(runs: &[(Cell, Figures)]) -> String {
    let mut text = String::new();
    head(&mut text, &["scene", "method", "seeds"], COLUMNS.map(|(name, ..)| name));
    for scene in SCENES {
        for method in METHODS {
            let figures: Vec<Figures> = of(runs, scene.name, method).map(|(_, figures)| figures).collect();
            if figures.is_empty() {
                continue;
            }
            let cells = COLUMNS.map(|(_, figure, digits)| mean(figures.iter().filter_map(figure), digits));
            line(&mut text, &[scene.name.into(), method.name.into(), figures.len().to_string()], cells);
        }
    }
    text.push('\n');
    head(&mut text, &["scene", "difference, same seeds", "seeds"], CLAIMS.map(|(name, ..)| name));
    for scene in SCENES {
        for (refined, base) in PAIRS {
            let pairs: Vec<(Figures, Figures)> = of(runs, scene.name, refined)
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
fn of<'a>(runs: &'a [(Cell, Figures)], scene: &'a str, method: Method) -> impl Iterator<Item = (u64, Figures)> + 'a {
    let wanted = move |cell: &Cell| cell.scene.name == scene && cell.method == method;
    runs.iter().filter(move |(cell, _)| wanted(cell)).map(|(cell, figures)| (cell.seed, *figures))
}

/// Mean and standard deviation of the known values.
fn mean(values: impl Iterator<Item = f64>, digits: usize) -> String {
    match spread(&values.collect::<Vec<_>>()) {
        Some((mean, Some(deviation))) => format!("{mean:.digits$} ± {deviation:.digits$}"),
        Some((mean, None)) => format!("{mean:.digits$}"),
        None => "-".to_owned(),
    }
}

fn difference(pairs: &[(Figures, Figures)], figure: Figure, digits: usize) -> String {
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

fn head<const N: usize>(text: &mut String, labels: &[&str], columns: [&str; N]) {
    let all: Vec<&str> = labels.iter().copied().chain(columns).collect();
    // Writing to a string cannot fail.
    let _ = writeln!(text, "| {} |\n|{}", all.join(" | "), "---|".repeat(all.len()));
}

fn line<const N: usize>(text: &mut String, labels: &[String], cells: [String; N]) {
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
    }
}
