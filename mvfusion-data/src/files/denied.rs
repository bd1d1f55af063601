//! Files and folders that this program may not read. To most functions of the standard library, they look like missing
//! ones.

use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use super::open::open_file;
use crate::error::DataError;

/// The file or folder, or the folder above it, that this program may not read; `None` if all may be read, or there is
/// nothing at `path`.
pub(crate) fn denied(path: &Path) -> Option<PathBuf> {
    let opened = match fs::metadata(path) {
        // The files of a folder must be listed and found.
        Ok(metadata) if metadata.is_dir() => fs::read_dir(path).and_then(|_| fs::metadata(path.join("."))).map(drop),
        Ok(_) => open_file(path).map(drop),
        Err(error) if is_denial(&error) => {
            let above = path.ancestors().skip(1).find(|folder| fs::metadata(folder).is_ok());
            return Some(above.unwrap_or(path).to_owned());
        }
        Err(_) => return None,
    };
    opened.is_err_and(|error| is_denial(&error)).then(|| path.to_owned())
}

/// An error as it is, or [`DataError::Denied`] if this program may not read what the error names: then, what helps for
/// missing and broken files does not help.
pub(crate) fn or_denied(error: DataError) -> DataError {
    let path = match &error {
        DataError::Image { path, .. } | DataError::Content { path, .. } => path,
        DataError::Folder { folder, .. }
        | DataError::Missing { folder, .. }
        | DataError::Unrecognised { folder, .. } => folder,
        DataError::Denied { .. }
        | DataError::Disagreement { .. }
        | DataError::Setting { .. }
        | DataError::Scene { .. } => return error,
    };
    denied(path).map_or(error, |path| DataError::Denied { path })
}

fn is_denial(error: &io::Error) -> bool {
    error.kind() == ErrorKind::PermissionDenied
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_may_be_read_or_is_not_there_is_not_denied() {
        let folder = tempfile::tempdir().expect("folder");
        let file = folder.path().join("file");
        fs::write(&file, "x").expect("written");
        for path in [folder.path(), &file, &folder.path().join("absent/file"), &file.join("below"), Path::new("absent")]
        {
            assert_eq!(denied(path), None, "{}", path.display());
        }
        let error = or_denied(DataError::Image { path: file, reason: "torn".into() });
        assert!(matches!(error, DataError::Image { .. }), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn what_may_not_be_read_is_named_with_what_to_do() {
        use std::os::unix::fs::PermissionsExt;

        let folder = tempfile::tempdir().expect("folder");
        let (inner, file) = (folder.path().join("inner"), folder.path().join("inner/file"));
        fs::create_dir(&inner).expect("made");
        fs::write(&file, "x").expect("written");
        let permit = |path: &Path, mode: u32| {
            fs::set_permissions(path, fs::Permissions::from_mode(mode)).expect("permissions are set");
        };
        permit(&file, 0o000);
        if fs::read(&file).is_ok() {
            eprintln!("NOT TESTED: the administrator may read everything");
            return;
        }
        assert_eq!(denied(&file), Some(file.clone()));
        for mode in [0o000, 0o400] {
            permit(&inner, mode);
            for path in [&inner, &file, &inner.join("absent")] {
                assert_eq!(denied(path), Some(inner.clone()), "{mode:o} {}", path.display());
            }
        }
        let error = DataError::Missing { what: "file".into(), folder: inner.clone(), advice: "Put it there".into() };
        let said = or_denied(error).to_string();
        permit(&inner, 0o700);
        assert!(said.contains("permission denied") && said.contains("Make it readable"), "{said}");
        assert!(!said.contains("Put it there"), "{said}");
    }
}
