//! Decoding of image files.

use std::io::{BufRead, BufReader, Cursor, Read, Seek};
use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageReader, ImageResult};

use super::{ExifOrientation, PictureUse, check_shape, jpeg};
use crate::error::DataError;
use crate::files::{open_file, or_denied};

/// What the header of an image file says.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PictureHeader {
    /// Width and height of the pixels as they are stored.
    pub(crate) size: (u32, u32),
    /// The turn or mirroring that the metadata (EXIF) ask for.
    orientation: Orientation,
}

/// Bytes of a JPEG file that are read first. Its header is almost always among them.
const HEADER: u64 = 256 << 10;

/// The beginning of a JPEG file.
const JPEG: [u8; 2] = [0xff, 0xd8];

impl PictureHeader {
    /// Reads only the header. The file type is guessed from the content, because photos with a wrong extension are common.
    ///
    /// # Errors
    /// [`DataError::Image`] if the header cannot be read, [`DataError::Denied`] if the file may not be.
    pub(crate) fn read(path: &Path) -> Result<Self, DataError> {
        let mut file = open_file(path).map_err(|e| unreadable(path, &e))?;
        // The decoder of JPEG reads its whole input before it looks at the header.
        let mut head = Vec::new();
        file.by_ref().take(JPEG.len() as u64).read_to_end(&mut head).map_err(|e| unreadable(path, &e))?;
        let is_jpeg = head == JPEG;
        if is_jpeg {
            file.by_ref().take(HEADER).read_to_end(&mut head).map_err(|e| unreadable(path, &e))?;
        }
        if is_jpeg
            && let Ok(reader) = ImageReader::new(Cursor::new(&head)).with_guessed_format()
            && let Ok(header) = Self::of(reader)
        {
            return Ok(header);
        }
        file.rewind().map_err(|e| unreadable(path, &e))?;
        let reader = ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(|e| unreadable(path, &e))?;
        Self::of(reader).map_err(|e| unreadable(path, &e))
    }

    fn of(reader: ImageReader<impl BufRead + Seek>) -> ImageResult<Self> {
        let mut decoder = reader.into_decoder()?;
        // Metadata that cannot be read ask for no turn.
        let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
        Ok(Self { size: decoder.dimensions(), orientation })
    }

    /// Whether the metadata ask for another image than the stored one.
    pub(crate) fn is_turned(self) -> bool {
        self.orientation != Orientation::NoTransforms
    }

    /// Width and height of the image as the metadata ask for it.
    pub(crate) fn upright_size(self) -> (u32, u32) {
        use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
        match self.orientation {
            Rotate90 | Rotate90FlipH | Rotate270 | Rotate270FlipH => (self.size.1, self.size.0),
            _ => self.size,
        }
    }
}

/// The image in a file, turned as its metadata ask for if `exif` says so. It must have the aspect ratio of `wanted`,
/// which is checked before anything is decoded.
pub(super) fn decode(
    path: &Path,
    wanted: (u32, u32),
    exif: ExifOrientation,
    used_as: PictureUse,
) -> Result<DynamicImage, DataError> {
    let mut bytes = Vec::new();
    let mut file = open_file(path).map_err(|e| unreadable(path, &e))?;
    file.read_to_end(&mut bytes).map_err(|e| unreadable(path, &e))?;
    if jpeg::is_broken_off(&bytes) {
        return Err(unreadable(path, &"the file ends before the image does"));
    }
    let guessed = || ImageReader::new(Cursor::new(&bytes)).with_guessed_format().map_err(|e| unreadable(path, &e));
    let mut header = PictureHeader::of(guessed()?).map_err(|e| unreadable(path, &e))?;
    if exif != ExifOrientation::Applied {
        header.orientation = Orientation::NoTransforms;
    }
    check_shape(path, header.upright_size(), wanted, used_as)?;
    let mut image = guessed()?.decode().map_err(|e| unreadable(path, &e))?;
    image.apply_orientation(header.orientation);
    Ok(image)
}

fn unreadable(path: &Path, reason: &dyn std::fmt::Display) -> DataError {
    or_denied(DataError::Image { path: path.to_owned(), reason: reason.to_string() })
}
