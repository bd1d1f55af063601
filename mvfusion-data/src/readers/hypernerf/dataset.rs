//! The lists of a capture: `dataset.json` has its image names and their split, `metadata.json` has their times.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use serde::Deserialize;
use tracing::warn;

use crate::error::DataError;
use crate::files::{COPY_OR_MEND, below, read_json};

pub(super) const DATASET: &str = "dataset.json";
pub(super) const METADATA: &str = "metadata.json";

/// `dataset.json`.
#[derive(Debug, Deserialize)]
struct Dataset {
    #[serde(default)]
    ids: Vec<Id>,
    #[serde(default)]
    train_ids: Vec<Id>,
    #[serde(default)]
    val_ids: Vec<Id>,
}

/// The name of an image. Some tools write numbers.
#[derive(Debug, Deserialize)]
#[serde(untagged, expecting = "an image's id is neither a text nor a whole number")]
enum Id {
    Text(String),
    Number(u64),
}

/// An entry of `metadata.json`.
#[derive(Debug, Deserialize)]
struct Moment {
    warp_id: u32,
}

/// The purpose of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Train,
    Test,
}

/// The names of all images, and the part that each belongs to.
pub(super) fn parts(path: &Path) -> Result<(Vec<String>, Vec<Option<Part>>), DataError> {
    let dataset: Dataset = read_json(path, COPY_OR_MEND)?;
    let fail = |reason: String| DataError::Content { path: path.to_owned(), reason, advice: COPY_OR_MEND };
    let names = |ids: Vec<Id>| -> Vec<String> {
        let name = |id| match id {
            Id::Text(text) => text,
            Id::Number(number) => number.to_string(),
        };
        ids.into_iter().map(name).collect()
    };
    let (mut ids, train, val) = (names(dataset.ids), names(dataset.train_ids), names(dataset.val_ids));
    if ids.is_empty() {
        ids = train.iter().chain(&val).cloned().collect();
    }
    let mut known = BTreeSet::new();
    for id in &ids {
        // The name becomes a part of paths.
        below(Path::new(""), id).map_err(|reason| fail(format!("the id `{id}` is no name: {reason}")))?;
        if !known.insert(id.as_str()) {
            return Err(fail(format!("it lists the id {id} twice")));
        }
    }
    if val.is_empty() {
        let parts = by_position(ids.len());
        return Ok((ids, parts));
    }
    let (train, val): (BTreeSet<_>, BTreeSet<_>) = (train.into_iter().collect(), val.into_iter().collect());
    if let Some(id) = train.iter().chain(&val).find(|id| !known.contains(id.as_str())) {
        return Err(fail(format!("`train_ids` or `val_ids` names {id}, which is not among `ids`")));
    }
    let both = train.intersection(&val).count();
    if both > 0 {
        warn!(file = %path.display(), "{both} images are in train_ids and in val_ids: they are held out");
    }
    let part = |id: &String| match (val.contains(id), train.contains(id)) {
        (true, _) => Some(Part::Test),
        (false, true) => Some(Part::Train),
        (false, false) => None,
    };
    let parts = ids.iter().map(part).collect();
    Ok((ids, parts))
}

/// The split if no image is held out by name.
pub(super) fn by_position(count: usize) -> Vec<Option<Part>> {
    let last = count.saturating_sub(1) / 4;
    let part = |index: usize| match index % 4 {
        0 => Some(Part::Train),
        2 if index / 4 < last => Some(Part::Test),
        _ => None,
    };
    (0..count).map(part).collect()
}

/// The times of the images.
pub(super) fn times(path: &Path, ids: &[String]) -> Result<Vec<f64>, DataError> {
    let moments: BTreeMap<String, Moment> = read_json(path, COPY_OR_MEND)?;
    let warp = |id: &String| {
        moments.get(id).map(|moment| f64::from(moment.warp_id)).ok_or_else(|| DataError::Content {
            path: path.to_owned(),
            reason: format!("it has no entry for the image {id} of {DATASET}"),
            advice: COPY_OR_MEND,
        })
    };
    let warps: Vec<f64> = ids.iter().map(warp).collect::<Result<_, _>>()?;
    let largest = warps.iter().copied().fold(1.0, f64::max);
    Ok(warps.into_iter().map(|warp| warp / largest).collect())
}
