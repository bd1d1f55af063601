//! Opening a file: its text, its JSON.

use std::fs::{self, File};
use std::io::{self, Read};
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::error::DataError;

/// Advice for an unusable file of a dataset.
pub(crate) const COPY_OR_MEND: &str = "Copy the file again from the dataset, or mend the entry by hand";

/// Opens a regular file for reading. Links to pipes or devices are rejected, because reading them might never end.
///
/// # Errors
/// The operating system's error, or [`io::ErrorKind::InvalidInput`] if it is not a file.
pub fn open_file(path: &Path) -> io::Result<File> {
    match fs::metadata(path) {
        Ok(metadata) if !metadata.is_file() => Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no file")),
        _ => File::open(path),
    }
}

/// The content of a file that no program makes larger than `most` bytes.
///
/// # Errors
/// Same as [`open_file`], and [`io::ErrorKind::FileTooLarge`] for a larger file, of which no more is read.
pub fn read_bytes(path: &Path, most: u64) -> io::Result<Vec<u8>> {
    let file = open_file(path)?;
    let too_large = || io::Error::new(io::ErrorKind::FileTooLarge, format!("it is larger than {most} bytes"));
    if file.metadata()?.len() > most {
        return Err(too_large());
    }
    let mut bytes = Vec::new();
    // A file may grow while it is read, and those of some file systems tell no size.
    let length = file.take(most.saturating_add(1)).read_to_end(&mut bytes)?;
    if length as u64 > most { Err(too_large()) } else { Ok(bytes) }
}

/// The text of a file of at most `most` bytes, without a byte order mark.
///
/// # Errors
/// Same as [`read_bytes`], and [`io::ErrorKind::InvalidData`] if the text is not UTF-8.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let text = String::from_utf8(read_bytes(path, most)?)
        .map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "its text is not UTF-8"))?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// The text of a file of a dataset, which may have any size.
///
/// # Errors
/// Same as [`read_text`].
pub(crate) fn dataset_text(path: &Path) -> Result<String, String> {
    read_text(path, u64::MAX).map_err(|e| e.to_string())
}

/// The content of a JSON file.
///
/// # Errors
/// [`DataError::Content`] with the position in the file.
pub(crate) fn read_json<T: DeserializeOwned>(path: &Path, advice: &'static str) -> Result<T, DataError> {
    let content = dataset_text(path).and_then(|text| parse_json(&text));
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
        let kind = |path: &Path| open_file(path).map(drop).map_err(|error| error.kind());
        assert_eq!(kind(folder.path()), Err(io::ErrorKind::InvalidInput));
        assert_eq!(kind(&folder.path().join("absent")), Err(io::ErrorKind::NotFound));
        #[cfg(unix)]
        assert_eq!(dataset_text(Path::new("/dev/zero")), Err("it is no file".into()));
        let path = folder.path().join("marked.json");
        fs::write(&path, "\u{feff}[1, 2]").expect("written");
        assert_eq!(read_json::<Vec<u8>>(&path, "").expect("read"), [1, 2]);
        fs::write(&path, b"\xff").expect("written");
        assert!(dataset_text(&path).is_err_and(|reason| reason.contains("UTF-8")));
    }

    #[test]
    fn a_file_that_is_larger_than_its_kind_can_be_is_not_read() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("file");
        fs::write(&path, "12345").expect("written");
        assert_eq!(read_text(&path, 5).expect("read"), "12345");
        assert_eq!(read_bytes(&path, 4).expect_err("refused").kind(), io::ErrorKind::FileTooLarge);
        // A file of no size by the system's account.
        #[cfg(target_os = "linux")]
        assert_eq!(
            read_bytes(Path::new("/proc/self/maps"), 10).expect_err("refused").kind(),
            io::ErrorKind::FileTooLarge
        );
    }
}
