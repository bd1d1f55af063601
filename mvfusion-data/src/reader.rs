//! Opens a scene's folder with the reader that knows its format.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::error::Refusal;
use crate::{DataError, Scene, View, colmap, dnerf, hypernerf, multipleview, nerfstudio, neu3d, onthego, panoptic};

/// How a scene is read.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadOptions {
    /// The format; tried in turn if absent.
    pub format: Option<Format>,
    /// Pictures are made smaller by this factor, at least 1. Default 1.
    pub downscale: f64,
    /// How many frames of each camera of a video are used, from the first on; all if absent. Default 300, as DeGauss.
    pub frames: Option<usize>,
    /// How a frame's index becomes a time.
    pub time: TimeRule,
    /// Where nothing says what a photo is for, every so many of the sorted photos is held out, from the first on; 0 holds
    /// none out. Default 8, LLFF's rule.
    pub test_every: usize,
    /// Names of the cameras to hold out instead of those that the format holds out; for formats whose views are named
    /// `camera/frame`.
    pub test_cameras: Option<Vec<String>>,
    /// RGB that shows where pictures are transparent. Default black.
    pub backdrop: [u8; 3],
    /// Whether black counts in masks, not white.
    pub invert_masks: bool,
    /// Folder in which the decoded frames of videos stay; a temporary one if absent.
    pub frame_store: Option<PathBuf>,
}

/// Number of frames by which the original divides a frame's index (METHOD §5.1).
const ORIGINAL_FRAMES: usize = 300;

impl Default for ReadOptions {
    fn default() -> Self {
        Self {
            format: None,
            downscale: 1.0,
            frames: Some(ORIGINAL_FRAMES),
            time: TimeRule::default(),
            test_every: 8,
            test_cameras: None,
            backdrop: [0; 3],
            invert_masks: false,
            frame_store: None,
        }
    }
}

/// How a frame's index becomes a time in `[0, 1]`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TimeRule {
    /// Index / number of frames used; the same as the original for 300 frames. The default.
    #[default]
    FrameOverCount,
    /// Index / 300, as in the original (METHOD §5.1), however many frames there are.
    #[serde(rename = "frame-over-300")]
    FrameOver300,
}

impl ReadOptions {
    /// How many frames of each camera are used at most.
    ///
    /// # Errors
    /// [`DataError::Setting`] for none.
    pub(crate) fn frame_limit(&self) -> Result<usize, DataError> {
        match self.frames {
            Some(0) => {
                let reason = "at least one frame is needed; leave it out for all".into();
                Err(DataError::Setting { option: "frames", value: "0".into(), reason })
            }
            limit => Ok(limit.unwrap_or(usize::MAX)),
        }
    }

    /// What the index of one of `count` frames is divided by to become a time.
    ///
    /// # Errors
    /// [`DataError::Setting`] if a time would lie beyond 1.
    pub(crate) fn times_divisor(&self, count: usize) -> Result<f64, DataError> {
        match self.time {
            TimeRule::FrameOverCount => Ok(count as f64),
            TimeRule::FrameOver300 if count <= ORIGINAL_FRAMES => Ok(ORIGINAL_FRAMES as f64),
            TimeRule::FrameOver300 => Err(DataError::Setting {
                option: "time",
                value: "frame-over-300".into(),
                reason: format!(
                    "{count} frames would reach beyond time 1; set frames = 300 or time = \"frame-over-count\""
                ),
            }),
        }
    }
}

/// The formats that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// See [`colmap`](crate::colmap).
    Colmap,
    /// See [`dnerf`](crate::dnerf).
    DNerf,
    /// See [`neu3d`](crate::neu3d).
    Neu3d,
    /// See [`hypernerf`](crate::hypernerf).
    HyperNerf,
    /// See [`panoptic`](crate::panoptic).
    Panoptic,
    /// See [`multipleview`](crate::multipleview).
    MultipleView,
    /// See [`onthego`](crate::onthego).
    OnTheGo,
    /// See [`nerfstudio`](crate::nerfstudio).
    Nerfstudio,
}

impl Format {
    /// All formats, in the order in which they are tried (METHOD §5.0, and then those that DeGauss does not know).
    pub const ALL: [Self; 8] = [
        Self::Colmap,
        Self::DNerf,
        Self::Neu3d,
        Self::HyperNerf,
        Self::Panoptic,
        Self::MultipleView,
        Self::OnTheGo,
        Self::Nerfstudio,
    ];

    /// Its name in configurations and on the command line.
    pub fn key(self) -> &'static str {
        match self {
            Self::Colmap => "colmap",
            Self::DNerf => "dnerf",
            Self::Neu3d => "neu3d",
            Self::HyperNerf => "hypernerf",
            Self::Panoptic => "panoptic",
            Self::MultipleView => "multipleview",
            Self::OnTheGo => "onthego",
            Self::Nerfstudio => "nerfstudio",
        }
    }

    /// The format of that key.
    pub fn of_key(key: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|format| format.key() == key)
    }

    /// Name for messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => colmap::FORMAT,
            Self::DNerf => dnerf::FORMAT,
            Self::Neu3d => neu3d::FORMAT,
            Self::HyperNerf => hypernerf::FORMAT,
            Self::Panoptic => panoptic::FORMAT,
            Self::MultipleView => multipleview::FORMAT,
            Self::OnTheGo => onthego::FORMAT,
            Self::Nerfstudio => nerfstudio::FORMAT,
        }
    }

    /// What `folder` misses to be in this format; `None` if it seems to be.
    fn missed_by(self, folder: &Path) -> Result<Option<String>, DataError> {
        match self {
            Self::Colmap => Ok(colmap::recognise(folder)),
            Self::DNerf => Ok(dnerf::recognise(folder)),
            Self::Neu3d => neu3d::recognise(folder),
            Self::HyperNerf => Ok(hypernerf::recognise(folder)),
            Self::Panoptic => Ok(panoptic::recognise(folder)),
            Self::MultipleView => Ok(multipleview::recognise(folder)),
            Self::OnTheGo => Ok(onthego::recognise(folder)),
            Self::Nerfstudio => Ok(nerfstudio::recognise(folder)),
        }
    }

    fn read(self, folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
        match self {
            Self::Colmap => colmap::read(folder, options),
            Self::DNerf => dnerf::read(folder, options),
            Self::Neu3d => neu3d::read(folder, options),
            Self::HyperNerf => hypernerf::read(folder, options),
            Self::Panoptic => panoptic::read(folder, options),
            Self::MultipleView => multipleview::read(folder, options),
            Self::OnTheGo => onthego::read(folder, options),
            Self::Nerfstudio => nerfstudio::read(folder, options),
        }
    }
}

/// The scene's name for people: the folder's.
pub(crate) fn scene_name(folder: &Path) -> String {
    let folder = std::path::absolute(folder).unwrap_or_else(|_| folder.to_owned());
    folder.file_name().map_or_else(|| "scene".into(), |name| name.to_string_lossy().into_owned())
}

/// The format of the scene in `folder`: the first that it fits, or the `forced` one if it fits that.
///
/// # Errors
/// [`DataError::Folder`] if there is no such folder, [`DataError::Unrecognised`] with the reason of each format that was
/// tried.
pub fn recognise(folder: &Path, forced: Option<Format>) -> Result<Format, DataError> {
    if let Err(error) = std::fs::read_dir(folder) {
        let advice = "Give the folder of a scene";
        return Err(DataError::Folder { folder: folder.to_owned(), reason: error.to_string(), advice });
    }
    let tried = forced.map_or(Format::ALL.to_vec(), |format| vec![format]);
    let mut refusals = Vec::new();
    for format in tried {
        match format.missed_by(folder)? {
            None => return Ok(format),
            Some(reason) => refusals.push(Refusal { format: format.name(), reason }),
        }
    }
    Err(DataError::Unrecognised { folder: folder.to_owned(), refusals })
}

/// Reads the scene in `folder`, whichever of the known formats it has (see [`recognise`]).
///
/// # Errors
/// Those of [`recognise`], and those of the reader: a [`DataError`] that says what is wrong with the folder, a file in it
/// or an option.
pub fn open(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let scene = recognise(folder, options.format)?.read(folder, options)?;
    match &options.test_cameras {
        Some(cameras) => hold_out(scene, folder, cameras),
        None => Ok(scene),
    }
}

/// Parts the views anew: those of the named cameras are held out, all others train.
fn hold_out(scene: Scene, folder: &Path, cameras: &[String]) -> Result<Scene, DataError> {
    let of_camera =
        |view: &View, camera: &str| view.name.strip_prefix(camera).is_some_and(|rest| rest.starts_with('/'));
    let mut views: BTreeMap<String, View> = BTreeMap::new();
    views.extend(scene.train.into_iter().chain(scene.test).map(|view| (view.name.clone(), view)));
    if let Some(unknown) = cameras.iter().find(|camera| !views.values().any(|view| of_camera(view, camera))) {
        let example = views.keys().next().map_or("", String::as_str);
        let reason = format!("no view is named `{unknown}/…`; the first is `{example}`");
        return Err(DataError::Setting { option: "test_cameras", value: format!("{cameras:?}"), reason });
    }
    let (test, train): (Vec<_>, Vec<_>) =
        views.into_values().partition(|view| cameras.iter().any(|camera| of_camera(view, camera)));
    if train.is_empty() {
        let advice = "Name fewer cameras in the option test_cameras".into();
        return Err(DataError::Missing { what: "camera to train on".into(), folder: folder.to_owned(), advice });
    }
    Ok(Scene { train, test, ..scene })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_no_format_is_refused_with_the_reasons() {
        let folder = tempfile::tempdir().expect("folder");
        std::fs::write(folder.path().join("notes.txt"), "nothing").expect("written");
        let error = open(folder.path(), &ReadOptions::default()).expect_err("refused");
        assert!(matches!(&error, DataError::Unrecognised { refusals, .. } if refusals.len() == Format::ALL.len()));
        let message = error.to_string();
        for format in Format::ALL {
            assert!(message.contains(&format!("{}: ", format.name())), "{message}");
        }
    }

    #[test]
    fn a_formats_key_is_what_configurations_write() {
        for format in Format::ALL {
            assert_eq!(serde_json::to_value(format).expect("json"), format.key());
        }
    }

    #[test]
    fn a_forced_format_is_the_only_one_that_is_tried() {
        let folder = tempfile::tempdir().expect("folder");
        let options = ReadOptions { format: Some(Format::DNerf), ..Default::default() };
        let message = open(folder.path(), &options).expect_err("refused").to_string();
        assert!(message.contains("transforms_train.json") && !message.contains("COLMAP"), "{message}");
    }

    #[test]
    fn a_folder_that_does_not_exist_is_named() {
        let error = open(Path::new("no/such/folder"), &ReadOptions::default()).expect_err("refused");
        assert!(matches!(error, DataError::Folder { .. }) && error.to_string().contains("no/such/folder"));
    }
}
