//! Decoding of image files.

use std::io::{Cursor, Read};
use std::path::Path;

use image::{DynamicImage, ImageReader};

use super::jpeg;
use crate::error::DataError;
use crate::files::open_file;

/// Width and height of an image file, read only from its header.
///
/// # Errors
/// [`DataError::Image`] if the header cannot be read.
pub(crate) fn file_size(path: &Path) -> Result<(u32, u32), DataError> {
    opened(path)?.into_dimensions().map_err(|e| unreadable(path, &e))
}

pub(super) fn decode(path: &Path) -> Result<DynamicImage, DataError> {
    let mut bytes = Vec::new();
    let mut file = open_file(path).map_err(|e| unreadable(path, &e))?;
    file.read_to_end(&mut bytes).map_err(|e| unreadable(path, &e))?;
    if jpeg::is_broken_off(&bytes) {
        return Err(unreadable(path, &"the file ends before the picture does"));
    }
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| unreadable(path, &e))?;
    reader.decode().map_err(|e| unreadable(path, &e))
}

/// Guesses the file type from the content, because photos with a wrong extension are common.
fn opened(path: &Path) -> Result<ImageReader<std::io::BufReader<std::fs::File>>, DataError> {
    ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(|e| unreadable(path, &e))
}

fn unreadable(path: &Path, reason: &dyn std::fmt::Display) -> DataError {
    DataError::Image { path: path.to_owned(), reason: reason.to_string() }
}
