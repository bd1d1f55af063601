//! The cameras of a multi-camera video: folders `camNN` of frames, or files `camNN.mp4`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::frame_numbers::{FrameNumber, NumberedFrames, check_numbers};
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
    /// Number of its frames, used or not.
    available: usize,
    matching: Matching,
}

/// How the frames of a camera are matched with those of other cameras.
#[derive(Debug)]
enum Matching {
    /// By the numbers at the end of their names. These are the numbers of all frames, used or not.
    Numbers(Vec<FrameNumber>),
    /// By their order, because their names differ in more than a number. This is such a name.
    Names(String),
    /// By their order in a video, which has no gaps.
    Video,
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

/// The first frames of each camera ([`ReadOptions::frames`]). They are the images in the subfolder `inner` of the
/// camera's folder, otherwise the frames of its video. Frames at the same place show the same moment.
///
/// # Errors
/// [`DataError::Missing`] if a camera has no frames. [`DataError::Disagreement`] if a camera lacks a frame that another
/// one has. [`DataError::Content`] if two files are the same frame, or a video cannot be used.
pub(crate) fn list_frames(
    folder: &Path,
    names: &[String],
    inner: &str,
    options: &ReadOptions,
) -> Result<Vec<CameraFrames>, DataError> {
    let limit = options.frame_limit()?;
    let store = FrameStore::new(options.frame_store.as_deref());
    let camera = |name: &String| frames_of_camera(folder, name, inner, limit, &store);
    let cameras = names.iter().map(camera).collect::<Result<Vec<_>, _>>()?;
    check_numbered(folder, &cameras, limit)?;
    check_counts(folder, &cameras)?;
    options.warn_of_unused_frames(folder, cameras.iter().map(|camera| camera.available).max().unwrap_or(0));
    Ok(cameras)
}

/// The first `limit` frames of a camera.
fn frames_of_camera(
    folder: &Path,
    name: &str,
    inner: &str,
    limit: usize,
    store: &FrameStore,
) -> Result<CameraFrames, DataError> {
    let pictures = folder.join(name).join(inner);
    let (mut frames, mut matching) = extracted_frames(&pictures)?;
    let mut available = frames.len();
    let mut videos = VIDEO_EXTENSIONS.iter().map(|extension| folder.join(format!("{name}.{extension}")));
    if let Some(video) = videos.find(|path| frames.is_empty() && path.is_file()) {
        let video = Video::open(&video, limit, store)?;
        available = video.available();
        (frames, matching) = (frames_of_video(&video), Matching::Video);
    }
    if frames.is_empty() {
        let what = format!("frame of the camera {name}");
        let advice = format!("Put its frames there as png or jpg files, or its video beside it as {name}.mp4");
        return Err(DataError::Missing { what, folder: pictures, advice });
    }
    frames.truncate(limit);
    Ok(CameraFrames { name: name.to_owned(), frames, available, matching })
}

/// Checks cameras whose frames are numbered: no camera lacks a frame that another one has.
fn check_numbered(folder: &Path, cameras: &[CameraFrames], limit: usize) -> Result<(), DataError> {
    let numbered = cameras.iter().find_map(|camera| match camera {
        CameraFrames { name, matching: Matching::Numbers(numbers), .. } => Some(NumberedFrames { name, numbers }),
        _ => None,
    });
    let Some(first) = numbered else { return Ok(()) };
    // With one photo of each camera, nothing can be in the place of another.
    if cameras.iter().all(|camera| matches!(&camera.matching, Matching::Numbers(numbers) if numbers.len() == 1)) {
        return Ok(());
    }
    let disagreement = |first, second, advice: &str| DataError::Disagreement {
        folder: folder.to_owned(),
        first,
        second,
        advice: advice.into(),
    };
    for other in cameras {
        match &other.matching {
            Matching::Numbers(numbers) => {
                let other = NumberedFrames { name: &other.name, numbers };
                check_numbers(folder, [first, other], limit, "every camera")?;
            }
            Matching::Names(name) => {
                return Err(disagreement(
                    format!("the frames of {} are named by their numbers", first.name),
                    format!("{} has a frame {name}", other.name),
                    "Name all frames alike, one text and a number, and move other images elsewhere",
                ));
            }
            Matching::Video => {
                let gap = first.used(limit).windows(2).find_map(|pair| pair[0].next().filter(|next| *next != pair[1]));
                if let Some(absent) = gap {
                    return Err(disagreement(
                        format!("{} has no frame {absent}", first.name),
                        format!("{} is a video, which has every frame", other.name),
                        "Add the frame, or extract the frames of the video and remove those that others lack",
                    ));
                }
            }
        }
    }
    Ok(())
}

/// Checks that all cameras have equally many frames.
fn check_counts(folder: &Path, cameras: &[CameraFrames]) -> Result<(), DataError> {
    let Some(other) = cameras.iter().find(|c| c.frames.len() != cameras[0].frames.len()) else { return Ok(()) };
    let count = |camera: &CameraFrames| match camera.frames.len() {
        1 => format!("{} has 1 frame", camera.name),
        many => format!("{} has {many} frames", camera.name),
    };
    let least = other.frames.len().min(cameras[0].frames.len());
    Err(DataError::Disagreement {
        folder: folder.to_owned(),
        first: count(&cameras[0]),
        second: count(other),
        advice: format!(
            "Without numbers in their names, frames are matched by their order: add the missing ones. If only the last \
             ones are missing, read fewer with `--set scene.frames={least}`"
        ),
    })
}

/// The images of a folder as frames; none if the folder does not exist.
fn extracted_frames(pictures: &Path) -> Result<(Vec<Frame>, Matching), DataError> {
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
    let matching = matching(frames.keys());
    let frame = |path: PathBuf| Frame {
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        source: PictureSource::Image(path),
    };
    Ok((frames.into_values().map(frame).collect(), matching))
}

/// How frames with these names, each a text and a number, are matched: by number if there is one text, and all have a
/// number.
fn matching<'a>(names: impl Iterator<Item = &'a (String, Option<FrameNumber>)> + Clone) -> Matching {
    let unnumbered = names.clone().find(|(_, number)| number.is_none());
    let usual = names.clone().next().map(|(text, _)| text);
    match unnumbered.or_else(|| names.clone().find(|(text, _)| Some(text) != usual)) {
        Some((text, number)) => {
            Matching::Names(format!("{text}{}", number.as_ref().map_or(String::new(), ToString::to_string)))
        }
        None => Matching::Numbers(names.filter_map(|(_, number)| number.clone()).collect()),
    }
}

fn frames_of_video(video: &Arc<Video>) -> Vec<Frame> {
    let frame =
        |index| Frame { name: format!("{index:04}"), source: PictureSource::Frame { video: Arc::clone(video), index } };
    (0..video.len()).map(frame).collect()
}

/// Sort key: the name, with a number at its end compared by value, so that `frame_9` precedes `frame_10`.
fn temporal_order(path: &Path) -> (String, Option<FrameNumber>) {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let (text, number) = FrameNumber::split(&stem);
    (text.to_owned(), number)
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
