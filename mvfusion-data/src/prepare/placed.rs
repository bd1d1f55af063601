//! Which images COLMAP placed, for the user and for the record.

use std::path::Path;

use serde::Serialize;

use super::colmap::MadeModel;
use super::error::PrepareError;
use super::event::{Listener, Tell};

/// Number of names that a message lists.
const MOST_NAMES: usize = 12;

/// Which images COLMAP placed.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Placed {
    /// Number of all images.
    pub total: usize,
    /// Those in the model that was used, sorted by name.
    pub placed: Vec<String>,
    /// The others.
    pub unplaced: Vec<String>,
    /// Number of the model that was used.
    pub model: usize,
    /// Number of its points.
    pub points: usize,
    /// All models in words, if there are several.
    pub models: Vec<String>,
}

impl Placed {
    /// What the model at a place among all models says of all images.
    pub(super) fn of(names: &[String], models: &[MadeModel], place: usize) -> Self {
        let model = &models[place];
        let (placed, unplaced) = names.iter().cloned().partition(|name| model.images.contains(name));
        let several: Vec<String> = models.iter().map(MadeModel::describe).collect();
        Self {
            total: names.len(),
            placed,
            unplaced,
            model: model.number,
            points: model.points,
            models: if several.len() > 1 { several } else { Vec::new() },
        }
    }

    /// Tells the user, with what helps if images are missing.
    ///
    /// # Errors
    /// If the listener ends the preparation.
    pub(super) fn tell(&self, what: &str, help: &str, listen: &mut Listener<'_>) -> Result<(), PrepareError> {
        let (placed, total) = (self.placed.len(), self.total);
        listen.note(format!("COLMAP placed {placed} of {total} {what}, with {} points", self.points))?;
        if !self.models.is_empty() {
            listen.note(format!(
                "COLMAP made {} models that it cannot join: {}. Model {} is used; --model N uses another one",
                self.models.len(),
                self.models.join(", "),
                self.model
            ))?;
        }
        if !self.unplaced.is_empty() {
            let (failed, names) = (self.unplaced.len(), listed(&self.unplaced));
            listen.note(format!("{failed} of {total} {what} were not placed: {names}. {help}"))?;
        }
        Ok(())
    }
}

/// The error of a run that placed too few images.
pub(super) fn unplaced(
    names: &[String],
    placed: &[String],
    what: &'static str,
    help: &str,
    log: &Path,
) -> PrepareError {
    let failed: Vec<String> = names.iter().filter(|name| !placed.contains(name)).cloned().collect();
    PrepareError::Unplaced {
        placed: placed.len(),
        total: names.len(),
        failed: failed.len(),
        what,
        names: listed(&failed),
        help: help.to_owned(),
        log: log.to_owned(),
    }
}

/// The first names, and how many more there are.
fn listed(names: &[String]) -> String {
    let shown = names.iter().take(MOST_NAMES).cloned().collect::<Vec<_>>().join(", ");
    match names.len().saturating_sub(MOST_NAMES) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}
