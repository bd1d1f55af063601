//! Small pieces of the page that several sections share.

use maud::{Markup, html};

use super::files::Missing;

/// A sentence in place of something that is missing.
pub(super) fn notice(missing: &Missing) -> Markup {
    html! { p.missing { (missing) } }
}

/// A metric with so many decimals. A value that is not finite, as for a perfect picture, becomes words.
pub(super) fn number(value: f64, decimals: usize) -> String {
    match value.is_finite() {
        true => format!("{value:.decimals$}"),
        false => "not finite".to_owned(),
    }
}
