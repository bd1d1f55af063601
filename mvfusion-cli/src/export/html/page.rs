//! The HTML file: the player, the description of the scene, and its Gaussians.

use anyhow::Context;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use maud::{DOCTYPE, PreEscaped, html};
use sha2::{Digest, Sha256};

use super::scene::SceneDescription;

const STYLE: &str = include_str!("player/player.css");
/// The script, in the order of use. Its parts share one scope.
const SCRIPT: &str = concat!(
    include_str!("player/decode.js"),
    include_str!("player/camera.js"),
    include_str!("player/gpu.js"),
    include_str!("player/renderer.js"),
    include_str!("player/controls.js"),
    include_str!("player/address.js"),
    include_str!("player/main.js"),
);
/// The script of the worker that sorts.
const SORTER: &str = include_str!("player/sorter.js");
/// The shaders, by the names under which the script finds them.
const SHADERS: [(&str, &str); 4] = [
    ("splat-vertex", include_str!("player/splat.vert.glsl")),
    ("splat-fragment", include_str!("player/splat.frag.glsl")),
    ("blend-vertex", include_str!("player/blend.vert.glsl")),
    ("blend-fragment", include_str!("player/blend.frag.glsl")),
];

/// Speeds to choose from, and what they are called.
const SPEEDS: [(&str, &str); 4] =
    [("0.25", "\u{bc}\u{d7}"), ("0.5", "\u{bd}\u{d7}"), ("1", "1\u{d7}"), ("2", "2\u{d7}")];

/// What the pages of this program contain, of any version.
pub(super) const MARK: &str = r#"<meta name="generator" content="mvfusion "#;

/// The page of a scene with these compressed Gaussians.
pub(super) fn page(scene: &SceneDescription, gaussians: &[u8]) -> anyhow::Result<String> {
    // `<` could end the element; JSON has another way to write it.
    let description = serde_json::to_string(scene).context("cannot describe the scene")?.replace('<', "\\u003c");
    let markup = html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta http-equiv="Content-Security-Policy" content=(policy());
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta name="generator" content=(concat!("mvfusion ", env!("CARGO_PKG_VERSION")));
                title { (scene.title) }
                // Browsers would request an icon otherwise.
                link rel="icon" href="data:,";
                style { (PreEscaped(STYLE)) }
            }
            body {
                canvas id="view" tabindex="0" role="img" aria-label=(scene.title) {}
                p id="message" role="status" { "Loading \u{2026}" }
                noscript { p class="error" { "This page needs JavaScript to show the scene." } }
                (controls())
                script type="application/json" id="scene" { (PreEscaped(description)) }
                script type="text/plain" id="gaussians" { (PreEscaped(STANDARD.encode(gaussians))) }
                @for (name, source) in SHADERS {
                    script type="x-shader/glsl" id=(name) { (PreEscaped(source)) }
                }
                script type="text/plain" id="sorter" { (PreEscaped(SORTER)) }
                script type="module" { (PreEscaped(SCRIPT)) }
            }
        }
    };
    Ok(markup.into_string())
}

/// The controls below the image.
fn controls() -> maud::Markup {
    html! {
        form id="controls" hidden autocomplete="off" {
            button type="button" name="play" aria-label="Play" title="Play or pause (space)" { "\u{25b6}" }
            input type="range" name="time" min="0" max="1" step="any" value="0" aria-label="Time" title="Time";
            output name="shown" {}
            label title="Speed" {
                select name="speed" aria-label="Speed" {
                    @for (value, text) in SPEEDS {
                        option value=(value) selected[value == "1"] { (text) }
                    }
                }
            }
            label title="Begin again at the end" { input type="checkbox" name="loop" checked; "loop" }
            label title="Jump to a camera" { select name="camera" aria-label="Camera" { option value="" { "camera" } } }
            label title="Layer" {
                select name="layer" aria-label="Layer" {
                    @for layer in ["composed", "static", "dynamic", "mask"] { option value=(layer) { (layer) } }
                }
            }
            button type="button" name="reset" title="First camera (R)" { "reset" }
            button type="button" name="full" title="Full screen (F)" { "full" }
        }
    }
}

/// The security policy: the page may run its own script, identified by its hash, and workers that it makes itself.
/// Nothing is loaded from anywhere.
fn policy() -> String {
    let hash = STANDARD.encode(Sha256::digest(SCRIPT));
    format!(
        "default-src 'none'; img-src data: blob:; style-src 'unsafe-inline'; script-src 'sha256-{hash}'; \
         worker-src blob:; base-uri 'none'; form-action 'none'"
    )
}
