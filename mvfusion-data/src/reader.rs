//! Opens a scene's folder with the reader that knows its format.

use std::collections::BTreeSet;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::Refusal;
use crate::{
    DataError, ReadOptions, Scene, View, colmap, dnerf, hypernerf, multipleview, nerfstudio, neu3d, onthego, panoptic,
};

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

/// Parts the views anew: those of the named cameras are held out, all others train. They stand camera by camera and in the
/// order of time, whatever the frames are called.
fn hold_out(scene: Scene, folder: &Path, cameras: &[String]) -> Result<Scene, DataError> {
    // Where frames are trained on and looked at, they are in both parts.
    let mut known = BTreeSet::new();
    let views = scene.train.into_iter().chain(scene.test);
    let mut views: Vec<View> = views.filter(|view| known.insert(view.name.clone())).collect();
    let camera_of = |view: &View| view.name.rsplit_once('/').map_or(String::new(), |(camera, _)| camera.to_owned());
    views.sort_by(|a, b| camera_of(a).cmp(&camera_of(b)).then(a.time.total_cmp(&b.time)));
    let is_of = |view: &View, camera: &str| view.name.strip_prefix(camera).is_some_and(|rest| rest.starts_with('/'));
    if let Some(unknown) = cameras.iter().find(|camera| !views.iter().any(|view| is_of(view, camera))) {
        let example = views.first().map_or("", |view| view.name.as_str());
        let reason = format!("no view is named `{unknown}/…`; the first is `{example}`");
        return Err(DataError::Setting { option: "test_cameras", value: format!("{cameras:?}"), reason });
    }
    let (test, train): (Vec<_>, Vec<_>) =
        views.into_iter().partition(|view| cameras.iter().any(|camera| is_of(view, camera)));
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
