//! Opening a file: its text, its JSON.

use std::fs::{self, File};
use std::io::read_to_string;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::error::DataError;

/// Advice for an unusable file of a dataset.
pub(crate) const COPY_OR_MEND: &str = "Copy the file again from the dataset, or mend the entry by hand";

/// Opens a regular file for reading. Links to pipes or devices are rejected, because reading them might never end.
///
/// # Errors
/// The operating system's message, or that it is not a file.
pub(crate) fn open_file(path: &Path) -> Result<File, String> {
    match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => Err("it is no file".into()),
        _ => File::open(path).map_err(|e| e.to_string()),
    }
}

/// The text of a file, without a byte order mark.
///
/// # Errors
/// Same as [`open_file`], and if the text is not UTF-8.
pub(crate) fn read_text(path: &Path) -> Result<String, String> {
    let text = read_to_string(open_file(path)?).map_err(|e| e.to_string())?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// The content of a JSON file.
///
/// # Errors
/// [`DataError::Content`] with the position in the file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, advice: &'static str) -> Result<T, DataError> {
    let content = read_text(path).and_then(|text| parse_json(&text));
    content.map_err(|reason| DataError::Content { path: path.to_owned(), reason, advice })
}

/// The content of a JSON text.
///
/// # Errors
/// The problem, and its position in the text.
pub(crate) fn parse_json<T: DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_str(text).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

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
