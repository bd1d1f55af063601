//! A page in a browser that shows the cameras and times that it is told.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::{DynamicImage, RgbImage, RgbaImage};
use mvfusion_data::Camera;
use serde_json::{Value, json};

use crate::browser::devtools::Connection;
use crate::browser::{Browser, open};

/// An expression that becomes the width and height of the page's image and its pixels in base64.
const PIXELS: &str = "mvfusion.pixels().then(({ data, width, height }) => {
    let text = '';
    for (let i = 0; i < data.length; i += 0x8000) text += String.fromCharCode(...data.subarray(i, i + 0x8000));
    return [width, height, btoa(text)];
})";

/// An open page.
pub struct Stage {
    browser: Browser,
    address: String,
}

impl Stage {
    /// Opens a page and waits until the scene is shown.
    ///
    /// # Errors
    /// If it cannot be shown.
    pub fn open(page: &Path) -> Result<Self> {
        let mut stage = Self { browser: Browser::start()?, address: address(page)? };
        stage.connection().open_page()?;
        stage.go("")?;
        stage.is_ready()?;
        Ok(stage)
    }

    /// The connection to the browser.
    pub fn connection(&mut self) -> &mut Connection {
        &mut self.browser.connection
    }

    /// Opens the page anew, with something after its address.
    ///
    /// # Errors
    /// If it does not load.
    pub fn go(&mut self, after: &str) -> Result<()> {
        self.connection().call("Page.navigate", json!({"url": "about:blank"}))?;
        let address = format!("{}{after}", self.address);
        open(self.connection(), &address)
    }

    /// Waits until the scene is shown.
    ///
    /// # Errors
    /// If it cannot be.
    pub fn is_ready(&mut self) -> Result<()> {
        let ready = self.connection().evaluate("mvfusion.ready.then(() => true)")?;
        ensure!(ready == true, "the scene is not ready: {ready}");
        Ok(())
    }

    /// The image of a camera at a time.
    ///
    /// # Errors
    /// If the page fails.
    pub fn picture(&mut self, camera: &Camera, time: f64) -> Result<RgbImage> {
        let rotation: Vec<f64> = (0..3).flat_map(|row| camera.rotation.row(row).to_array()).collect();
        let Camera { width, height, fx, fy, cx, cy, translation, .. } = camera;
        let camera = json!({
            "width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy,
            "rotation": rotation, "translation": translation.to_array(),
        });
        self.connection().evaluate(&format!("mvfusion.setCamera({camera}); mvfusion.setTime({time})"))?;
        let picture = self.pixels()?;
        ensure!(picture.dimensions() == (*width as u32, *height as u32), "{:?} pixels", picture.dimensions());
        Ok(picture)
    }

    /// The image that the page shows.
    ///
    /// # Errors
    /// If the page fails.
    pub fn pixels(&mut self) -> Result<RgbImage> {
        let found = self.connection().evaluate(PIXELS)?;
        let side = |index: usize| found[index].as_u64().context("a size").map(|side| side as u32);
        let pixels = STANDARD.decode(found[2].as_str().context("pixels")?)?;
        let picture = RgbaImage::from_raw(side(0)?, side(1)?, pixels).context("pixels of that size")?;
        Ok(DynamicImage::from(picture).into_rgb8())
    }

    /// Nothing but the page itself was asked for, and no error or warning was reported.
    ///
    /// # Errors
    /// If it was, with what.
    pub fn is_silent(&mut self) -> Result<()> {
        // What the page did just now is reported before this is answered.
        self.connection().evaluate("new Promise(resolve => requestAnimationFrame(() => setTimeout(resolve, 0)))")?;
        let address = self.address.clone();
        let complaint = |event: &Value| -> Option<String> {
            let parameters = &event["params"];
            match event["method"].as_str()? {
                "Runtime.exceptionThrown" => Some(parameters["exceptionDetails"].to_string()),
                "Runtime.consoleAPICalled" if parameters["type"] != "log" => Some(parameters.to_string()),
                "Log.entryAdded" if !is_of_software(&parameters["entry"]) => Some(parameters["entry"].to_string()),
                "Network.requestWillBeSent" => {
                    let asked = parameters["request"]["url"].as_str().unwrap_or_default();
                    let is_own = asked.starts_with(&address) || asked == "about:blank";
                    (!is_own && !asked.starts_with("data:") && !asked.starts_with("blob:"))
                        .then(|| format!("asks for {asked}"))
                }
                _ => None,
            }
        };
        let complaints: Vec<String> = self.connection().events().iter().filter_map(complaint).collect();
        ensure!(complaints.is_empty(), "the browser complains: {}", complaints.join("; "));
        Ok(())
    }
}

/// Whether the browser tells that it draws without a GPU, which is so here.
fn is_of_software(entry: &Value) -> bool {
    let text = entry["text"].as_str().unwrap_or_default();
    text.contains("software WebGL") || text.contains("GPU stall due to ReadPixels")
}

/// The address of a file, whatever its name.
fn address(page: &Path) -> Result<String> {
    let path = page.canonicalize()?;
    let bytes = path.to_str().context("a path that is text")?.bytes();
    let safe = |byte: u8| byte.is_ascii_alphanumeric() || b"/-_.~".contains(&byte);
    let shown = bytes.map(|byte| if safe(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") });
    Ok(format!("file://{}", shown.collect::<String>()))
}
