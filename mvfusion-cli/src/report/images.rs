//! The sections of the pictures: sliders, branch decomposition, heat maps. Each picture stands in the page once; where
//! it is shown again, the script copies it (`data-copy`).

use maud::{Markup, html};
use mvfusion_model::evaluation::Layer;

use super::album::{Album, AlbumView, ViewPicture, without_layers};
use super::files::{Found, RunFiles};
use super::picture::Embedded;
use super::snippet::notice;
use crate::run::PictureKind;

/// What a slider shows at first, left and right.
const PAIR: [PictureKind; 2] = [PictureKind::GroundTruth, PictureKind::Model(Layer::Composed)];

/// Where a slider stands at first, per cent.
const START: u32 = 50;

/// A slider for each view, between any two of its layers.
pub(super) fn sliders(files: &RunFiles, album: &Album) -> Markup {
    html! {
        @if album.views.is_empty() {
            (notice(&without_layers(files)))
        } @else {
            p.note.script {
                "Drag over a picture, or use the arrow keys. Left and right can be any two layers; ground truth \
                beside the static branch shows what was taken away."
            }
            noscript { p.missing { "The sliders need JavaScript; all pictures stand below as well." } }
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
    // Where one of the pair is missing, the first two that are known.
    let [left, right] = match chosen {
        [Some(left), Some(right)] => [left, right],
        _ => [0, 1],
    };
    html! {
        metric.slider.script style=(format!("--at: {START}%")) {
            div.stack style=(format!("aspect-ratio: {width} / {height}")) {
                img.left data-copy=(id(view, there[left])) alt=(format!("{}, left of the line", view.name));
                img.right data-copy=(id(view, there[right])) alt=(format!("{}, right of the line", view.name));
                input type="range" min="0" max="100" step="0.5" value=(START)
                    aria-label=(format!("where the two pictures of {} meet", view.name));
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
        select data-side=(side) autocomplete="off" aria-label=(format!("picture on the {side}")) {
            @for (index, shown) in there.iter().enumerate() {
                option value=(id(view, shown)) selected[index == chosen] { (shown.kind.label()) }
            }
        }
    }
}

/// The id of a picture in the page; nothing in it comes from a file.
fn id(view: &AlbumView, shown: &ViewPicture) -> String {
    format!("v{}-{}", view.number, shown.kind.folder())
}

/// Every view in all its layers; the strips where there are none.
pub(super) fn layers(files: &RunFiles, album: &Album) -> Markup {
    html! {
        @if album.views.is_empty() && album.strips.is_empty() {
            (notice(&without_layers(files)))
        } @else if album.views.is_empty() {
            p.note {
                "As the run has no layers, its strips: from left to right ground truth and composed picture, then as \
                far as the model has them static branch, dynamic branch, mask and motion intensity."
            }
            @for (name, strip) in &album.strips { metric.strip { figcaption { (name) } (picture(strip, None, name)) } }
        } @else {
            @if shows(album, PictureKind::Model(Layer::Mask)) {
                p.note {
                    "Composed = mask \u{00b7} dynamic branch + (1 \u{2212} mask) \u{00b7} static branch under the \
                    learned brightness. White in the mask is dynamic."
                    @if shows(album, PictureKind::Model(Layer::MaskedStatic)) {
                        " Masked static and masked dynamic are the two terms of this sum."
                    }
                    @if shows(album, PictureKind::TrueBackground) { " The scene\u{2019}s true background is known." }
                }
            }
            p.note.script { "A click on a picture shows it large." }
            @for view in &album.views { (row(view, &view.images)) }
        }
    }
}

/// Whether any view has a picture of this kind.
fn shows(album: &Album, kind: PictureKind) -> bool {
    album.views.iter().flat_map(|view| &view.images).any(|shown| shown.kind == kind)
}

/// The heat maps of every view, beside its photo.
pub(super) fn heat_maps(files: &RunFiles, album: &Album) -> Markup {
    let mapped: Vec<&AlbumView> = album.views.iter().filter(|view| !view.heat_maps.is_empty()).collect();
    html! {
        @if mapped.is_empty() {
            p.missing {
                @if album.views.is_empty() { (without_layers(files)) }
                @else {
                    "The run has no heat maps: motion is measured by models with motion-aware refinement, in its stage."
                }
            }
        } @else {
            p.note {
                "How much each dynamic Gaussian changes over time, splatted into the view; the intensity is the \
                weighted sum of the variances of position, rotation and scale. White is the 0.98 quantile over \
                all Gaussians; the scale is the square root, so that faint motion is seen as well. Each map has a \
                scale of its own."
            }
            (colour_bar())
            // One map beside each photo leaves room for another view.
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
            div.row {
                @if let Some(photo) = photo {
                    metric.script {
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
    html! { div.view { h3 { (view.name) } div.row { (cells(view, pictures)) } } }
}

fn cells(view: &AlbumView, pictures: &[ViewPicture]) -> Markup {
    html! {
        @for shown in pictures {
            metric {
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

/// The colours of the heat maps: black, red, yellow and white in equal steps, as `clamp(3 v - k)` gives them.
fn colour_bar() -> Markup {
    html! {
        div.colours role="img" aria-label="colours from black (none) over red and yellow to white (0.98 quantile)" {
            svg viewBox="0 0 400 34" {
                defs {
                    linearGradient id="heat" {
                        @for (offset, colour) in STOPS {
                            stop offset=(offset) stop-color=(colour) {}
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
            span.note { "share of the 0.98 quantile" }
        }
    }
}

/// Where the colour bar has which colour.
const STOPS: [(&str, &str); 4] = [("0", "#000"), ("33.33%", "#f00"), ("66.67%", "#ff0"), ("100%", "#fff")];

/// Values that are marked on the colour bar.
const SHARES: [(f64, &str); 5] = [(0.0, "0"), (0.05, "0.05"), (0.25, "0.25"), (0.5, "0.5"), (1.0, "1")];

fn anchor(share: f64) -> &'static str {
    match share {
        0.0 => "start",
        1.0 => "end",
        _ => "middle",
    }
}
