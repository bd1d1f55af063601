//! Opening a scene's folder with the reader that recognises it.

use std::collections::BTreeSet;
use std::path::Path;

use tracing::{info, warn};

use super::format::Format;
use super::options::ReadOptions;
use super::reader::Reader;
use super::table::READERS;
use crate::error::{DataError, Refusal};
use crate::files::or_denied;
use crate::scene::{Scene, View};

/// The format of the scene in `folder`: the first that fits, or the `forced` one if it fits.
///
/// # Errors
/// [`DataError::Folder`] if the folder does not exist, [`DataError::Denied`] if it may not be read.
/// [`DataError::Unrecognised`] with the reasons of all formats that were tried.
pub fn recognise(folder: &Path, forced: Option<Format>) -> Result<Format, DataError> {
    reader_for(folder, forced).map(|reader| reader.format)
}

/// The reader of the scene in `folder`.
///
/// # Errors
/// Same as [`recognise`].
pub(crate) fn reader_for(folder: &Path, forced: Option<Format>) -> Result<&'static Reader, DataError> {
    if let Err(error) = std::fs::read_dir(folder) {
        let advice = "Give the folder of a scene";
        return Err(or_denied(DataError::Folder { folder: folder.to_owned(), reason: error.to_string(), advice }));
    }
    let is_tried = |reader: &&Reader| forced.is_none_or(|format| format == reader.format);
    let mut refusals = Vec::new();
    for reader in READERS.iter().filter(is_tried) {
        match (reader.recognise)(folder) {
            None => return Ok(reader),
            Some(reason) => refusals.push(Refusal { format: reader.format.name(), reason }),
        }
    }
    Err(or_denied(DataError::Unrecognised { folder: folder.to_owned(), refusals }))
}

/// Reads the scene in `folder`, whichever format it has (see [`recognise`]).
///
/// # Errors
/// Those of [`recognise`], and those of the reader: a [`DataError`] that names the problem with the folder, a file in
/// it or an option.
pub fn open(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let reader = reader_for(folder, options.format)?;
    if options.format.is_none() {
        let others =
            READERS.iter().filter(|other| other.format != reader.format && (other.recognise)(folder).is_none());
        let others: Vec<&str> = others.map(|other| other.format.key()).collect();
        if !others.is_empty() {
            info!(
                "{}: read as {}; it also fits {} (--format)",
                folder.display(),
                reader.format.key(),
                others.join(", ")
            );
        }
    }
    let scene = (reader.read)(folder, options).map_err(or_denied)?;
    if let Some(what) = (reader.hints.ignored_masks)(folder, &scene) {
        warn!(folder = %folder.display(), "{what}");
    }
    let scene = Scene { capture: options.capture.unwrap_or(scene.capture), ..scene };
    match &options.test_cameras {
        Some(cameras) => hold_out(scene, folder, cameras),
        None => Ok(scene),
    }
}

/// Replaces the split: views of the named cameras are held out, all others train. They are sorted by camera, then by
/// time, whatever the names of the frames.
fn hold_out(scene: Scene, folder: &Path, cameras: &[String]) -> Result<Scene, DataError> {
    // Some formats contain the same frame in both parts.
    let mut known = BTreeSet::new();
    let views = scene.train.into_iter().chain(scene.test);
    let mut views: Vec<View> = views.filter(|view| known.insert(view.name.clone())).collect();
    let camera_of = |view: &View| view.name.rsplit_once('/').map_or(String::new(), |(camera, _)| camera.to_owned());
    views.sort_by(|a, b| camera_of(a).cmp(&camera_of(b)).then(a.time.total_cmp(&b.time)));
    let is_of = |view: &View, camera: &str| view.name.strip_prefix(camera).is_some_and(|rest| rest.starts_with('/'));
    if let Some(unknown) = cameras.iter().find(|camera| !views.iter().any(|view| is_of(view, camera))) {
        let example = views.first().map_or("", |view| view.name.as_str());
        let reason = format!("no view is named `{unknown}/…`; the first is `{example}`");
        let advice = match set_cameras(&views) {
            Some(setting) => format!("Name cameras of this scene, for example {setting}"),
            None => "Remove it: the views of this scene are not named by cameras".to_owned(),
        };
        return Err(DataError::Setting { option: "test_cameras", value: format!("{cameras:?}"), reason, advice });
    }
    let (test, train): (Vec<_>, Vec<_>) =
        views.into_iter().partition(|view| cameras.iter().any(|camera| is_of(view, camera)));
    if train.is_empty() {
        let example = set_cameras(&test).map_or(String::new(), |setting| format!(", for example {setting}"));
        let advice = format!("Hold out fewer cameras{example}");
        return Err(DataError::Missing { what: "camera to train on".into(), folder: folder.to_owned(), advice });
    }
    Ok(Scene { train, test, ..scene })
}

/// How to hold out only the camera of the first view; `None` if its name has none.
fn set_cameras(views: &[View]) -> Option<String> {
    let (camera, _) = views.first()?.name.rsplit_once('/')?;
    Some(format!("`--set 'scene.test_cameras=[{camera:?}]'`"))
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
    fn a_forced_format_is_the_only_one_that_is_tried() {
        let folder = tempfile::tempdir().expect("folder");
        let options = ReadOptions { format: Some(Format::DNERF), ..Default::default() };
        let message = open(folder.path(), &options).expect_err("refused").to_string();
        assert!(message.contains("transforms_train.json") && !message.contains("COLMAP"), "{message}");
    }

    #[test]
    fn a_folder_that_does_not_exist_is_named() {
        let error = open(Path::new("no/such/folder"), &ReadOptions::default()).expect_err("refused");
        assert!(matches!(error, DataError::Folder { .. }) && error.to_string().contains("no/such/folder"));
    }
}
