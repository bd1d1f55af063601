//! The folders `camNN/images` of a multi-camera video: which cameras there are and which frames each has.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::DataError;

/// Extensions of frame files, in lower case.
const EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// A camera of the rig: its folder's name and its frames in order.
#[derive(Debug)]
pub(crate) struct CameraFrames {
    /// `cam00`.
    pub(crate) name: String,
    /// Files of the frames, in temporal order.
    pub(crate) frames: Vec<PathBuf>,
}

/// The names of the cameras in `folder`, sorted: every folder `camNN` and every file `camNN.mp4`.
pub(crate) fn camera_names(folder: &Path) -> Result<Vec<String>, DataError> {
    let mut names = Vec::new();
    for path in entries(folder, "Give the folder of a scene")? {
        let is_video = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("mp4"));
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

/// The frames of all cameras, the first `limit` of each.
///
/// # Errors
/// [`DataError::Missing`] if a camera has none, [`DataError::Disagreement`] if two have different numbers of them,
/// [`DataError::Content`] if two files are the same frame.
pub(crate) fn list_frames(folder: &Path, names: &[String], limit: usize) -> Result<Vec<CameraFrames>, DataError> {
    let mut cameras = Vec::with_capacity(names.len());
    for name in names {
        let mut frames = frames_of(folder, name)?;
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

fn frames_of(folder: &Path, name: &str) -> Result<Vec<PathBuf>, DataError> {
    let images = folder.join(name).join("images");
    let mut frames = BTreeMap::new();
    let files = if images.is_dir() { entries(&images, "Make the folder readable")? } else { Vec::new() };
    for path in files {
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or("").to_ascii_lowercase();
        if !EXTENSIONS.contains(&extension.as_str()) {
            continue;
        }
        if let Some(twin) = frames.insert(temporal_order(&path), path.clone()) {
            return Err(DataError::Content {
                path,
                reason: format!("it is the same frame as {}", twin.display()),
                advice: "Remove one of the two files",
            });
        }
    }
    if frames.is_empty() {
        return Err(no_frames(folder, name));
    }
    Ok(frames.into_values().collect())
}

fn no_frames(folder: &Path, name: &str) -> DataError {
    let video = folder.join(format!("{name}.mp4"));
    let advice = if video.is_file() {
        format!(
            "Extract them from the video: mkdir -p {name}/images && ffmpeg -i {name}.mp4 -start_number 0 \
             {name}/images/%04d.png (for Neu3D itself add -vf scale=1352:1014:flags=lanczos)"
        )
    } else {
        "Put its frames there as png or jpg files".into()
    };
    DataError::Missing { what: format!("frame of the camera {name}"), folder: folder.join(name).join("images"), advice }
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
}
