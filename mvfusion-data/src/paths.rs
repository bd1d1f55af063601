//! Paths that stand in a scene's files, and the files' text.

use std::fs;
use std::path::{Component, Path, PathBuf};

use serde::de::DeserializeOwned;

use crate::DataError;

/// A path below `folder`, of a name that was found in a file: scenes are passed on, and none may reach beyond its folder.
///
/// # Errors
/// If the name is empty, absolute, or leads upwards.
pub(crate) fn below(folder: &Path, name: &str) -> Result<PathBuf, String> {
    let path = Path::new(name);
    let inside = |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
    if path.components().all(inside) && path.file_name().is_some() {
        Ok(folder.join(path.strip_prefix("./").unwrap_or(path)))
    } else {
        Err(format!("the path `{name}` leads out of the folder; it must be relative and free of `..`"))
    }
}

/// The content of a JSON file.
///
/// # Errors
/// [`DataError::Content`] with the place in the file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, advice: &'static str) -> Result<T, DataError> {
    let fail = |reason: String| DataError::Content { path: path.to_owned(), reason, advice };
    let text = fs::read_to_string(path).map_err(|e| fail(e.to_string()))?;
    serde_json::from_str(&text).map_err(|e| fail(e.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_below_their_folder() {
        let folder = Path::new("scene");
        assert_eq!(below(folder, "./a/b.png"), Ok(PathBuf::from("scene/a/b.png")));
        assert_eq!(below(folder, "a/./b"), Ok(PathBuf::from("scene/a/b")));
        for name in ["", ".", "..", "/etc/passwd", "a/../../b", "../b"] {
            let reason = below(folder, name).expect_err(name);
            assert!(reason.contains(&format!("`{name}`")), "{reason}");
        }
    }
}
