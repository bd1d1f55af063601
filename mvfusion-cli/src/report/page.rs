//! The page: its frame, and the order of its sections.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sha2::{Digest, Sha256};

use super::album::Album;
use super::files::RunFiles;
use super::film::{self, Film};
use super::picture::QUALITY;
use super::{head, images, modules, record, rig, scores, training};

const STYLE: &str = include_str!("report.css");
const SCRIPT: &str = include_str!("report.js");

/// The end of the title of every report, by which one is known.
pub(super) const MARK: &str = " \u{2013} MVFusion-GS</title>";

/// A section.
struct Section {
    /// Target of links.
    anchor: &'static str,
    /// Its heading, also shown in the navigation.
    title: &'static str,
    /// Its contents.
    body: fn(&RunFiles, &Album, &Film) -> Markup,
}

/// The sections, in their order.
const SECTIONS: [Section; 10] = [
    Section { anchor: "metrics", title: "Metrics", body: |files, _, _| scores::scores(files) },
    Section { anchor: "training", title: "Training", body: |files, _, _| training::training(files) },
    Section { anchor: "film", title: "Over time", body: |files, _, film| film::section(files, film) },
    Section { anchor: "sliders", title: "Comparison", body: |files, album, _| images::sliders(files, album) },
    Section { anchor: "layers", title: "Branch decomposition", body: |files, album, _| images::layers(files, album) },
    Section { anchor: "motion", title: "Motion", body: |files, album, _| images::heat_maps(files, album) },
    Section { anchor: "cameras", title: "Cameras", body: |files, _, _| rig::rig(files) },
    Section { anchor: "modules", title: "MVG and MFTA", body: |files, _, _| modules::modules(files) },
    Section { anchor: "record", title: "Record", body: |files, _, _| record::record(files) },
    Section { anchor: "config", title: "Configuration", body: |files, _, _| record::config(files) },
];

impl Section {
    /// Its title, as a link to it.
    fn link(&self) -> Markup {
        html! { a href=(format!("#{}", self.anchor)) { (self.title) } }
    }

    fn draw(&self, files: &RunFiles, album: &Album, film: &Film) -> Markup {
        let body = (self.body)(files, album, film);
        html! { section id=(self.anchor) { h2 { (self.link()) } (body) } }
    }
}

/// The whole page.
pub(super) fn page(files: &RunFiles, album: &Album, film: &Film) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy());
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                title { (head::title(files)) " \u{2013} MVFusion-GS" }
                // Browsers would request an icon otherwise.
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) }
            }
            body {
                (head::head(files))
                nav { @for section in &SECTIONS { (section.link()) } }
                main {
                    (head::headline(files))
                    @for section in &SECTIONS { (section.draw(files, album, film)) }
                }
                (foot(album, film))
                script { (PreEscaped(SCRIPT)) }
            }
        }
    }
}

/// The security policy: the page may show its own images and run its own script, identified by its hash. Inline styles
/// are allowed, because the sliders use them.
fn policy() -> String {
    let hash = STANDARD.encode(Sha256::digest(SCRIPT));
    format!(
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{hash}'; base-uri 'none'; \
         form-action 'none'"
    )
}

fn foot(album: &Album, film: &Film) -> Markup {
    let shown = album.views.len().max(album.strips.len());
    html! {
        footer {
            p {
                "Created by mvfusion " (env!("CARGO_PKG_VERSION")) " from the files of the run folder. "
                "This page needs no other file and no network. "
                @if shown > 0 {
                    "It shows " (shown) " of the " (album.in_folder) " held-out views with images. Small images are \
                    embedded unchanged, others as JPEG (quality " (QUALITY) ", at most " (album.widest) " pixels \
                    wide). "
                }
                @if !film.frames.is_empty() {
                    "The film has " (film.frames.len()) " smaller views. "
                }
                @if shown + film.frames.len() > 0 { "The metrics were computed on the original images." }
            }
        }
    }
}
