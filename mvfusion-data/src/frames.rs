//! The cameras of a multi-camera video: folders `camNN` with frames, or files `camNN.mp4`.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::video::FrameStore;
use crate::{DataError, PictureSource, ReadOptions, Video};

/// Extensions of pictures, in lower case and in the order in which they are looked for. Some cameras write capitals.
const PICTURE_EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "exr"];

/// Extensions of videos.
const VIDEO_EXTENSIONS: [&str; 2] = ["mp4", "MP4"];

/// A camera of the rig: its name and its frames in order.
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
    /// The picture.
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

/// The frames of all cameras, the first `limit` of each: those in the folder `inner` of the camera's, or else those of its
/// video.
///
/// # Errors
/// [`DataError::Missing`] if a camera has none, [`DataError::Disagreement`] if two have different numbers of them,
/// [`DataError::Content`] if two files are the same frame, or a video cannot be used.
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

/// The pictures in a folder, sorted by name.
///
/// # Errors
/// [`DataError::Folder`] if it cannot be listed.
pub(crate) fn pictures_in(folder: &Path) -> Result<Vec<PathBuf>, DataError> {
    let mut paths = entries(folder, "Put the photos there")?;
    paths.retain(|path| is_picture(path));
    Ok(paths)
}

/// The picture of that name, but for the extension, in a folder or below it.
pub(crate) fn picture_named(folder: &Path, stem: &str) -> Option<PathBuf> {
    let spellings = PICTURE_EXTENSIONS.iter().flat_map(|extension| [(*extension).to_owned(), extension.to_uppercase()]);
    spellings.map(|extension| folder.join(format!("{stem}.{extension}"))).find(|path| path.is_file())
}

fn is_picture(path: &Path) -> bool {
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
    // macOS leaves a file `._0000.png` beside each `0000.png` on disks of other systems; it is no picture.
    let is_hidden = path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    PICTURE_EXTENSIONS.contains(&extension.as_str()) && !is_hidden
}

/// The pictures of a folder as frames; none if there is no such folder.
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

/// Sorts by name, but a number at its end by value, so that `frame_9` comes before `frame_10`.
fn temporal_order(path: &Path) -> (String, usize, String) {
    let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
    let text = stem.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned();
    let number = stem[text.len()..].trim_start_matches('0').to_owned();
    (text, number.len(), number)
}

/// The entries of a folder, sorted by name.
fn entries(folder: &Path, advice: &'static str) -> Result<Vec<PathBuf>, DataError> {
    let fail = |e: std::io::Error| DataError::Folder { folder: folder.to_owned(), reason: e.to_string(), advice };
    let listing: Result<Vec<_>, _> = fs::read_dir(folder).map_err(fail)?.map(|e| e.map(|e| e.path())).collect();
    let mut paths = listing.map_err(fail)?;
    paths.sort();
    Ok(paths)
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

    #[test]
    fn pictures_are_found_whatever_the_case_of_their_extension_and_hidden_files_are_none() {
        let folder = tempfile::tempdir().expect("folder");
        for name in ["b.JPG", "a.png", "._a.png", "notes.txt", "c.1.exr"] {
            fs::write(folder.path().join(name), "").expect("written");
        }
        let names = ["a.png", "b.JPG", "c.1.exr"].map(|name| folder.path().join(name));
        assert_eq!(pictures_in(folder.path()).expect("listed"), names);
        assert_eq!(["a", "b", "c.1"].map(|stem| picture_named(folder.path(), stem)), names.map(Some));
        assert_eq!(picture_named(folder.path(), "c"), None);
    }
}
