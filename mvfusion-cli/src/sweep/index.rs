//! `sweep.json`: the cells of a sweep, and the table that they are for.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::Context;
use mvfusion_data::files::{read_bytes, read_text};
use mvfusion_model::evaluation::Backbone;
use mvfusion_model::files::sha256;
use serde::{Deserialize, Serialize};

use super::amendments::Amendment;
use super::grid::{ColumnGroup, Difference, Expected, PaperRow, Rule};
use super::metric::lpips_network;
use crate::{atomic, lpips, run};

/// Name of the file.
pub const INDEX: &str = "sweep.json";

/// All that the commands `status` and `table` need to know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Index {
    /// The grid's name.
    pub name: String,
    /// Heading of the table.
    pub title: String,
    /// What it shows.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub about: String,
    /// The swept keys, dotted, in the order of a cell's values.
    pub axes: Vec<String>,
    /// Columns of the table.
    pub columns: Vec<ColumnGroup>,
    /// Pairs of variants whose differences the table shows too.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub differences: Vec<Difference>,
    /// How the differences are judged.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub rule: Option<Rule>,
    /// What the paper has.
    pub paper: Vec<PaperRow>,
    /// SHA-256 of the grid's text, by which a change of the copy in the folder is known; absent in earlier versions.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub grid_sha256: Option<String>,
    /// What was changed of what decides, after cells had finished.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub amendments: Vec<Amendment>,
    /// What is measured beside the metrics that a training leaves.
    pub wanted: Wanted,
    /// How long a cell takes, as the grid says.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub expected: Option<Expected>,
    /// The cells, scenes varying slowest within a seed, seeds slowest of all: a table is complete early, if with few
    /// seeds.
    pub cells: Vec<Cell>,
}

/// What is measured of a cell beside what its configuration says.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Wanted {
    /// Frames over which the speed of rendering is measured; 0 measures none.
    pub speed_frames: usize,
    /// Folder with the weights of LPIPS; without it there are no such metrics.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_weights: Option<PathBuf>,
    /// By the names of the networks that a column needs and whose weights lie there: SHA-256 of their files.
    pub lpips: BTreeMap<String, String>,
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// From the hash of the resolved configuration; the name of its folder.
    pub id: String,
    /// Name of its scene.
    pub scene: String,
    /// Name of its variant; empty where the grid has none.
    pub variant: String,
    /// Its values of the swept keys, as TOML.
    pub values: Vec<String>,
    /// Its seed.
    pub seed: u64,
    /// The preset that it started from.
    pub preset: String,
    /// Optimiser steps.
    pub steps: usize,
    /// Why the paper's numbers are not comparable with its metrics; absent where they are.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub not_comparable: Option<String>,
}

impl Wanted {
    /// What a table of these columns wants. The files of weights are read here once: whether a cell is finished is
    /// asked often.
    ///
    /// # Errors
    /// If a file of weights cannot be read, or the current folder is gone.
    pub fn new(speed_frames: usize, weights: Option<&Path>, columns: &[ColumnGroup]) -> anyhow::Result<Self> {
        let weights = weights.filter(|weights| !lpips::is_none(weights));
        let lpips_weights = weights.map(std::path::absolute).transpose()?;
        let mut lpips = BTreeMap::new();
        for network in lpips_networks(columns) {
            if let Some(path) = lpips_weights.as_deref().and_then(|folder| network.file_in(folder)) {
                let bytes = read_bytes(&path, Backbone::MOST_BYTES)
                    .with_context(|| format!("cannot read {}", path.display()))?;
                lpips.insert(network.name().to_owned(), sha256(&bytes));
            }
        }
        Ok(Self { speed_frames, lpips_weights, lpips })
    }
}

/// The networks of LPIPS that some column needs.
fn lpips_networks(columns: &[ColumnGroup]) -> BTreeSet<Backbone> {
    columns.iter().flat_map(|column| &column.metrics).filter_map(|metric| lpips_network(metric)).collect()
}

/// The hash of the grid that was written into a sweep's folder, if an index of any version has it.
pub(super) fn grid_hash(folder: &Path) -> Option<String> {
    #[derive(Deserialize)]
    struct Written {
        grid_sha256: Option<String>,
    }
    run::read_json::<Written>(&folder.join(INDEX)).ok()?.grid_sha256
}

/// What is said of a file that this version did not write, and what to do about it.
pub(super) fn of_another_version(path: &Path) -> String {
    format!(
        "{} is not as this version writes it (start the sweep again with the same --out: it is written anew, and cells \
         that still fit are kept)",
        path.display()
    )
}

impl Index {
    /// Reads that of a sweep's folder.
    ///
    /// # Errors
    /// If the folder holds no sweep, or one of another version.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join(INDEX);
        let text = read_text(&path, run::MOST_OF_RECORDS).with_context(|| {
            format!(
                "{} is no folder of a sweep (give the --out of `mvfusion sweep`, runs/sweeps/NAME unless told \
                 otherwise): cannot read {INDEX}",
                folder.display()
            )
        })?;
        serde_json::from_str(&text).with_context(|| of_another_version(&path))
    }

    /// The networks of LPIPS that some column needs.
    pub fn lpips_networks(&self) -> BTreeSet<Backbone> {
        lpips_networks(&self.columns)
    }

    /// Writes it into a sweep's folder.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn write(&self, folder: &Path) -> anyhow::Result<()> {
        atomic::write_json(&run::place(folder, &[INDEX])?, self)
    }
}

impl Cell {
    /// Its place in the grid in words: `video, w/o MVG, motion.window = 5, seed 11`.
    pub fn name(&self, axes: &[String]) -> String {
        let values = axes.iter().zip(&self.values).map(|(key, value)| format!("{key} = {value}"));
        let variant = (!self.variant.is_empty()).then(|| self.variant.clone());
        let parts = std::iter::once(self.scene.clone()).chain(variant).chain(values);
        parts.chain([format!("seed {}", self.seed)]).collect::<Vec<_>>().join(", ")
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn column(metrics: &[&str]) -> ColumnGroup {
        let metrics = metrics.iter().map(|&metric| metric.to_owned()).collect();
        ColumnGroup { title: "all".into(), scenes: Vec::new(), metrics }
    }

    #[test]
    fn the_weights_that_columns_need_are_wanted_by_their_hash() {
        let folder = tempfile::tempdir().expect("folder");
        let wanted = |metrics: &[&str]| {
            Wanted::new(0, Some(folder.path()), &[column(&["composed.psnr"]), column(metrics)]).expect("read").lpips
        };
        assert!(wanted(&["composed.lpips_alex"]).is_empty(), "no file");
        for network in ["alex", "vgg"] {
            fs::write(folder.path().join(format!("lpips_{network}_f32.safetensors")), network).expect("written");
        }
        let hash = |network: &str| (network.to_owned(), sha256(network.as_bytes()));
        assert!(wanted(&["train.seconds"]).is_empty(), "no column");
        assert_eq!(wanted(&["temporal.t_lpips_alex"]), BTreeMap::from([hash("alex")]));
        assert_eq!(wanted(&["static.lpips_vgg_raw", "composed.lpips_alex"]), BTreeMap::from(["alex", "vgg"].map(hash)));
        let none = Wanted::new(0, None, &[column(&["composed.lpips_alex"])]).expect("nothing to read");
        assert_eq!(none, Wanted::default());
    }

    #[test]
    fn a_folder_without_an_index_of_this_version_is_refused_with_what_to_do() {
        let folder = tempfile::tempdir().expect("folder");
        let said = || format!("{:#}", Index::read(folder.path()).expect_err("refused"));
        assert!(said().contains("is no folder of a sweep") && said().contains("runs/sweeps/NAME"), "{}", said());
        fs::write(folder.path().join(INDEX), r#"{ "name": "old" }"#).expect("written");
        assert!(said().contains("not as this version writes it") && said().contains("the same --out"), "{}", said());
    }
}
