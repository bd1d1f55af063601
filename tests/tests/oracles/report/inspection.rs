//! What a report must be in a browser.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use image::RgbImage;
use serde_json::{Value, json};

use super::film::film_plays;
use super::pixels::{capture, difference, view};
use crate::browser::devtools::Connection;
use crate::browser::{Browser, open};

/// Size of the window, and the width of a narrow one, CSS pixels.
const WINDOW: [u32; 2] = [1280, 900];
const NARROW: u32 = 390;

/// Least number of colours (in steps of 16 levels) of a page that shows something.
const COLOURS: usize = 40;

/// Least share of a slider's pixels that change as it moves over a tenth of its width and more.
const CHANGED: f64 = 0.01;

/// Opens the page and checks all that is asked of a report.
///
/// # Errors
/// If anything is wrong with it, with what.
pub fn inspect(page: &Path, screenshot: Option<&Path>) -> Result<()> {
    let mut browser = Browser::start()?;
    let connection = &mut browser.connection;
    connection.open_page()?;
    resize(connection, WINDOW[0])?;
    let address = address(page)?;
    open(connection, &address)?;
    pictures_are_loaded(connection)?;
    charts_are_drawn(connection)?;
    film_plays(connection)?;
    sliders_move(connection)?;
    layers_can_be_chosen(connection)?;
    tables_can_be_sorted(connection)?;
    pictures_can_be_enlarged(connection)?;
    let picture = whole_page(connection)?;
    if let Some(path) = screenshot {
        picture.save(path).with_context(|| format!("cannot write {}", path.display()))?;
    }
    is_not_blank(&picture)?;
    is_dark_where_wanted(connection)?;
    fits_a_narrow_window(connection)?;
    // Last, because everything above may have left an error.
    nothing_was_reported(connection, &address)
}

fn resize(connection: &mut Connection, width: u32) -> Result<()> {
    let metrics = json!({"width": width, "height": WINDOW[1], "deviceScaleFactor": 1, "mobile": false});
    connection.call("Emulation.setDeviceMetricsOverride", metrics).map(drop)
}

/// The address of a file, whatever its name.
fn address(page: &Path) -> Result<String> {
    let path = page.canonicalize()?;
    let bytes = path.to_str().context("a path that is text")?.bytes();
    let safe = |byte: u8| byte.is_ascii_alphanumeric() || b"/-_.~".contains(&byte);
    let shown = bytes.map(|byte| if safe(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") });
    Ok(format!("file://{}", shown.collect::<String>()))
}

/// Every picture has pixels, and there are some.
fn pictures_are_loaded(connection: &mut Connection) -> Result<()> {
    let sizes = connection.evaluate(
        "Promise.all([...document.images].map(async picture => {
            await picture.decode().catch(() => 0);
            return { name: picture.alt, width: picture.naturalWidth };
        }))",
    )?;
    let pictures = sizes.as_array().context("a list")?;
    ensure!(!pictures.is_empty(), "the page has no picture");
    let broken: Vec<&Value> =
        pictures.iter().filter(|picture| picture["width"].as_u64().is_none_or(|w| w == 0)).collect();
    ensure!(broken.is_empty(), "pictures were not loaded: {broken:?}");
    Ok(())
}

/// Every chart has a curve of some length within its drawing.
fn charts_are_drawn(connection: &mut Connection) -> Result<()> {
    let lengths = connection.evaluate(
        "[...document.querySelectorAll('figure.chart svg')].map(chart => Math.max(0,
            ...[...chart.querySelectorAll('path')].map(path => path.getTotalLength())))",
    )?;
    let lengths = lengths.as_array().context("a list")?;
    ensure!(lengths.len() >= 4, "the page has {} charts", lengths.len());
    ensure!(lengths.iter().all(|length| length.as_f64() > Some(100.0)), "curves have lengths {lengths:?}");
    Ok(())
}

/// Each slider follows the pointer and the arrow keys, and what is seen changes with it.
fn sliders_move(connection: &mut Connection) -> Result<()> {
    let count =
        connection.evaluate("document.querySelectorAll('figure.slider').length")?.as_u64().context("a count")?;
    ensure!(count > 0, "the page has no slider");
    for index in 0..count {
        slider_moves(connection, index).with_context(|| format!("slider {index}"))?;
    }
    Ok(())
}

fn slider_moves(connection: &mut Connection, index: u64) -> Result<()> {
    let slider = Slider::show(connection, index)?;
    // The line itself moves anyhow; the pictures must.
    slider.set_line(connection, "hidden")?;
    slider.follows_the_pointer(connection)?;
    slider.follows_the_keys(connection)?;
    slider.set_line(connection, "")
}

/// A slider, in the middle of the window.
struct Slider {
    /// The expression of its metric.
    find: String,
    /// The rectangle of its pictures in the window, CSS pixels.
    place: Value,
}

impl Slider {
    fn show(connection: &mut Connection, index: u64) -> Result<Self> {
        let find = format!("document.querySelectorAll('figure.slider')[{index}]");
        connection.evaluate(&format!("{find}.scrollIntoView({{ behavior: 'instant', block: 'center' }})"))?;
        let place = connection.evaluate(&format!("{find}.querySelector('.stack').getBoundingClientRect().toJSON()"))?;
        Ok(Self { find, place })
    }

    fn set_line(&self, connection: &mut Connection, visibility: &str) -> Result<()> {
        let line = format!("{}.querySelector('.line').style.visibility", self.find);
        connection.evaluate(&format!("{line} = '{visibility}'")).map(drop)
    }

    /// Where the right picture begins, per cent of the width.
    fn edge(&self, connection: &mut Connection) -> Result<f64> {
        let right = format!("{}.querySelector('img.right')", self.find);
        let clip = connection.evaluate(&format!("getComputedStyle({right}).clipPath"))?;
        let clip = clip.as_str().unwrap_or_default();
        let share = clip.strip_suffix("%)").and_then(|rest| rest.rsplit(' ').next()?.parse::<f64>().ok());
        share.with_context(|| format!("the right picture is cut by `{clip}`"))
    }

    /// Does something with the pointer at this share of the width.
    fn point(&self, connection: &mut Connection, kind: &str, share: f64) -> Result<()> {
        let at = |name: &str| self.place[name].as_f64().with_context(|| format!("no {name} of the slider"));
        let (x, y) = (at("left")? + share * at("width")?, at("top")? + at("height")? / 2.0);
        let event = json!({"type": kind, "x": x, "y": y, "button": "left", "buttons": 1, "clickCount": 1});
        connection.call("Input.dispatchMouseEvent", event).map(drop)
    }

    fn follows_the_pointer(&self, connection: &mut Connection) -> Result<()> {
        let before = view(connection, &self.place)?;
        for (kind, share) in [("mousePressed", 0.5), ("mouseMoved", 0.3), ("mouseMoved", 0.1), ("mouseReleased", 0.1)] {
            self.point(connection, kind, share)?;
        }
        let edge = self.edge(connection)?;
        ensure!((edge - 10.0).abs() < 2.0, "dragged to a tenth of the width, the edge stands at {edge} %");
        let changed = difference(&before, &view(connection, &self.place)?)?;
        ensure!(changed > CHANGED, "the pointer changed {changed} of the pixels");
        Ok(())
    }

    fn follows_the_keys(&self, connection: &mut Connection) -> Result<()> {
        let before = self.edge(connection)?;
        for kind in ["rawKeyDown", "keyUp"].repeat(4) {
            let key = json!({"type": kind, "key": "ArrowRight", "code": "ArrowRight", "windowsVirtualKeyCode": 39});
            connection.call("Input.dispatchKeyEvent", key)?;
        }
        let edge = self.edge(connection)?;
        ensure!((edge - before - 2.0).abs() < 0.1, "four keys moved the edge from {before} to {edge} %");
        Ok(())
    }
}

/// Another layer on the right is another picture.
fn layers_can_be_chosen(connection: &mut Connection) -> Result<()> {
    let differs = connection.evaluate(
        "(() => {
            const figure = document.querySelector('figure.slider');
            const choice = figure.querySelector('select[data-side=right]');
            const picture = figure.querySelector('img.right');
            const before = picture.src;
            choice.value = choice.options[0].value;
            choice.dispatchEvent(new Event('change'));
            const chosen = document.getElementById(choice.value).src;
            return picture.src !== before && picture.src === chosen;
        })()",
    )?;
    ensure!(differs == true, "choosing another layer does not show it");
    Ok(())
}

/// A click on a column's head sorts by it, another one the other way round; also where metrics are below zero.
fn tables_can_be_sorted(connection: &mut Connection) -> Result<()> {
    let orders = connection.evaluate(
        "(() => {
            const table = document.querySelector('table.sortable');
            const rows = [...table.tBodies[0].rows];
            const order = () => {
                table.tHead.rows[0].cells[1].querySelector('button').click();
                return [...table.tBodies[0].rows].map(row => parseFloat(row.cells[1].textContent));
            };
            const found = [order(), order()];
            const texts = rows.map(row => row.cells[1].textContent);
            rows.forEach((row, index) => { row.cells[1].textContent = -9.5 - index; });
            found.push(order(), order());
            rows.forEach((row, index) => { row.cells[1].textContent = texts[index]; });
            return found;
        })()",
    )?;
    let orders: Vec<Vec<f64>> = serde_json::from_value(orders)?;
    ensure!(orders.len() == 4, "four orders: {orders:?}");
    for pair in orders.chunks(2) {
        let [up, down] = pair else { bail!("two orders: {pair:?}") };
        ensure!(up.len() > 1 && up.is_sorted() && up.iter().rev().eq(down), "the views are in the orders {pair:?}");
    }
    Ok(())
}

/// A click on a small picture makes it large, another one small again.
fn pictures_can_be_enlarged(connection: &mut Connection) -> Result<()> {
    let widths = connection.evaluate(
        "(() => {
            const figure = document.querySelector('.row figure');
            const width = () => figure.getBoundingClientRect().width;
            return [width(), (figure.click(), width()), (figure.click(), width())];
        })()",
    )?;
    let widths: Vec<f64> = serde_json::from_value(widths)?;
    ensure!(widths[1] > 2.0 * widths[0] && widths[2] == widths[0], "clicks make the picture {widths:?} pixels wide");
    Ok(())
}

/// Nothing but the page itself was asked for, and no error or warning was reported.
fn nothing_was_reported(connection: &mut Connection, address: &str) -> Result<()> {
    // What the page did just now is reported before this is answered.
    connection.evaluate("new Promise(resolve => requestAnimationFrame(() => setTimeout(resolve, 0)))")?;
    let complaint = |event: &Value| -> Option<String> {
        let parameters = &event["params"];
        match event["method"].as_str()? {
            "Runtime.exceptionThrown" => Some(parameters["exceptionDetails"].to_string()),
            "Runtime.consoleAPICalled" if parameters["type"] != "log" => Some(parameters.to_string()),
            "Log.entryAdded" => Some(parameters["entry"].to_string()),
            "Network.requestWillBeSent" => {
                let asked = parameters["request"]["url"].as_str().unwrap_or_default();
                (asked != address && !asked.starts_with("data:")).then(|| format!("asks for {asked}"))
            }
            _ => None,
        }
    };
    let complaints: Vec<String> = connection.events().iter().filter_map(complaint).collect();
    ensure!(complaints.is_empty(), "the browser complains: {}", complaints.join("; "));
    Ok(())
}

fn whole_page(connection: &mut Connection) -> Result<RgbImage> {
    connection.evaluate("scrollTo(0, 0)")?;
    let size = connection.call("Page.getLayoutMetrics", json!({}))?["cssContentSize"].clone();
    let clip = json!({"x": 0, "y": 0, "width": size["width"], "height": size["height"], "scale": 1});
    capture(connection, json!({"format": "png", "captureBeyondViewport": true, "clip": clip}))
}

fn is_not_blank(picture: &RgbImage) -> Result<()> {
    let colours: BTreeSet<[u8; 3]> = picture.pixels().map(|pixel| pixel.0.map(|level| level / 16)).collect();
    ensure!(colours.len() > COLOURS, "the page has {} colours", colours.len());
    Ok(())
}

/// The page's ground follows the colours that the reader prefers.
fn is_dark_where_wanted(connection: &mut Connection) -> Result<()> {
    for (preference, is_dark) in [("light", false), ("dark", true)] {
        let features = json!([{"name": "prefers-color-scheme", "value": preference}]);
        connection.call("Emulation.setEmulatedMedia", json!({"features": features}))?;
        connection.evaluate("scrollTo(0, 0)")?;
        let corner = view(connection, &json!({"x": 0, "y": 0, "width": 8, "height": 8}))?;
        let level = corner.get_pixel(2, 2).0[0];
        ensure!((level < 64) == is_dark && (level > 192) != is_dark, "with {preference} colours the ground is {level}");
    }
    Ok(())
}

/// On a telephone nothing stands out to the right.
fn fits_a_narrow_window(connection: &mut Connection) -> Result<()> {
    resize(connection, NARROW)?;
    let width = connection.evaluate("document.documentElement.scrollWidth")?.as_u64().context("a width")?;
    ensure!(width <= u64::from(NARROW), "the page is {width} pixels wide in a window of {NARROW}");
    Ok(())
}
