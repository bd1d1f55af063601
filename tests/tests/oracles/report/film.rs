//! What the film of a report must do in a browser.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use serde_json::{Value, json};

use super::pixels::{difference, view};
use crate::browser::devtools::Connection;

/// A picture or a frame that is waited for may take so long.
const PATIENCE: Duration = Duration::from_secs(10);
/// Time from one look at the page to the next.
const PAUSE: Duration = Duration::from_millis(20);
/// Time in which a film that was stopped must not go on.
const REST: Duration = Duration::from_millis(400);

/// The film follows keys, a drag over a picture, and its button; each screen shows the layer that is chosen.
///
/// # Errors
/// If it does not, with what.
pub fn film_plays(connection: &mut Connection) -> Result<()> {
    connection.evaluate("document.querySelector('figure.film').scrollIntoView({ block: 'center' })")?;
    let frames = number(connection, "+document.querySelector('figure.film').dataset.frames")?;
    ensure!(frames >= 2.0, "the film has {frames} frames");
    for screen in 0..2 {
        let loaded = format!("{}.naturalWidth > 0", picture(screen));
        ensure!(becomes_true(connection, &loaded)?, "screen {screen} shows no picture");
    }
    keys_move(connection)?;
    a_drag_moves(connection)?;
    a_layer_can_be_chosen(connection)?;
    it_plays_and_stops(connection)
}

/// The expression of a screen's picture.
fn picture(screen: usize) -> String {
    format!("document.querySelectorAll('figure.film .screen img')[{screen}]")
}

fn number(connection: &mut Connection, expression: &str) -> Result<f64> {
    connection.evaluate(expression)?.as_f64().with_context(|| format!("`{expression}` is no number"))
}

/// The frame that the slider stands at.
fn frame(connection: &mut Connection) -> Result<f64> {
    number(connection, "+document.querySelector('.moment').value")
}

fn becomes_true(connection: &mut Connection, expression: &str) -> Result<bool> {
    let until = Instant::now() + PATIENCE;
    while connection.evaluate(expression)? != Value::Bool(true) {
        if Instant::now() > until {
            return Ok(false);
        }
        thread::sleep(PAUSE);
    }
    Ok(true)
}

fn keys_move(connection: &mut Connection) -> Result<()> {
    let place = connection.evaluate(&format!("{}.getBoundingClientRect().toJSON()", picture(0)))?;
    let (before, caption) = (view(connection, &place)?, "document.querySelector('.caption').value");
    let words = connection.evaluate(caption)?;
    let source = connection.evaluate(&format!("{}.src", picture(0)))?;
    connection.evaluate("document.querySelector('.moment').focus({ preventScroll: true })")?;
    for kind in ["rawKeyDown", "keyUp"] {
        let key = json!({"type": kind, "key": "End", "code": "End", "windowsVirtualKeyCode": 35});
        connection.call("Input.dispatchKeyEvent", key)?;
    }
    let last = number(connection, "+document.querySelector('.moment').max")?;
    ensure!(frame(connection)? == last, "the key End moves the film to {}, not {last}", frame(connection)?);
    ensure!(becomes_true(connection, &format!("{}.src !== {source}", picture(0)))?, "the last frame is not shown");
    ensure!(connection.evaluate(caption)? != words, "the caption stays {words}");
    let line = number(connection, "+getComputedStyle(document.querySelector('figure.film')).getPropertyValue('--at')")?;
    ensure!(line == 1.0, "the line over the curve stands at {line}");
    // What moves is elsewhere at another time.
    let changed = difference(&before, &view(connection, &place)?)?;
    ensure!(changed > 0.0, "the last frame looks like the first one");
    Ok(())
}

fn a_drag_moves(connection: &mut Connection) -> Result<()> {
    let place = connection.evaluate(&format!("{}.getBoundingClientRect().toJSON()", picture(1)))?;
    let at = |name: &str| place[name].as_f64().with_context(|| format!("no {name} of the picture"));
    let y = at("top")? + at("height")? / 2.0;
    // From the last frame back by its whole width: to the first one.
    for (kind, share) in [("mousePressed", 0.99), ("mouseMoved", 0.5), ("mouseMoved", -0.2), ("mouseReleased", -0.2)] {
        let x = at("left")? + share * at("width")?;
        let event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1});
        connection.call("Input.dispatchMouseEvent", event)?;
    }
    let frame = frame(connection)?;
    ensure!(frame == 0.0, "a drag to the left ends at frame {frame}");
    Ok(())
}

fn a_layer_can_be_chosen(connection: &mut Connection) -> Result<()> {
    let shown = connection.evaluate(
        "(() => {
            const screen = document.querySelectorAll('figure.film .screen')[1];
            const choice = screen.querySelector('select');
            choice.value = 'depth';
            choice.dispatchEvent(new Event('change'));
            return document.querySelector('.frames data.depth').value;
        })()",
    )?;
    let chosen = format!("{}.src === {shown}", picture(1));
    ensure!(becomes_true(connection, &chosen)?, "choosing the depth does not show it");
    Ok(())
}

fn it_plays_and_stops(connection: &mut Connection) -> Result<()> {
    let click = "document.querySelector('.play').click()";
    connection.evaluate(click)?;
    ensure!(becomes_true(connection, "+document.querySelector('.moment').value >= 1")?, "the film does not play");
    connection.evaluate(click)?;
    let pressed = connection.evaluate("document.querySelector('.play').ariaPressed")?;
    ensure!(pressed == "false", "the stopped film says that it plays");
    thread::sleep(PAUSE);
    let stopped = frame(connection)?;
    thread::sleep(REST);
    ensure!(frame(connection)? == stopped, "the stopped film goes on from {stopped} to {}", frame(connection)?);
    Ok(())
}
