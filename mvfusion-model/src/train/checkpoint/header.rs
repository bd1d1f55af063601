//! The header of a checkpoint: everything except the tensors.

use std::collections::BTreeMap;

use mvfusion_render::grid::GridLayout;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::model::motion::{MovingNormaliser, Normalisers, SIGNATURE_WIDTH, VELOCITY_WIDTH};
use crate::random::Streams;
use crate::train::densify::DensifyCounts;
use crate::train::{BadSteps, Sampler};

/// Largest count that a header may hold, 2^53. No run reaches it, and one more never overflows.
const MOST: u64 = 1 << 53;

/// Highest SH degree.
const HIGHEST_DEGREE: usize = 3;

/// The contents of a checkpoint except the tensors. docs/formats.md describes the fields.
#[derive(Debug, Serialize)]
pub(super) struct Header {
    pub completed: usize,
    /// SH degree of the dynamic branch, then of the static branch, if there is one.
    pub sh_degrees: Vec<usize>,
    pub grid_max: [f64; 3],
    pub grid_min: [f64; 3],
    /// Absent in schema 1.
    pub grid_layout: Option<GridSize>,
    pub knot_times: Option<Vec<f64>>,
    pub adam_steps: BTreeMap<String, usize>,
    pub normalisers: Normalisers,
    pub streams: Streams,
    pub sampler: Sampler,
    /// Counts of the dynamic branch, then of the static branch.
    #[serde(rename = "census")]
    pub counts: [DensifyCounts; 2],
    pub refreshes: usize,
    /// Absent in schema 1.
    pub bad_steps: BadSteps,
}

/// The size of the HexPlane, as in the configuration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct GridSize {
    pub features: usize,
    pub resolution: [usize; 4],
    pub multipliers: Vec<usize>,
}

impl From<&GridLayout> for GridSize {
    fn from(layout: &GridLayout) -> Self {
        let GridLayout { features, resolution, multipliers } = layout.clone();
        Self { features, resolution, multipliers }
    }
}

/// The fields of a header that have not been read yet.
struct Fields(BTreeMap<String, Value>);

impl Fields {
    /// Takes a field. The error names it.
    fn take<T: DeserializeOwned>(&mut self, name: &str) -> Result<T, String> {
        let value = self.0.remove(name).ok_or_else(|| format!("`{name}` is missing in its header"))?;
        serde_json::from_value(value).map_err(|error| format!("`{name}` in its header: {error}"))
    }
}

impl Header {
    /// Reads and checks a header. Every error names the field.
    pub fn parse(text: &str, schema: u64) -> Result<Self, String> {
        let fields = serde_json::from_str(text).map_err(|error| format!("its header is no JSON object: {error}"))?;
        let mut fields = Fields(fields);
        let header = Self {
            completed: fields.take("completed")?,
            sh_degrees: fields.take("sh_degrees")?,
            grid_max: fields.take("grid_max")?,
            grid_min: fields.take("grid_min")?,
            grid_layout: if schema > 1 { Some(fields.take("grid_layout")?) } else { None },
            knot_times: fields.take("knot_times")?,
            adam_steps: fields.take("adam_steps")?,
            normalisers: fields.take("normalisers")?,
            streams: fields.take("streams")?,
            sampler: fields.take("sampler")?,
            counts: fields.take("census")?,
            refreshes: fields.take("refreshes")?,
            bad_steps: if schema > 1 { fields.take("bad_steps")? } else { BadSteps::default() },
        };
        if let Some(unknown) = fields.0.keys().next() {
            return Err(format!("`{unknown}` is no field of a header of schema {schema}"));
        }
        header.check()?;
        Ok(header)
    }

    /// Checks what can be checked without the configuration.
    fn check(&self) -> Result<(), String> {
        self.check_counts()?;
        let degrees = &self.sh_degrees;
        if !matches!(degrees.len(), 1 | 2) || degrees.iter().any(|&degree| degree > HIGHEST_DEGREE) {
            return Err(format!(
                "`sh_degrees` is {degrees:?}: one or two numbers from 0 to {HIGHEST_DEGREE} belong there"
            ));
        }
        let (max, min) = (self.grid_max, self.grid_min);
        let has_room = |axis: usize| max[axis] > min[axis] && ((max[axis] - min[axis]) as f32).is_finite();
        // A number that is not finite cannot be written in JSON, but one that overflows in f32 can.
        let is_single = |value: &f64| (*value as f32).is_finite();
        if !max.iter().chain(&min).all(is_single) || !(0..3).all(has_room) {
            return Err(format!("`grid_max` {max:?} and `grid_min` {min:?} are no corners of a box"));
        }
        if let Some(knots) = &self.knot_times
            && (knots.is_empty() || !knots.is_sorted_by(|a, b| a < b))
        {
            return Err(format!("`knot_times` {} are not in ascending order, or none", shortened(knots)));
        }
        let Normalisers { signatures, local, velocities } = &self.normalisers;
        check_normaliser("signatures", signatures, SIGNATURE_WIDTH)?;
        check_normaliser("local", local, 1)?;
        check_normaliser("velocities", velocities, VELOCITY_WIDTH)
    }

    fn check_counts(&self) -> Result<(), String> {
        let adam = self.adam_steps.iter().map(|(name, &steps)| (format!("adam_steps.{name}"), steps));
        let census = self.counts.iter().flat_map(|counts| {
            let DensifyCounts { added, pruned, relocated, resets } = *counts;
            [
                ("census.added", added),
                ("census.pruned", pruned),
                ("census.relocated", relocated),
                ("census.resets", resets),
            ]
        });
        let BadSteps { total, in_a_row } = self.bad_steps;
        let named = [
            ("completed", self.completed),
            ("refreshes", self.refreshes),
            ("bad_steps.total", total),
            ("bad_steps.in_a_row", in_a_row),
        ];
        let named = named.into_iter().chain(census);
        let mut counts = named.map(|(name, count)| (name.to_owned(), count)).chain(adam);
        match counts.find(|&(_, count)| count as u64 > MOST) {
            Some((name, count)) => Err(format!("`{name}` is {count}: no run counts that far")),
            None => Ok(()),
        }
    }
}

/// A normaliser has no columns before its first update, then always `columns`.
fn check_normaliser(name: &str, normaliser: &MovingNormaliser, columns: usize) -> Result<(), String> {
    let MovingNormaliser { means, variances } = normaliser;
    if means.len() != variances.len() || ![0, columns].contains(&means.len()) {
        let (means, variances) = (means.len(), variances.len());
        return Err(format!("`normalisers.{name}` has {means} means and {variances} variances instead of {columns}"));
    }
    match variances.iter().find(|&&variance| variance < 0.0) {
        Some(variance) => Err(format!("`normalisers.{name}` has the variance {variance}")),
        None => Ok(()),
    }
}

/// The first numbers of a list, for a message.
fn shortened(numbers: &[f64]) -> String {
    const SHOWN: usize = 8;
    let rest = if numbers.len() > SHOWN { ", …" } else { "" };
    let shown: Vec<String> = numbers.iter().take(SHOWN).map(f64::to_string).collect();
    format!("[{}{rest}]", shown.join(", "))
}
