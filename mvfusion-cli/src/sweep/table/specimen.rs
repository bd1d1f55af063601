//! Sweeps for tests.

use std::collections::BTreeMap;

use super::{CellMetrics, Outcome};
use crate::sweep::grid::ColumnGroup;
use crate::sweep::index::{Cell, Index, Wanted};

/// An index without cells.
pub(in crate::sweep) fn index(axes: &[&str], columns: Vec<ColumnGroup>, paper: &str) -> Index {
    #[derive(serde::Deserialize)]
    struct Paper {
        #[serde(default)]
        paper: Vec<crate::sweep::grid::PaperRow>,
    }
    let Paper { paper } = toml::from_str(paper).expect("the paper's rows");
    Index {
        name: "ablation_50%".into(),
        title: "Ablation of MVG & MFTA".into(),
        about: "What each part brings.".into(),
        axes: axes.iter().map(|&key| key.to_owned()).collect(),
        columns,
        differences: Vec::new(),
        rule: None,
        paper,
        grid_sha256: None,
        amendments: Vec::new(),
        wanted: Wanted::default(),
        expected: None,
        cells: Vec::new(),
    }
}

/// Neighbouring columns.
pub(super) fn group(title: &str, scenes: &[&str], metrics: &[&str]) -> ColumnGroup {
    let owned = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect();
    ColumnGroup { title: title.to_owned(), scenes: owned(scenes), metrics: owned(metrics) }
}

/// A cell.
pub(in crate::sweep) fn cell(scene: &str, variant: &str, values: &[&str], seed: u64) -> Cell {
    Cell {
        id: format!("{scene}-{variant}-{values:?}-{seed}"),
        scene: scene.to_owned(),
        variant: variant.to_owned(),
        values: values.iter().map(|&value| value.to_owned()).collect(),
        seed,
        preset: "neu3d".into(),
        steps: 14_000,
        not_comparable: None,
    }
}

/// Metrics by their names.
pub(super) fn metrics(metrics: &[(&str, f64)]) -> Outcome {
    let numbers: BTreeMap<_, _> = metrics.iter().map(|&(name, value)| (name.to_owned(), value)).collect();
    Outcome::Metrics(CellMetrics { numbers, ..CellMetrics::default() })
}

/// Three variants, two scenes and three seeds: the variant `full` is complete; of `w/o MVG|MFTA` one cell of seed 2 is
/// not finished; `broken` knows nothing, since two of its cells failed, and has a third seed that is complete in one
/// scene only.
pub(super) fn ablation() -> (Index, Vec<Outcome>) {
    let columns = vec![
        group("Mean", &[], &["composed.psnr", "composed.ssim", "mask_iou"]),
        group("Video", &["video"], &["composed.psnr", "gaussians.dynamic"]),
    ];
    let paper = "
        [[paper]]
        literature = '3DGS_2023'
        column = 'Mean'
        values = { 'composed.psnr' = 30.5, 'composed.ssim' = 0.94 }
        [[paper]]
        variant = 'full'
        column = 'Mean'
        values = { 'composed.psnr' = 32.07, 'composed.ssim' = 0.943 }
        [[paper]]
        variant = 'broken'
        column = 'Mean'
        values = { 'composed.psnr' = 31.52 }
        ";
    let mut index = index(&[], columns, paper);
    let mut outcomes = Vec::new();
    for seed in 0..3 {
        for (scene, worse) in [("video", 0.0), ("steak", 2.0)] {
            for variant in ["w/o MVG|MFTA", "full", "broken"] {
                let mut cell = cell(scene, variant, &[], seed);
                cell.not_comparable = match (variant, scene) {
                    ("full", "video") => Some("built-in scene".into()),
                    ("full", _) => Some("train.scale = 0.3".into()),
                    _ => None,
                };
                index.cells.push(cell);
                let psnr = seed as f64 - worse + if variant == "full" { 29.0 } else { 28.0 };
                outcomes.push(match (variant, scene, seed) {
                    ("broken", "steak", 0 | 1) => Outcome::Failed,
                    ("w/o MVG|MFTA", "steak", 2) => Outcome::Unfinished,
                    ("broken", "steak", _) => metrics(&[("composed.ssim", 0.75)]),
                    _ => metrics(&[
                        ("composed.psnr", psnr),
                        ("composed.ssim", 0.9),
                        ("gaussians.dynamic", 12_345.0 + seed as f64),
                    ]),
                });
            }
        }
    }
    (index, outcomes)
}

/// A swept window of 3, 5 and 9 for two seeds, with the paper's numbers at two of them.
pub(super) fn windows() -> (Index, Vec<Outcome>) {
    let columns = vec![group("Neu3D", &[], &["composed.psnr", "composed.lpips_alex"])];
    let paper = "
        [[paper]]
        at = { motion.window = 5 }
        column = 'Neu3D'
        values = { 'composed.psnr' = 32.07 }
        [[paper]]
        at = { 'motion.window' = 9 }
        column = 'Neu3D'
        values = { 'composed.psnr' = 31.9 }
        ";
    let mut index = index(&["motion.window", "motion.kind"], columns, paper);
    let mut outcomes = Vec::new();
    for seed in 0..2 {
        for (window, psnr) in [("9", 31.0), ("3", 30.0), ("5", 31.5)] {
            index.cells.push(cell("video", "", &[window, "\"global\""], seed));
            let psnr = psnr + 0.25 * seed as f64;
            outcomes.push(metrics(&[("composed.psnr", psnr), ("composed.lpips_alex", 0.05)]));
        }
    }
    (index, outcomes)
}
