//! The sections with single views: sliders, branch decomposition, heat maps. The page contains each image once. The
//! script copies it to other places (`data-copy`).

use maud::{Markup, html};
use mvfusion_model::evaluation::{Layer, heat_colours};

use super::album::{Album, AlbumView, ViewPicture, without_layers};
use super::files::{Found, RunFiles};
use super::picture::Embedded;
use super::snippet::notice;
use crate::run::PictureKind;

/// The initial images of a slider, left and right.
const PAIR: [PictureKind; 2] = [PictureKind::GroundTruth, PictureKind::Model(Layer::Composed)];

/// Maximum number of tiles side by side.
const MOST_COLUMNS: usize = 6;

/// Initial position of a slider in per cent.
const START: u32 = 50;

/// One slider per view, between any two of its layers.
pub(super) fn sliders(files: &RunFiles, album: &Album) -> Markup {
    html! {
        @if album.views.is_empty() {
            (notice(&without_layers(files)))
        } @else {
            p.note.script {
                "Drag over an image, or use the arrow keys. Any two layers can be compared. The ground truth next to \
                the static branch shows what was removed."
            }
            noscript { p.missing { "The sliders need JavaScript. All images are also shown below." } }
            div.sliders { @for view in &album.views { (slider(view)) } }
        }
    }
}

fn slider(view: &AlbumView) -> Markup {
    let there: Vec<&ViewPicture> = view.images.iter().filter(|shown| shown.picture.is_ok()).collect();
    let size =
        there.iter().find_map(|shown| shown.picture.as_ref().ok()).map(|picture| (picture.width, picture.height));
    let Some((width, height)) = size.filter(|_| there.len() > 1) else { return html! {} };
    let chosen = PAIR.map(|kind| there.iter().position(|shown| shown.kind == kind));
    // If one of the pair is missing, use the first two layers.
    let [left, right] = match chosen {
        [Some(left), Some(right)] => [left, right],
        _ => [0, 1],
    };
    html! {
        figure.slider.script style=(format!("--at: {START}%")) {
            div.stack style=(format!("aspect-ratio: {width} / {height}")) {
                img.left data-copy=(id(view, there[left])) alt=(format!("{}, left of the line", view.name));
                img.right data-copy=(id(view, there[right])) alt=(format!("{}, right of the line", view.name));
                input type="range" min="0" max="100" step="0.5" value=(START)
                    aria-label=(format!("boundary between the two images of {}", view.name));
                span.line {}
            }
            figcaption {
                (choice(view, &there, left, "left"))
                span.view { (view.name) }
                (choice(view, &there, right, "right"))
            }
        }
    }
}

fn choice(view: &AlbumView, there: &[&ViewPicture], chosen: usize, side: &str) -> Markup {
    html! {
        select data-side=(side) autocomplete="off" aria-label=(format!("image on the {side}")) {
            @for (index, shown) in there.iter().enumerate() {
                option value=(id(view, shown)) selected[index == chosen] { (shown.kind.label()) }
            }
        }
    }
}

/// The id of an image in the page. It contains no text from a file.
fn id(view: &AlbumView, shown: &ViewPicture) -> String {
    format!("v{}-{}", view.number, shown.kind.folder())
}

/// Every view in all its layers, or the strips if there are no layers.
pub(super) fn layers(files: &RunFiles, album: &Album) -> Markup {
    html! {
        @if album.views.is_empty() && album.strips.is_empty() {
            (notice(&without_layers(files)))
        } @else if album.views.is_empty() {
            p.note {
                "The run has no layers, so its strips are shown."
                @if files.panels.is_none() {
                    " From left to right: ground truth and composed render, then static branch, dynamic branch, mask \
                    and motion intensity if the model has them."
                }
            }
            @for (name, strip) in &album.strips { (captioned(name, strip, files.panels.as_deref())) }
        } @else {
            @if shows(album, PictureKind::Model(Layer::Mask)) {
                p.note {
                    "Composed = mask \u{00b7} dynamic branch + (1 \u{2212} mask) \u{00b7} static branch, with the \
                    learned brightness applied to the static branch. White in the mask means dynamic."
                    @if shows(album, PictureKind::Model(Layer::MaskedStatic)) {
                        " Masked static and masked dynamic are the two terms of this sum."
                    }
                    @if shows(album, PictureKind::TrueBackground) { " The scene provides the true background." }
                }
            }
            @if shows(album, PictureKind::Model(Layer::Depth)) {
                p.note {
                    "Depth is shown by its inverse: near is white, far is black, and so is empty space. All views have \
                    the scale of the first one, from its 2 % to its 98 % quantile."
                }
            }
            p.note.script { "Click an image to enlarge it." }
            @for view in &album.views { (row(view, &view.images)) }
        }
    }
}

/// A strip with the captions of its panels, each above its own.
fn captioned(name: &str, strip: &Found<Embedded>, panels: Option<&[String]>) -> Markup {
    html! {
        figure.strip {
            figcaption { (name) }
            div.panels {
                @if let (Some(panels), Ok(_)) = (panels, strip) {
                    div.captions { @for panel in panels { span { (panel) } } }
                }
                (picture(strip, None, name))
            }
        }
    }
}

/// Whether any view has an image of this kind.
fn shows(album: &Album, kind: PictureKind) -> bool {
    album.views.iter().flat_map(|view| &view.images).any(|shown| shown.kind == kind)
}

/// The heat maps of every view, next to its photo.
pub(super) fn heat_maps(files: &RunFiles, album: &Album) -> Markup {
    let mapped: Vec<&AlbumView> = album.views.iter().filter(|view| !view.heat_maps.is_empty()).collect();
    html! {
        @if mapped.is_empty() {
            p.missing {
                @if album.views.is_empty() { (without_layers(files)) }
                @else {
                    "The run has no heat maps. Only the refinement stage of models with motion-aware refinement \
                    measures motion."
                }
            }
        } @else {
            p.note {
                "The maps show how much each dynamic Gaussian changes over time, splatted into the view. The \
                intensity is the weighted sum of the variances of position, rotation and scale. The brightest \
                colour is the 0.98 quantile over all Gaussians. The scale is the square root, so that faint motion is \
                visible. Each map has its own scale."
            }
            (colour_bar())
            // With one map per photo, two views fit side by side.
            @let few = mapped.iter().all(|view| view.heat_maps.len() == 1);
            div class=(if few { "pairs" } else { "" }) { @for view in mapped { (row_beside_photo(view)) } }
        }
    }
}

fn row_beside_photo(view: &AlbumView) -> Markup {
    let photo = view.images.iter().find(|shown| shown.kind == PAIR[0] && shown.picture.is_ok());
    html! {
        div.view {
            h3 { (view.name) }
            div.row style=(format!("--columns: {}", columns(view.heat_maps.len() + usize::from(photo.is_some())))) {
                @if let Some(photo) = photo {
                    figure.script {
                        img data-copy=(id(view, photo)) alt=(format!("{}, {}", view.name, photo.kind.label()));
                        figcaption { (photo.kind.label()) }
                    }
                }
                (cells(view, &view.heat_maps))
            }
        }
    }
}

fn row(view: &AlbumView, pictures: &[ViewPicture]) -> Markup {
    let columns = columns(pictures.len());
    html! {
        div.view { h3 { (view.name) } div.row style=(format!("--columns: {columns}")) { (cells(view, pictures)) } }
    }
}

/// Columns of this many equal tiles, so that the rows are as full as they can be: nine are five and four, not eight and
/// one.
fn columns(tiles: usize) -> usize {
    tiles.div_ceil(tiles.div_ceil(MOST_COLUMNS).max(1)).max(1)
}

fn cells(view: &AlbumView, pictures: &[ViewPicture]) -> Markup {
    html! {
        @for shown in pictures {
            figure {
                (picture(&shown.picture, Some(&id(view, shown)), &format!("{}, {}", view.name, shown.kind.label())))
                figcaption { (shown.kind.label()) }
            }
        }
    }
}

fn picture(found: &Found<Embedded>, id: Option<&str>, alt: &str) -> Markup {
    match found {
        Ok(picture) => html! {
            img id=[id] src=(picture.uri) width=(picture.width) height=(picture.height) alt=(alt);
        },
        Err(missing) => notice(missing),
    }
}

/// The colours of the heat maps, from nothing to the 0.98 quantile.
fn colour_bar() -> Markup {
    html! {
        div.colours role="img"
            aria-label="colours from black (none) through purple and orange to pale yellow (0.98 quantile)" {
            svg viewBox="0 0 400 34" {
                defs {
                    linearGradient id="heat" {
                        @for (index, colour) in heat_colours(COLOURS).into_iter().enumerate() {
                            @let [r, g, b] = colour;
                            stop offset=(format!("{:.1}%", 100.0 * index as f64 / (COLOURS - 1) as f64))
                                stop-color=(format!("#{r:02x}{g:02x}{b:02x}")) {}
                        }
                    }
                }
                rect x="1" y="1" width="398" height="14" fill="url(#heat)" stroke="currentColor" stroke-opacity="0.4" {}
                @for (share, label) in SHARES {
                    @let x = 1.0 + 398.0 * f64::sqrt(share);
                    line.axis x1=(x) x2=(x) y1="15" y2="19" {}
                    text.tick x=(x) y="30" text-anchor=(anchor(share)) { (label) }
                }
            }
            span.note { "fraction of the 0.98 quantile" }
        }
    }
}

/// Number of colours of the colour bar, between which a browser interpolates.
const COLOURS: usize = 17;

/// Values marked on the colour bar.
const SHARES: [(f64, &str); 5] = [(0.0, "0"), (0.05, "0.05"), (0.25, "0.25"), (0.5, "0.5"), (1.0, "1")];

fn anchor(share: f64) -> &'static str {
    match share {
        0.0 => "start",
        1.0 => "end",
        _ => "middle",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_spread_over_rows_of_nearly_equal_length() {
        assert_eq!([1, 4, 6, 7, 9, 10, 12, 13].map(columns), [1, 4, 6, 4, 5, 5, 6, 5]);
        assert_eq!(columns(0), 1);
    }
}
