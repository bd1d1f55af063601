//! `train_list.txt` and `test_list.txt`, as the undistorted On-the-go scenes are distributed. Each line names a photo,
//! possibly with its folder and possibly without its extension.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::model::Photo;
use super::purpose::Purpose;
use crate::error::DataError;
use crate::files::dataset_text;
use crate::readers::shared::reduced::IMAGES;

/// The files and the purpose of the photos that they list.
pub(super) const LISTS: [(&str, Purpose); 2] = [("train_list.txt", Purpose::Train), ("test_list.txt", Purpose::Test)];

/// The lines of both files.
#[derive(Debug)]
pub(super) struct Lists([(PathBuf, Purpose, String); 2]);

/// The photo that a name refers to; `None` if the name is ambiguous.
type Places<'a> = BTreeMap<&'a Path, Option<usize>>;

impl Lists {
    /// Reads the files if they exist.
    ///
    /// # Errors
    /// [`DataError::Missing`] if only one of them exists, [`DataError::Content`] if one is not text.
    pub(super) fn read(scene: &Path) -> Result<Option<Self>, DataError> {
        let [train, test] = LISTS.map(|(name, _)| scene.join(name));
        match (train.is_file(), test.is_file()) {
            (false, false) => return Ok(None),
            (true, true) => {}
            (has_train, _) => {
                let [absent, other] = if has_train { [1, 0] } else { [0, 1] };
                return Err(DataError::Missing {
                    what: LISTS[absent].0.into(),
                    folder: scene.to_owned(),
                    advice: format!("{} is there: lists come in pairs, so add the other or remove it", LISTS[other].0),
                });
            }
        }
        let text = |path: PathBuf, purpose| -> Result<_, DataError> {
            let text = dataset_text(&path).map_err(|reason| fail(&path, reason))?;
            Ok((path, purpose, text))
        };
        Ok(Some(Self([text(train, Purpose::Train)?, text(test, Purpose::Test)?])))
    }

    /// The purpose of each photo.
    ///
    /// # Errors
    /// [`DataError::Content`] if a line names no photo of the model, more than one, or one that was listed before.
    pub(super) fn purposes(&self, photos: &[Photo]) -> Result<Vec<Purpose>, DataError> {
        let places = places(photos);
        let mut purposes = vec![Purpose::Neither; photos.len()];
        for (path, purpose, text) in &self.0 {
            for (index, line) in text.lines().enumerate().map(|(index, line)| (index, line.trim())) {
                if line.is_empty() {
                    continue;
                }
                let about = |what: &str| fail(path, format!("line {} ({line}) {what}", index + 1));
                let place = place(line, &places)
                    .ok_or_else(|| about("names no photo of the model"))?
                    .ok_or_else(|| about("may mean several photos of the model"))?;
                if purposes[place] != Purpose::Neither {
                    return Err(about("names a photo that was listed before"));
                }
                purposes[place] = *purpose;
            }
        }
        Ok(purposes)
    }
}

/// The photos by their full names and by shorter ones.
fn places(photos: &[Photo]) -> Places<'_> {
    let mut places = Places::new();
    for (index, photo) in photos.iter().enumerate() {
        let name = Path::new(&photo.name);
        let file = Path::new(name.file_name().unwrap_or_default());
        let short = [stripped(name), file, stripped(file)];
        for key in short.into_iter().filter(|key| *key != name) {
            places.entry(key).and_modify(|place| *place = place.filter(|known| *known == index)).or_insert(Some(index));
        }
    }
    // A full name is never ambiguous.
    places.extend(photos.iter().enumerate().map(|(index, photo)| (Path::new(photo.name.as_str()), Some(index))));
    places
}

/// The photo that a line refers to, with or without its extension. The folder of all photos may precede its name.
fn place(line: &str, places: &Places) -> Option<Option<usize>> {
    let whole = Path::new(line.strip_prefix("./").unwrap_or(line));
    let mut parts = whole.components();
    let in_images = parts.next()?.as_os_str().to_str().is_some_and(|folder| folder.starts_with(IMAGES));
    let inner = if in_images { parts.as_path() } else { whole };
    let keys = [whole, inner, stripped(whole), stripped(inner)];
    keys.into_iter().find_map(|key| places.get(key).copied())
}

/// A path without its extension.
fn stripped(path: &Path) -> &Path {
    let length = path.as_os_str().len() - path.extension().map_or(0, |extension| extension.len() + 1);
    path.to_str().and_then(|text| text.get(..length)).map_or(path, Path::new)
}

fn fail(path: &Path, reason: String) -> DataError {
    let advice = "It must hold the name of one photo a line, as in the model";
    DataError::Content { path: path.to_owned(), reason, advice }
}
