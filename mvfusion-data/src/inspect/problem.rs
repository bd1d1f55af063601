//! What is wrong with a scene, and what to do about it.

use serde::Serialize;

/// Something about a scene that its owner should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// How bad it is.
    pub severity: Severity,
    /// What it is about.
    pub subject: Subject,
    /// What was found, with names and numbers; a sentence without its full stop. A list may follow, a line each.
    pub what: String,
    /// What to do about it; one or more sentences.
    pub remedy: String,
}

/// How bad a problem is, the worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Training cannot start, or would stop on the way.
    Error,
    /// Training runs, but what it learns is likely to be wrong or poor.
    Warning,
    /// Worth knowing; may well be meant so.
    Note,
}

/// What a problem is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Subject {
    /// The folder or a file of it cannot be read.
    Reading,
    /// The pictures.
    Pictures,
    /// The size of the pictures.
    Size,
    /// The masks.
    Masks,
    /// What trains and what is held out.
    Split,
    /// Lenses and places of the cameras.
    Cameras,
    /// Directions of the cameras, and which picture belongs to which.
    Poses,
    /// The points to start from.
    Points,
    /// The moments of the views.
    Times,
}

impl Problem {
    pub(super) fn error(subject: Subject, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { severity: Severity::Error, subject, what: what.into(), remedy: remedy.into() }
    }

    pub(super) fn warning(subject: Subject, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { severity: Severity::Warning, ..Self::error(subject, what, remedy) }
    }

    pub(super) fn note(subject: Subject, what: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self { severity: Severity::Note, ..Self::error(subject, what, remedy) }
    }
}

/// A few names, and how many more there are.
pub(super) fn few(names: &[&str]) -> String {
    const SHOWN: usize = 3;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// So many things: `1 picture`, `3 pictures`.
pub(super) fn count(number: usize, thing: &str) -> String {
    if number == 1 { format!("1 {thing}") } else { format!("{number} {thing}s") }
}

/// A share as percent.
pub(super) fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent > 0.0 && percent < 1.0 { format!("{percent:.1} %") } else { format!("{percent:.0} %") }
}

/// The number in the middle; `None` if there is none. The upper one of an even number.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
