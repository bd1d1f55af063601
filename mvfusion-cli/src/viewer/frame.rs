//! What a page gets back: a picture with its facts, or the reason why there is none.

use std::time::{Duration, Instant};

use axum::body::Bytes;
use image::RgbImage;
use mvfusion_data::preview;
use serde::Serialize;
use serde_json::Value;

/// The answer to a request.
#[derive(Clone, Debug)]
pub enum Answer {
    /// A picture: the length of its facts in bytes as a little-endian `u32`, the facts as JSON, and a JPEG file.
    Frame(Bytes),
    /// There is none.
    Refused {
        /// Number of the request.
        id: u64,
        /// Why, and what to do.
        reason: String,
    },
}

/// The facts of a picture.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FrameFacts {
    /// Number of the request.
    pub id: u64,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Name of the layer.
    pub layer: &'static str,
    /// Steps that the model was trained for.
    pub step: usize,
    /// The time, if there is one.
    pub time: Option<f64>,
    /// Whether the temporal attention took part.
    pub mfta: bool,
    /// Gaussians of the static branch, and of the dynamic branch; how many of the latter are alive.
    pub gaussians: FrameGaussians,
    /// Milliseconds by part.
    pub ms: FrameTimes,
    /// Against the photo of the view, in dB, at the size of the picture; only for composed pictures from a view.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub psnr: Option<f64>,
    /// What black and white mean.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<ShownScale>,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct FrameGaussians {
    /// Of the static branch.
    #[serde(rename = "static")]
    pub static_: usize,
    /// Of the dynamic branch.
    pub dynamic: usize,
    /// Of the dynamic branch at this time.
    pub alive: usize,
}

/// Milliseconds by part. On a GPU, the first two are the times of the calls, and the third waits for them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct FrameTimes {
    /// The networks; 0 if the moment was cached.
    pub deform: f64,
    /// Both splats, and the blend.
    pub splat: f64,
    /// From tensors to pixels.
    pub read: f64,
    /// From pixels to JPEG.
    pub encode: f64,
}

/// What the ends of a grey or heat scale mean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
pub enum ShownScale {
    /// Depths in world units.
    Depth {
        /// White.
        near: f64,
        /// Black.
        far: f64,
    },
    /// A heat map of roots.
    Heat {
        /// The brightest colour.
        white: f64,
    },
}

/// Times of consecutive parts.
#[derive(Debug)]
pub struct Stopwatch(Instant);

impl Stopwatch {
    /// Starts.
    pub fn start() -> Self {
        Self(Instant::now())
    }

    /// Milliseconds since the start or the last lap.
    pub fn lap(&mut self) -> f64 {
        let now = Instant::now();
        let lap: Duration = now.duration_since(self.0);
        self.0 = now;
        1000.0 * lap.as_secs_f64()
    }
}

impl Answer {
    /// A picture with its facts. Adds the time of the encoding to them.
    ///
    /// # Errors
    /// If the picture cannot be encoded.
    pub fn frame(mut facts: FrameFacts, picture: &RgbImage, quality: u8) -> anyhow::Result<Self> {
        let mut watch = Stopwatch::start();
        let jpeg = preview::jpeg(picture, quality)?;
        facts.ms.encode = watch.lap();
        let facts = serde_json::to_vec(&facts)?;
        let mut bytes = Vec::with_capacity(4 + facts.len() + jpeg.len());
        bytes.extend(u32::try_from(facts.len())?.to_le_bytes());
        bytes.extend(facts);
        bytes.extend(jpeg);
        Ok(Self::Frame(bytes.into()))
    }
}

/// The facts and the JPEG file of a frame; `None` if the bytes are no frame.
pub fn parts(frame: &[u8]) -> Option<(Value, &[u8])> {
    let (length, rest) = frame.split_first_chunk()?;
    let (facts, jpeg) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    Some((serde_json::from_slice(facts).ok()?, jpeg))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_is_its_facts_and_a_jpeg_behind_them() {
        let facts = FrameFacts {
            id: 9,
            width: 32,
            height: 16,
            layer: "composed",
            step: 100,
            time: Some(0.5),
            mfta: true,
            gaussians: FrameGaussians { static_: 5, dynamic: 4, alive: 3 },
            ms: FrameTimes::default(),
            psnr: None,
            scale: Some(ShownScale::Heat { white: 0.25 }),
        };
        let Answer::Frame(bytes) = Answer::frame(facts, &RgbImage::new(32, 16), 80).expect("encoded") else {
            panic!("a frame")
        };
        let (facts, jpeg) = parts(&bytes).expect("a frame");
        assert!(parts(&bytes[..20]).is_none() && parts(&[]).is_none());
        assert_eq!((facts["id"].as_u64(), facts["gaussians"]["static"].as_u64()), (Some(9), Some(5)));
        assert_eq!((facts["scale"]["kind"].as_str(), facts.get("psnr")), (Some("heat"), None));
        assert_eq!(image::load_from_memory(jpeg).expect("decoded").into_rgb8().dimensions(), (32, 16));
    }
}
