//! The cameras of a multi-camera video: folders `camNN` of frames, or files `camNN.mp4`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::error::DataError;
use crate::files::{entries, pictures_in};
use crate::readers::options::ReadOptions;
use crate::scene::PictureSource;
use crate::video::{FrameStore, Video};

/// Extensions of videos.
const VIDEO_EXTENSIONS: [&str; 2] = ["mp4", "MP4"];

/// A camera of the rig: its name and its frames.
#[derive(Debug)]
pub(crate) struct CameraFrames {
    /// `cam00`.
    pub(crate) name: String,
    /// The frames, in temporal order.
    pub(crate) frames: Vec<Frame>,
}

/// A frame of a camera.
#[derive(Clone, Debug)]
pub(crate) struct Frame {
    /// `0003`.
    pub(crate) name: String,
    /// The image.
    pub(crate) source: PictureSource,
}

/// The names of the cameras in `folder`, sorted: every folder `camNN` and every file `camNN.mp4` (or `.MP4`).
pub(crate) fn camera_names(folder: &Path) -> Result<Vec<String>, DataError> {
    let mut names = Vec::new();
    for path in entries(folder, "Give the folder of a scene")? {
        let is_video = path.extension().is_some_and(|e| VIDEO_EXTENSIONS.iter().any(|known| e == *known));
        let name = if is_video { path.file_stem() } else { path.file_name() };
        let Some(name) = name.and_then(|n| n.to_str()) else { continue };
        let number = name.strip_prefix("cam").unwrap_or("");
        let numbered = !number.is_empty() && number.bytes().all(|b| b.is_ascii_digit());
        if numbered && (is_video || path.is_dir()) {
            names.push(name.to_owned());
        }
    }
    names.sort();
    names.dedup();
    Ok(names)
}

/// The first `limit` frames of each camera. They are the images in the subfolder `inner` of the camera's folder,
/// otherwise the frames of its video.
///
/// # Errors
/// [`DataError::Missing`] if a camera has no frames. [`DataError::Disagreement`] if two cameras have different numbers
/// of frames. [`DataError::Content`] if two files are the same frame, or a video cannot be used.
pub(crate) fn list_frames(
    folder: &Path,
    names: &[String],
    inner: &str,
    options: &ReadOptions,
) -> Result<Vec<CameraFrames>, DataError> {
    let limit = options.frame_limit()?;
    let store = FrameStore::new(options.frame_store.as_deref());
    let mut cameras = Vec::with_capacity(names.len());
    for name in names {
        let pictures = folder.join(name).join(inner);
        let mut frames = extracted_frames(&pictures)?;
        let mut videos = VIDEO_EXTENSIONS.iter().map(|extension| folder.join(format!("{name}.{extension}")));
        if let Some(video) = videos.find(|path| frames.is_empty() && path.is_file()) {
            frames = frames_of_video(&video, limit, &store)?;
        }
        if frames.is_empty() {
            let what = format!("frame of the camera {name}");
            let advice = format!("Put its frames there as png or jpg files, or its video beside it as {name}.mp4");
            return Err(DataError::Missing { what, folder: pictures, advice });
        }
        frames.truncate(limit);
        cameras.push(CameraFrames { name: name.clone(), frames });
    }
    if let Some(other) = cameras.iter().find(|c| c.frames.len() != cameras[0].frames.len()) {
        let count = |c: &CameraFrames| format!("{} has {} frames", c.name, c.frames.len());
        let least = other.frames.len().min(cameras[0].frames.len());
        return Err(DataError::Disagreement {
            folder: folder.to_owned(),
            first: count(&cameras[0]),
            second: count(other),
            advice: format!("Extract the missing frames, or read fewer with the option frames = {least}"),
        });
    }
    Ok(cameras)
}

/// The images of a folder as frames; none if the folder does not exist.
fn extracted_frames(pictures: &Path) -> Result<Vec<Frame>, DataError> {
    let mut frames = BTreeMap::new();
    let files = if pictures.is_dir() { pictures_in(pictures)? } else { Vec::new() };
    for path in files {
        if let Some(twin) = frames.insert(temporal_order(&path), path.clone()) {
            return Err(DataError::Content {
                path,
                reason: format!("it is the same frame as {}", twin.display()),
                advice: "Remove one of the two files",
            });
        }
    }
    let frame = |path: PathBuf| Frame {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        source: PictureSource::Image(path),
    };
    Ok(frames.into_values().map(frame).collect())
}

fn frames_of_video(path: &Path, limit: usize, store: &FrameStore) -> Result<Vec<Frame>, DataError> {
    let video = Video::open(path, limit, store)?;
    let frame = |index| Frame {
        name: format!("{index:04}"),
        source: PictureSource::Frame { video: Arc::clone(&video), index },
    };
    Ok((0..video.len()).map(frame).collect())
}

/// Sort key: the name, with a number at its end compared by value, so that `frame_9` precedes `frame_10`.
fn temporal_order(path: &Path) -> (String, usize, String) {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let text = stem.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
    let number = stem[text.len()..].trim_start_matches('0').to_owned();
    (text, number.len(), number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_at_the_end_of_names_sort_by_value() {
        let mut names = ["f_10.png", "f_9.png", "f_0011.png", "e_12.png"].map(Path::new);
        names.sort_by_key(|p| temporal_order(p));
        assert_eq!(names, ["e_12.png", "f_9.png", "f_10.png", "f_0011.png"].map(Path::new));
    }
}
