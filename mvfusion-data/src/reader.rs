//! Opens a scene's folder with the reader that knows its format.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::error::Refusal;
use crate::neu3d::{self, Neu3dOptions};
use crate::{DataError, Scene};

/// Options of all readers; each reads its own part.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReadOptions {
    /// For scenes in the layout of Neu3D.
    pub neu3d: Neu3dOptions,
}

/// Reads the scene in `folder`, whichever of the known formats it has.
///
/// # Errors
/// [`DataError::Folder`] if there is no such folder, [`DataError::Unrecognised`] with each reader's reason if no reader
/// takes it, else the error of the reader that took it.
pub fn open(folder: &Path, options: &ReadOptions) -> Result<Scene, DataError> {
    let refusal = match neu3d::recognise(folder)? {
        None => return neu3d::read(folder, &options.neu3d),
        Some(reason) => Refusal { format: neu3d::FORMAT, reason },
    };
    Err(DataError::Unrecognised { folder: folder.to_owned(), refusals: vec![refusal] })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_of_no_format_is_refused_with_the_reasons() {
        let folder = tempfile::tempdir().expect("folder");
        std::fs::write(folder.path().join("notes.txt"), "nothing").expect("written");
        let error = open(folder.path(), &ReadOptions::default()).expect_err("refused");
        assert!(matches!(&error, DataError::Unrecognised { refusals, .. } if refusals.len() == 1));
        assert!(error.to_string().contains("Neu3D: "), "{error}");
    }

    #[test]
    fn a_folder_that_does_not_exist_is_named() {
        let error = open(Path::new("no/such/folder"), &ReadOptions::default()).expect_err("refused");
        assert!(matches!(error, DataError::Folder { .. }) && error.to_string().contains("no/such/folder"));
    }
}
