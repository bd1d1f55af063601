//! A problem with a scene, and its remedy.

use serde::Serialize;

/// A problem with a scene.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Problem {
    /// Its severity.
    pub severity: Severity,
    /// Its subject.
    pub subject: Subject,
    /// The finding, with names and numbers: a sentence without its full stop. A list may follow, one entry per line.
    pub what: String,
    /// The remedy: one or more sentences.
    pub remedy: String,
}

/// Severity of a problem, the worst first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Training cannot start, or will stop.
    Error,
    /// Training runs, but the result is likely to be wrong or poor.
    Warning,
    /// Worth knowing, but may be intended.
    Note,
}

/// The subject of a problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Subject {
    /// A folder or file that cannot be read.
    Reading,
    /// The images.
    Pictures,
    /// The size of the images.
    Size,
    /// The masks.
    Masks,
    /// The split into training and held-out views.
    Split,
    /// Lenses and positions of the cameras.
    Cameras,
    /// Directions of the cameras, and the match of images to poses.
    Poses,
    /// The initial points.
    Points,
    /// The times of the views.
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

/// The first names, and how many more there are.
pub(super) fn few(names: &[&str]) -> String {
    const SHOWN: usize = 3;
    let shown = names[..names.len().min(SHOWN)].join(", ");
    match names.len().saturating_sub(SHOWN) {
        0 => shown,
        more => format!("{shown} and {more} more"),
    }
}

/// A number with its noun: `1 image`, `3 images`.
pub(super) fn count(number: usize, thing: &str) -> String {
    if number == 1 { format!("1 {thing}") } else { format!("{number} {thing}s") }
}

/// A fraction as percent.
pub(super) fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent > 0.0 && percent < 1.0 { format!("{percent:.1} %") } else { format!("{percent:.0} %") }
}

/// The median; `None` without values. For an even number, it is the upper middle value.
pub(super) fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}
