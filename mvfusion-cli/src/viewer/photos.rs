//! The photos of the scene, for pages.

use axum::body::Bytes;
use mvfusion_data::{DataError, Picture, Scene, preview};
use tokio::sync::Mutex;

use super::protocol::{ViewId, ViewSet};

/// JPEG quality of photos.
const QUALITY: u8 = 90;
/// Longest side of a photo that is sent, pixels. A page shows no larger ones.
const LONGEST: u32 = 1600;

/// The photos of a scene.
#[derive(Debug)]
pub struct Photos {
    train: Vec<Picture>,
    test: Vec<Picture>,
    /// The photo that was sent last. Whoever decodes one holds the lock, so many requests take no more memory than one.
    last: Mutex<Option<(ViewId, Bytes)>>,
}

impl Photos {
    /// The photos of all views.
    pub fn of(scene: &Scene) -> Self {
        let pictures = |views: &[mvfusion_data::View]| views.iter().map(|view| view.image.clone()).collect();
        Self { train: pictures(&scene.train), test: pictures(&scene.test), last: Mutex::default() }
    }

    /// The photo of a view as JPEG; `None` if there is no such view.
    pub async fn jpeg(&self, view: ViewId) -> Option<Result<Bytes, String>> {
        let picture = match view.set {
            ViewSet::Train => self.train.get(view.index),
            ViewSet::Test => self.test.get(view.index),
        }?;
        let mut last = self.last.lock().await;
        if let Some((_, jpeg)) = last.as_ref().filter(|(known, _)| *known == view) {
            return Some(Ok(jpeg.clone()));
        }
        let picture = picture.clone();
        let encoded = tokio::task::spawn_blocking(move || encoded(&picture).map_err(|error| error.to_string())).await;
        let encoded = encoded.unwrap_or_else(|_| Err("the photo could not be decoded".to_owned()));
        *last = encoded.as_ref().ok().map(|jpeg| (view, jpeg.clone()));
        Some(encoded)
    }
}

fn encoded(picture: &Picture) -> Result<Bytes, DataError> {
    let photo = picture.rgb()?;
    let (width, height) = photo.dimensions();
    let share = f64::from(LONGEST) / f64::from(width.max(height).max(1));
    let jpeg = if share < 1.0 {
        let side = |side: u32| ((f64::from(side) * share).round() as u32).max(1);
        preview::jpeg(&preview::resized(&photo, side(width), side(height)), QUALITY)
    } else {
        preview::jpeg(&photo, QUALITY)
    };
    let failed = |error: std::io::Error| DataError::Image { path: "photo".into(), reason: error.to_string() };
    Ok(jpeg.map_err(failed)?.into())
}
