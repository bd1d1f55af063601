//! The page: its frame, and the order of its sections.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

use super::album::Album;
use super::files::{Lack, RunFiles};
use super::picture::QUALITY;
use super::{figures, head, record, scores, training};

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// The sections, by anchor and name, in their order.
const SECTIONS: [(&str, &str); 7] = [
    ("figures", "Figures"),
    ("training", "Training"),
    ("sliders", "Before and after"),
    ("layers", "Branches"),
    ("motion", "Motion"),
    ("record", "Record"),
    ("config", "Configuration"),
];

/// The whole page.
pub(super) fn page(files: &RunFiles, album: &Album) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy());
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (head::title(files)) " \u{2013} MVFusion-GS" }
                // The icon that browsers would ask for otherwise.
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) }
            }
            body {
                (head::head(files))
                nav { @for (anchor, name) in SECTIONS { a href=(format!("#{anchor}")) { (name) } } }
                main {
                    (head::headline(files))
                    (scores::scores(files))
                    (training::training(files))
                    (figures::sliders(files, album))
                    (figures::layers(files, album))
                    (figures::heat_maps(files, album))
                    (record::record(files))
                    (record::config(files))
                }
                (foot(album))
                script { (PreEscaped(SCRIPT)) }
            }
        }
    }
}

/// What the page may do: show what is in it, and run its own script, known by its hash. Styles may be inline, as
/// those of the sliders are.
fn policy() -> String {
    let hash = STANDARD.encode(Sha256::digest(SCRIPT));
    format!(
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{hash}'; base-uri 'none'; \
         form-action 'none'"
    )
}

/// A section with an anchor.
pub(super) fn section(anchor: &str, title: &str, body: Markup) -> Markup {
    html! { section id=(anchor) { h2 { a href=(format!("#{anchor}")) { (title) } } (body) } }
}

/// What is said in place of something that is missing.
pub(super) fn lack(lack: &Lack) -> Markup {
    html! { p.lack { (lack) } }
}

fn foot(album: &Album) -> Markup {
    let shown = album.views.len().max(album.strips.len());
    html! {
        footer {
            p {
                "Made by mvfusion " (env!("CARGO_PKG_VERSION")) " from the files of the run\u{2019}s folder. "
                "This page needs no other file and no network. "
                @if shown > 0 {
                    "It shows " (shown) " of the " (album.in_folder) " held-out views with pictures: small ones as \
                    they were written, others as JPEG (quality " (QUALITY) ", at most " (album.widest) " pixels \
                    wide). Figures were computed before that, on the originals."
                }
            }
        }
    }
}
