//! The viewer's page in a browser.

use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

use crate::browser::Browser;
use crate::browser::devtools::Connection;

/// How long anything may take.
const TIMEOUT: Duration = Duration::from_secs(60);
const PAUSE: Duration = Duration::from_millis(30);

/// Size of the window, CSS pixels.
pub const WINDOW: [u32; 2] = [1100, 640];

/// Width and height of the picture that tests compare.
const SMALL: [usize; 2] = [96, 54];

/// Whether the picture is as good as it gets, and none is on its way.
const IS_SHARP: &str = "globalThis.viewer !== undefined && !viewer.link.waiting && !viewer.isChanged
    && document.body.dataset.sharp === 'true'";

/// A page.
pub struct Page {
    browser: Browser,
}

impl Page {
    /// Opens an address in a browser of its own, and waits for the connection.
    pub fn open(address: &str) -> Result<Self> {
        let mut page = Self { browser: Browser::start()? };
        page.connection().open_page()?;
        page.resize(WINDOW)?;
        page.go(address)?;
        Ok(page)
    }

    /// Goes to another address.
    pub fn go(&mut self, address: &str) -> Result<()> {
        let answer = self.connection().call("Page.navigate", json!({"url": address}))?;
        if let Some(error) = answer.get("errorText") {
            bail!("{address} cannot be opened: {error}");
        }
        self.wait("document.body?.dataset.link === 'open'")
    }

    pub fn connection(&mut self) -> &mut Connection {
        &mut self.browser.connection
    }

    pub fn resize(&mut self, [width, height]: [u32; 2]) -> Result<()> {
        let metrics = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500});
        self.connection().call("Emulation.setDeviceMetricsOverride", metrics).map(drop)
    }

    /// The value of an expression in the page.
    pub fn ask(&mut self, expression: &str) -> Result<Value> {
        self.connection().evaluate(expression)
    }

    /// Waits until an expression is true.
    pub fn wait(&mut self, expression: &str) -> Result<()> {
        let until = Instant::now() + TIMEOUT;
        loop {
            // While a page is loaded, nothing can be asked.
            let found = self.ask(expression);
            if matches!(found, Ok(Value::Bool(true))) {
                return Ok(());
            }
            ensure!(Instant::now() < until, "this did not become true, but {found:?}: {expression}");
            thread::sleep(PAUSE);
        }
    }

    /// Waits for a sharp picture, and returns it in a small size: levels of red, green and blue.
    pub fn picture(&mut self) -> Result<Vec<u8>> {
        // Moves of the pointer are handled with the next frames.
        self.ask("new Promise(resolve => requestAnimationFrame(() => requestAnimationFrame(() => resolve(true))))")?;
        self.wait(IS_SHARP)?;
        let [width, height] = SMALL;
        let levels = self.ask(&format!(
            "(() => {{
                const canvas = new OffscreenCanvas({width}, {height});
                const context = canvas.getContext('2d');
                context.drawImage(viewer.picture.bitmap, 0, 0, {width}, {height});
                return [...context.getImageData(0, 0, {width}, {height}).data].filter((_, index) => index % 4 !== 3);
            }})()"
        ))?;
        Ok(serde_json::from_value(levels)?)
    }

    /// The colour of the canvas at shares of its width and height.
    pub fn canvas_at(&mut self, [x, y]: [f64; 2]) -> Result<[u8; 3]> {
        let level = self.ask(&format!(
            "(() => {{
                const {{ canvas, context }} = viewer.picture;
                const [x, y] = [Math.floor({x} * canvas.width), Math.floor({y} * canvas.height)];
                return [...context.getImageData(x, y, 1, 1).data].slice(0, 3);
            }})()"
        ))?;
        Ok(serde_json::from_value(level)?)
    }

    /// Sets a control and tells the page.
    pub fn set(&mut self, id: &str, value: &str) -> Result<()> {
        let found = self.ask(&format!(
            "(() => {{
                const control = document.getElementById('{id}');
                if (control.type === 'checkbox') control.checked = '{value}' === 'true';
                else control.value = '{value}';
                control.dispatchEvent(new Event('input', {{ bubbles: true }}));
                control.dispatchEvent(new Event('change', {{ bubbles: true }}));
                return control.type === 'checkbox' ? String(control.checked) : control.value;
            }})()"
        ))?;
        let is_close = |found: &str| match (found.parse::<f64>(), value.parse::<f64>()) {
            (Ok(found), Ok(value)) => (found - value).abs() < 1e-3,
            _ => found == value,
        };
        ensure!(found.as_str().is_some_and(is_close), "{id} is {found} and not {value}");
        Ok(())
    }

    pub fn click(&mut self, id: &str) -> Result<()> {
        self.ask(&format!("document.getElementById('{id}').click()")).map(drop)
    }

    /// Drags the pointer over the picture by some pixels.
    pub fn drag(&mut self, [x, y]: [f64; 2]) -> Result<()> {
        let middle = self.middle()?;
        self.mouse("mousePressed", middle, json!({"button": "left", "buttons": 1, "clickCount": 1}))?;
        for part in 1..=4 {
            let share = f64::from(part) / 4.0;
            let place = [middle[0] + share * x, middle[1] + share * y];
            self.mouse("mouseMoved", place, json!({"button": "left", "buttons": 1}))?;
        }
        self.mouse("mouseReleased", [middle[0] + x, middle[1] + y], json!({"button": "left", "clickCount": 1}))
    }

    /// Turns the wheel over the picture.
    pub fn wheel(&mut self, by: f64) -> Result<()> {
        let middle = self.middle()?;
        self.mouse("mouseWheel", middle, json!({"deltaX": 0, "deltaY": by}))
    }

    /// Moves fingers over the picture, each from one place to another, in pixels from its middle.
    pub fn touch(&mut self, fingers: &[[[f64; 2]; 2]]) -> Result<()> {
        let middle = self.middle()?;
        for part in 0..=4 {
            let share = f64::from(part) / 4.0;
            let points = fingers.iter().enumerate().map(|(id, [from, to])| {
                let [x, y] = [0, 1].map(|axis| middle[axis] + from[axis] + share * (to[axis] - from[axis]));
                json!({"x": x, "y": y, "id": id})
            });
            let kind = if part == 0 { "touchStart" } else { "touchMove" };
            let event = json!({"type": kind, "touchPoints": points.collect::<Vec<_>>()});
            self.connection().call("Input.dispatchTouchEvent", event)?;
        }
        let event = json!({"type": "touchEnd", "touchPoints": []});
        self.connection().call("Input.dispatchTouchEvent", event).map(drop)
    }

    /// Holds a key of flight for a moment.
    pub fn hold(&mut self, code: &str, milliseconds: u64) -> Result<()> {
        let key = code.trim_start_matches("Key").to_lowercase();
        self.connection().call("Input.dispatchKeyEvent", json!({"type": "keyDown", "code": code, "key": key}))?;
        thread::sleep(Duration::from_millis(milliseconds));
        self.connection().call("Input.dispatchKeyEvent", json!({"type": "keyUp", "code": code, "key": key})).map(drop)
    }

    fn middle(&mut self) -> Result<[f64; 2]> {
        let place = self.ask(
            "(() => {
                const { x, y, width, height } = document.getElementById('picture').getBoundingClientRect();
                return [x + width / 2, y + height / 2];
            })()",
        )?;
        Ok(serde_json::from_value(place)?)
    }

    fn mouse(&mut self, kind: &str, [x, y]: [f64; 2], mut more: Value) -> Result<()> {
        (more["type"], more["x"], more["y"]) = (json!(kind), json!(x), json!(y));
        self.connection().call("Input.dispatchMouseEvent", more).map(drop)
    }

    /// Writes a picture of the window to a file.
    pub fn screenshot(&mut self, path: &Path) -> Result<image::RgbImage> {
        let answer = self.connection().call("Page.captureScreenshot", json!({"format": "png"}))?;
        let bytes = STANDARD.decode(answer["data"].as_str().context("a picture")?)?;
        std::fs::write(path, &bytes).with_context(|| format!("cannot write {}", path.display()))?;
        Ok(image::load_from_memory(&bytes)?.into_rgb8())
    }

    /// Checks that the browser has reported no error, and that nothing outside the server was asked for.
    pub fn reports_nothing(&mut self, address: &str) -> Result<()> {
        // What the page did just now is reported before this is answered.
        self.ask("new Promise(resolve => requestAnimationFrame(() => setTimeout(resolve, 0)))")?;
        let complaint = |event: &Value| {
            let parameters = &event["params"];
            match event["method"].as_str()? {
                "Runtime.exceptionThrown" => Some(parameters["exceptionDetails"].to_string()),
                "Log.entryAdded" if parameters["entry"]["level"] != "info" => Some(parameters["entry"].to_string()),
                "Runtime.consoleAPICalled" => Some(parameters["args"].to_string()),
                "Network.requestWillBeSent" => {
                    let asked = parameters["request"]["url"].as_str()?;
                    let is_own = asked.starts_with(address)
                        || ["data:", "blob:", "about:"].iter().any(|kind| asked.starts_with(kind));
                    (!is_own).then(|| format!("the page asks for {asked}"))
                }
                _ => None,
            }
        };
        let complaints: Vec<String> = self.connection().events().iter().filter_map(complaint).collect();
        ensure!(complaints.is_empty(), "the browser complains: {}", complaints.join("; "));
        Ok(())
    }
}

/// The share of pixels that differ visibly between two pictures of [`Page::picture`].
pub fn difference(a: &[u8], b: &[u8]) -> f64 {
    let differs = |(a, b): &(&[u8], &[u8])| a.iter().zip(*b).any(|(&a, &b)| a.abs_diff(b) > 12);
    a.chunks(3).zip(b.chunks(3)).filter(differs).count() as f64 / (a.len() / 3).max(1) as f64
}
