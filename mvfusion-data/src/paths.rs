//! Paths that stand in a scene's files, and the files' text.

use std::fs::{self, File};
use std::io::read_to_string;
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

/// Opens a file for reading. What is none is refused: a pipe or a device, which a link may lead to, would never end.
///
/// # Errors
/// What the operating system says, or that it is no file.
pub(crate) fn open_file(path: &Path) -> Result<File, String> {
    match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => Err("it is no file".into()),
        _ => File::open(path).map_err(|e| e.to_string()),
    }
}

/// The text of a file, without the mark that some editors put before it.
///
/// # Errors
/// As [`open_file`], and if it is no UTF-8.
pub(crate) fn read_text(path: &Path) -> Result<String, String> {
    let text = read_to_string(open_file(path)?).map_err(|e| e.to_string())?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// The content of a JSON file.
///
/// # Errors
/// [`DataError::Content`] with the place in the file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, advice: &'static str) -> Result<T, DataError> {
    let content = read_text(path).and_then(|text| parse_json(&text));
    content.map_err(|reason| DataError::Content { path: path.to_owned(), reason, advice })
}

/// The content of a JSON text.
///
/// # Errors
/// What is wrong, and the place in the text.
pub(crate) fn parse_json<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_str(text).map_err(|e| e.to_string())
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

    #[test]
    fn what_is_no_file_is_not_read_and_a_mark_before_the_text_is_none_of_it() {
        let folder = tempfile::tempdir().expect("folder");
        assert_eq!(open_file(folder.path()).err().as_deref(), Some("it is no file"));
        assert!(open_file(&folder.path().join("absent")).is_err_and(|reason| reason.contains("No such file")));
        #[cfg(unix)]
        assert_eq!(read_text(Path::new("/dev/null")), Err("it is no file".into()));
        let path = folder.path().join("marked.json");
        fs::write(&path, "\u{feff}[1, 2]").expect("written");
        assert_eq!(read_json::<Vec<u8>>(&path, "").expect("read"), [1, 2]);
        fs::write(&path, b"\xff").expect("written");
        assert!(read_text(&path).is_err_and(|reason| reason.contains("UTF-8")));
    }
}
