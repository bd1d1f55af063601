//! The frames of a hand-held video as photos.

use std::fs;
use std::path::{Path, PathBuf};

use image::RgbImage;

use super::error::PrepareError;
use super::event::{Event, Listener, Tell};
use super::sharp::{Sharpest, Windows};
use crate::error::DataError;
use crate::files::denied;
use crate::video::{FrameStore, Video};

/// Frames per second that are taken by default.
const USUAL_FPS: f64 = 2.0;

/// The rate of a video that does not tell it.
const ASSUMED_FPS: f64 = 30.0;

/// Fewest frames from which COLMAP can compute poses.
const FEWEST_FRAMES: usize = 3;

/// So many frames take COLMAP hours.
const MANY_FRAMES: usize = 1000;

/// The rate of a video. A note says so if the file does not tell it.
///
/// # Errors
/// If the listener ends the preparation.
pub(super) fn rate(video: &Video, listen: &mut Listener<'_>) -> Result<f64, PrepareError> {
    if let Some(fps) = video.fps() {
        return Ok(fps);
    }
    let path = video.path().display();
    listen.note(format!("{path} does not tell its frame rate: {ASSUMED_FPS} frames per second are assumed"))?;
    Ok(ASSUMED_FPS)
}

/// Writes the sharpest frame of each window to `images`. Returns the indices of the frames in the video.
///
/// # Errors
/// If the video cannot be decoded, a frame cannot be written, or there are too few.
pub(super) fn choose(
    path: &Path,
    fps: Option<f64>,
    images: &Path,
    listen: &mut Listener<'_>,
) -> Result<Vec<usize>, PrepareError> {
    let video = Video::open(path, usize::MAX, &FrameStore::new(None))?;
    let filmed = rate(&video, listen)?;
    let taken = fps.unwrap_or(USUAL_FPS);
    let windows = Windows::new(filmed, taken);
    if taken > filmed {
        listen.note(format!("the video has {filmed:.2} frames per second, fewer than {taken}: all are taken"))?;
    }
    listen.tell(Event::Begins { what: "frames", total: video.len() })?;
    let (mut sharpest, mut chosen) = (Sharpest::default(), Vec::new());
    video.each_frame(&mut |index, frame| -> Result<(), PrepareError> {
        listen.tell(Event::Advances)?;
        if let Some((index, frame)) = sharpest.push(windows.of(index), index, frame) {
            save(images, index, &frame)?;
            chosen.push(index);
        }
        Ok(())
    })?;
    if let Some((index, frame)) = sharpest.finish() {
        save(images, index, &frame)?;
        chosen.push(index);
    }
    listen.tell(Event::Ends)?;
    let (count, all) = (chosen.len(), video.len());
    if count < FEWEST_FRAMES {
        let reason = format!(
            "only {count} of the video's {all} frames would be taken, and poses need at least {FEWEST_FRAMES}: give a \
             higher rate, up to {filmed:.2}"
        );
        return Err(PrepareError::Option { option: "--fps", reason });
    }
    listen.note(format!(
        "{count} of {all} frames are taken, the sharpest of each {:.1} ({taken} per second; --fps changes this)",
        windows.length()
    ))?;
    if count > MANY_FRAMES {
        listen.note(format!("COLMAP may take hours for {count} frames: --fps takes fewer"))?;
    }
    Ok(chosen)
}

/// The name of a frame, without extension. It sorts like the index.
pub(super) fn name(index: usize) -> String {
    format!("frame_{index:06}")
}

fn save(images: &Path, index: usize, frame: &RgbImage) -> Result<(), DataError> {
    let path = images.join(format!("{}.png", name(index)));
    frame.save(&path).map_err(|error| DataError::Folder {
        folder: images.to_owned(),
        reason: format!("{} cannot be written ({error})", path.display()),
        advice: "Check free space and write permission",
    })
}

/// Copies photos to `images`, under their names. Returns the names.
///
/// # Errors
/// If a name is no text, or a file cannot be copied.
pub(super) fn copy(photos: &[PathBuf], images: &Path, listen: &mut Listener<'_>) -> Result<Vec<String>, PrepareError> {
    let copied = |photo: &PathBuf| {
        listen.tell(Event::Continues)?;
        let name = photo.file_name().and_then(|name| name.to_str());
        let name = name.ok_or_else(|| PrepareError::Input {
            input: photo.clone(),
            reason: "its name is no UTF-8: rename it".into(),
        })?;
        fs::copy(photo, images.join(name)).map_err(|error| match denied(photo) {
            Some(path) => DataError::Denied { path }.into(),
            None => PrepareError::unwritable(&images.join(name), error),
        })?;
        Ok(name.to_owned())
    };
    photos.iter().map(copied).collect()
}
