//! `sweep.json`: the cells of a sweep, and the table that they are for.

use std::path::{Path, PathBuf};

use anyhow::Context;
use serde::{Deserialize, Serialize};

use super::grid::{ColumnGroup, Expected, PaperRow};
use crate::{atomic, run};

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
    /// What the paper has.
    pub paper: Vec<PaperRow>,
    /// What is measured beside the figures that a training leaves.
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
    /// Folder with the weights of LPIPS; without it there are no such figures.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub lpips_weights: Option<PathBuf>,
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
    /// Why the paper's numbers are not comparable with its figures; absent where they are.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub not_comparable: Option<String>,
}

impl Index {
    /// Reads that of a sweep's folder.
    ///
    /// # Errors
    /// If the folder holds no sweep, or one of another version.
    pub fn read(folder: &Path) -> anyhow::Result<Self> {
        let path = folder.join(INDEX);
        let text = std::fs::read_to_string(&path)
            .with_context(|| format!("{} is no folder of a sweep: cannot read {INDEX}", folder.display()))?;
        serde_json::from_str(&text).with_context(|| format!("{} is not as this version writes it", path.display()))
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
