//! Opens a scene's folder with the reader that knows its format.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::colmap::{self, ColmapOptions};
use crate::error::Refusal;
use crate::neu3d::{self, Neu3dOptions};
use crate::{DataError, Scene};

/// Options of all readers; each reads its own part.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReadOptions {
    /// For photo collections with a COLMAP model.
    pub colmap: ColmapOptions,
    /// For scenes in the layout of Neu3D.
    pub neu3d: Neu3dOptions,
}

/// Reads the scene in `folder`, whichever of the known formats it has. A folder of two formats is taken for the first of
/// COLMAP, Neu3D (METHOD §5.0).
///
/// # Errors
/// [`DataError::Folder`] if there is no such folder, [`DataError::Unrecognised`] with each reader's reason if no reader
/// takes it, else the error of the reader that took it.
pub fn open(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let mut refusals = Vec::new();
    match colmap::recognise(folder)? {
        None => return colmap::read(folder, &options.colmap),
        Some(reason) => refusals.push(Refusal { format: colmap::FORMAT, reason }),
    }
    match neu3d::recognise(folder)? {
        None => return neu3d::read(folder, &options.neu3d),
        Some(reason) => refusals.push(Refusal { format: neu3d::FORMAT, reason }),
    }
    Err(DataError::Unrecognised { folder: folder.to_owned(), refusals })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_no_format_is_refused_with_the_reasons() {
        let folder = tempfile::tempdir().expect("folder");
        std::fs::write(folder.path().join("notes.txt"), "nothing").expect("written");
        let error = open(folder.path(), &ReadOptions::default()).expect_err("refused");
        assert!(matches!(&error, DataError::Unrecognised { refusals, .. } if refusals.len() == 2));
        let message = error.to_string();
        assert!(message.contains("COLMAP: ") && message.contains("Neu3D: "), "{message}");
    }

    #[test]
    fn a_folder_that_does_not_exist_is_named() {
        let error = open(Path::new("no/such/folder"), &ReadOptions::default()).expect_err("refused");
        assert!(matches!(error, DataError::Folder { .. }) && error.to_string().contains("no/such/folder"));
    }
}
