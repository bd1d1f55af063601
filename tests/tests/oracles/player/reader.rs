//! What a reader does with the page, and what the page must then do.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde_json::json;

use super::stage::Stage;
use crate::report::pixels::difference;

/// Size of the window, and the width of a narrow one, CSS pixels.
const WINDOW: [u32; 2] = [640, 480];
const NARROW: u32 = 390;
/// Least share of the pixels that change visibly when the camera moves.
const CHANGED: f64 = 0.02;
/// Most of them when nothing should: rounding of a pose to seven digits.
const UNCHANGED: f64 = 0.005;

/// Opens the page and does everything.
///
/// # Errors
/// If anything is wrong, with what.
pub fn inspect(page: &Path) -> Result<()> {
    let mut stage = Stage::open(page)?;
    resize(&mut stage, WINDOW[0])?;
    a_drag_turns_the_camera_and_the_address_restores_it(&mut stage)?;
    time_runs(&mut stage)?;
    layers_differ(&mut stage)?;
    a_lost_context_comes_back(&mut stage)?;
    parameters_of_the_address_count(&mut stage)?;
    it_is_dark_where_wanted_and_fits_a_telephone(&mut stage)?;
    stage.is_silent()?;
    a_page_that_cannot_be_shown_says_why(&mut stage)
}

fn resize(stage: &mut Stage, width: u32) -> Result<()> {
    let metrics = json!({"width": width, "height": WINDOW[1], "deviceScaleFactor": 1, "mobile": false});
    stage.connection().call("Emulation.setDeviceMetricsOverride", metrics).map(drop)
}

fn a_drag_turns_the_camera_and_the_address_restores_it(stage: &mut Stage) -> Result<()> {
    let before = stage.pixels()?;
    stage
        .connection()
        .evaluate("(({ eye, rotation }) => { window.before = { eye, rotation }; })(mvfusion.player.orbit)")?;
    for (kind, x) in [("mousePressed", 300), ("mouseMoved", 340), ("mouseMoved", 420), ("mouseReleased", 420)] {
        let event = json!({"type": kind, "x": x, "y": 200, "button": "left", "buttons": 1, "clickCount": 1});
        stage.connection().call("Input.dispatchMouseEvent", event)?;
    }
    let after = stage.pixels()?;
    let changed = difference(&before, &after)?;
    ensure!(changed > CHANGED, "a drag changes {changed} of the pixels");
    // To the right of the camera, what it has moved; the scene follows the pointer the other way.
    let moved = "mvfusion.player.orbit.eye.reduce((sum, x, i) => sum + (x - before.eye[i]) * before.rotation[i], 0)";
    let moved = stage.connection().evaluate(moved)?.as_f64().context("a length")?;
    ensure!(moved < 0.0, "a drag to the right moves the camera by {moved} to the right");
    // The state is written when the camera stands still.
    let hash = stage.connection().evaluate("new Promise(resolve => setTimeout(() => resolve(location.hash), 600))")?;
    let hash = hash.as_str().context("a hash")?.to_owned();
    ensure!(hash.contains("pose="), "the address ends with `{hash}`");
    stage.go(&hash)?;
    stage.is_ready()?;
    let restored = difference(&after, &stage.pixels()?)?;
    ensure!(restored < UNCHANGED, "the address restores all but {restored} of the pixels");
    Ok(())
}

fn time_runs(stage: &mut Stage) -> Result<()> {
    let times = stage.connection().evaluate(
        "(async () => {
            const { player } = mvfusion;
            const { elements } = document.getElementById('controls');
            elements.time.value = elements.time.max;
            elements.time.dispatchEvent(new Event('input'));
            const last = player.time;
            elements.play.click();
            const first = player.time;
            await new Promise(resolve => setTimeout(resolve, 3000));
            const later = player.time;
            elements.play.click();
            return [first, later, last, player.isPlaying];
        })()",
    )?;
    let time = |index: usize| times[index].as_f64().context("a time");
    let (first, later, last) = (time(0)?, time(1)?, time(2)?);
    ensure!(first < last && first != later && times[3] == false, "time goes {times}");
    // Keys count without a click into the image, but not where a control has them.
    let times = stage.connection().evaluate(
        "(({ player }) => {
            const press = (target, key) => {
                player.setTime(0);
                target.dispatchEvent(new KeyboardEvent('keydown', { key, bubbles: true }));
                return player.time;
            };
            return [press(document.body, 'ArrowRight'), press(player.form.elements.time, 'ArrowRight')];
        })(mvfusion)",
    )?;
    ensure!(times[0].as_f64() > Some(0.0) && times[1] == 0, "an arrow key goes to {times}");
    Ok(())
}

fn layers_differ(stage: &mut Stage) -> Result<()> {
    let mut pictures = Vec::new();
    for layer in ["composed", "static", "dynamic", "mask"] {
        stage.connection().evaluate(&format!("mvfusion.setLayer('{layer}')"))?;
        pictures.push((layer, stage.pixels()?));
    }
    for (index, (a, picture)) in pictures.iter().enumerate() {
        for (b, other) in &pictures[..index] {
            ensure!(picture != other, "the layers {a} and {b} are the same");
        }
    }
    stage.connection().evaluate("mvfusion.setLayer('composed')").map(drop)
}

fn a_lost_context_comes_back(stage: &mut Stage) -> Result<()> {
    let before = stage.pixels()?;
    stage.connection().evaluate(
        "(async () => {
            const { canvas, renderer: { gl } } = mvfusion.player;
            const extension = gl.getExtension('WEBGL_lose_context');
            const event = name => new Promise(resolve => canvas.addEventListener(name, resolve, { once: true }));
            const lost = event('webglcontextlost');
            extension.loseContext();
            await lost;
            const restored = event('webglcontextrestored');
            setTimeout(() => extension.restoreContext(), 50);
            await restored;
        })()",
    )?;
    ensure!(stage.pixels()? == before, "the image is another one after a lost context");
    Ok(())
}

fn parameters_of_the_address_count(stage: &mut Stage) -> Result<()> {
    stage.go("?ui=0&size=64x40&time=0.3&camera=1&layer=mask&speed=2&loop=0")?;
    stage.is_ready()?;
    let state = stage.connection().evaluate(
        "(({ player: { time, layer, speed, loops, form } }) => [time, layer, speed, loops, form.hidden])(mvfusion)",
    )?;
    ensure!(state == json!([0.3, "mask", 2, false, true]), "the state is {state}");
    ensure!(stage.pixels()?.dimensions() == (64, 40), "the size of the address does not count");
    Ok(())
}

fn it_is_dark_where_wanted_and_fits_a_telephone(stage: &mut Stage) -> Result<()> {
    resize(stage, NARROW)?;
    stage.go("")?;
    stage.is_ready()?;
    for (preference, is_dark) in [("light", false), ("dark", true)] {
        let features = json!([{"name": "prefers-color-scheme", "value": preference}]);
        stage.connection().call("Emulation.setEmulatedMedia", json!({"features": features}))?;
        let colour = "getComputedStyle(document.body).backgroundColor.match(/\\d+/)[0]";
        let level = stage.connection().evaluate(colour)?;
        let level: u32 = level.as_str().context("a colour")?.parse()?;
        ensure!((level < 64) == is_dark && (level > 192) != is_dark, "with {preference} colours the ground is {level}");
    }
    let width = stage.connection().evaluate("document.documentElement.scrollWidth")?.as_u64().context("a width")?;
    ensure!(width <= u64::from(NARROW), "the page is {width} pixels wide in a window of {NARROW}");
    Ok(())
}

fn a_page_that_cannot_be_shown_says_why(stage: &mut Stage) -> Result<()> {
    // In the middle of the film, and then at the start.
    let refuse = "WebGL2RenderingContext.prototype.checkFramebufferStatus = () => 0;";
    stage.connection().evaluate(&format!("{refuse} mvfusion.player.renderer.size = ''; mvfusion.player.changed()"))?;
    message_is(stage, "new Promise(resolve => setTimeout(resolve, 500))", "half-float")?;
    for (source, wanted) in [(refuse, "half-float"), ("HTMLCanvasElement.prototype.getContext = () => null", "WebGL 2")]
    {
        stage.connection().call("Page.addScriptToEvaluateOnNewDocument", json!({"source": source}))?;
        stage.go("")?;
        message_is(stage, "mvfusion.ready.catch(() => 0)", wanted)?;
    }
    Ok(())
}

/// After a promise, the page must show a message with these words.
fn message_is(stage: &mut Stage, promise: &str, words: &str) -> Result<()> {
    let message = stage.connection().evaluate(&format!(
        "{promise}.then(() => {{
            const message = document.getElementById('message');
            return [message.hidden, message.textContent];
        }})"
    ))?;
    let text = message[1].as_str().unwrap_or_default();
    ensure!(message[0] == false && text.contains(words), "instead of `{words}`, the page says {message}");
    Ok(())
}
