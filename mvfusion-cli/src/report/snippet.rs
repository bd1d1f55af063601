//! Small parts of the page that several sections share.

use maud::{Markup, html};

use super::files::Missing;

/// A sentence in place of a missing part.
pub(super) fn notice(missing: &Missing) -> Markup {
    html! { p.missing { (missing) } }
}

/// A metric with this number of decimals. A value that is not finite, as for a perfect render, becomes words.
pub(super) fn number(value: f64, decimals: usize) -> String {
    match value.is_finite() {
        true => format!("{value:.decimals$}"),
        false => "not finite".to_owned(),
    }
}
