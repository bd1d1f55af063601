//! A picture in memory or on disk, decoded when it is asked for.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::imageops::{self, FilterType};
use image::{DynamicImage, GrayImage, ImageReader, RgbImage};
use rayon::prelude::*;

use crate::DataError;

/// Fewest pixels along each side that are of any use.
const LEAST_SIDE: u32 = 16;

/// A picture in memory, or a file that is read on demand.
#[derive(Clone, Debug)]
pub enum Picture {
    /// Decoded already.
    Memory(Arc<RgbImage>),
    /// On disk; resized to `width` by `height` when read, if it has another size.
    File {
        /// Where it is.
        path: PathBuf,
        /// Width in pixels after reading.
        width: u32,
        /// Height in pixels after reading.
        height: u32,
    },
}

impl Picture {
    /// Width and height in pixels, without decoding.
    pub fn size(&self) -> (u32, u32) {
        match self {
            Picture::Memory(image) => image.dimensions(),
            Picture::File { width, height, .. } => (*width, *height),
        }
    }

    /// The picture as RGB, 8 bits a channel; a file of another size is resized with a Lanczos filter (METHOD §5.1).
    /// An alpha channel is dropped.
    ///
    /// # Errors
    /// [`DataError::Image`] if the file cannot be read or decoded.
    pub fn rgb(&self) -> Result<Arc<RgbImage>, DataError> {
        match self {
            Picture::Memory(image) => Ok(Arc::clone(image)),
            Picture::File { path, width, height } => {
                let image = decode(path)?.into_rgb8();
                Ok(Arc::new(match image.dimensions() == (*width, *height) {
                    true => image,
                    false => imageops::resize(&image, *width, *height, FilterType::Lanczos3),
                }))
            }
        }
    }

    /// The picture as a mask: its first channel, resized without blending.
    ///
    /// # Errors
    /// As [`Picture::rgb`].
    pub fn mask(&self) -> Result<GrayImage, DataError> {
        match self {
            Picture::Memory(image) => Ok(first_channel(image)),
            Picture::File { path, width, height } => {
                let mask = first_channel(&decode(path)?.into_rgb8());
                Ok(match mask.dimensions() == (*width, *height) {
                    true => mask,
                    false => imageops::resize(&mask, *width, *height, FilterType::Nearest),
                })
            }
        }
    }
}

/// Width and height of a picture file, from its header alone.
///
/// # Errors
/// [`DataError::Image`] if the header cannot be read.
pub(crate) fn file_size(path: &Path) -> Result<(u32, u32), DataError> {
    opened(path)?.into_dimensions().map_err(|e| unreadable(path, &e))
}

/// Width and height of picture files, which must all have one size, because batches are stacked. Reads the header of every
/// file. `folder` is the scene's and `advice` says how to get pictures of one size, for the message.
///
/// # Errors
/// [`DataError::Image`] if a header cannot be read, [`DataError::Disagreement`] if the sizes differ.
pub(crate) fn common_size(
    folder: &Path,
    files: &[impl AsRef<Path> + Sync],
    advice: &str,
) -> Result<(u32, u32), DataError> {
    let sizes: Vec<(u32, u32)> = files
        .par_iter()
        .map(|path| file_size(path.as_ref()))
        .collect::<Vec<_>>()
        .into_iter() // The first error in the order of the files, whichever thread met one first.
        .collect::<Result<_, _>>()?;
    let Some(&size) = sizes.first() else { return Ok((0, 0)) };
    if let Some(other) = sizes.iter().position(|&s| s != size) {
        let shown = |i: usize| {
            let path = files[i].as_ref();
            let path = path.strip_prefix(folder).unwrap_or(path);
            format!("{} has {} x {} pixels", path.display(), sizes[i].0, sizes[i].1)
        };
        return Err(DataError::Disagreement {
            folder: folder.to_owned(),
            first: shown(0),
            second: shown(other),
            advice: advice.to_owned(),
        });
    }
    Ok(size)
}

/// The size of pictures of `width` by `height` pixels that are made smaller by the factor `downscale`, the option of that
/// name.
///
/// # Errors
/// [`DataError::Setting`] if the factor is below 1, or so large that nothing of use is left.
pub(crate) fn reduced_size((width, height): (u32, u32), downscale: f64) -> Result<(u32, u32), DataError> {
    let refuse = |reason| DataError::Setting { option: "downscale", value: downscale.to_string(), reason };
    if !downscale.is_finite() || downscale < 1.0 {
        return Err(refuse("it must be 1 or more: pictures are made smaller, never larger".into()));
    }
    let smaller = |side: u32| (f64::from(side) / downscale).round() as u32;
    let (small_width, small_height) = (smaller(width), smaller(height));
    if small_width.min(small_height) < LEAST_SIDE {
        return Err(refuse(format!(
            "pictures of {width}x{height} would become {small_width}x{small_height}, \
             and each side needs at least {LEAST_SIDE} pixels"
        )));
    }
    Ok((small_width, small_height))
}

fn decode(path: &Path) -> Result<DynamicImage, DataError> {
    opened(path)?.decode().map_err(|e| unreadable(path, &e))
}

/// The kind of file is guessed from its content: photos with a wrong extension are common.
fn opened(path: &Path) -> Result<ImageReader<std::io::BufReader<std::fs::File>>, DataError> {
    ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(|e| unreadable(path, &e))
}

fn unreadable(path: &Path, reason: &dyn std::fmt::Display) -> DataError {
    DataError::Image { path: path.to_owned(), reason: reason.to_string() }
}

fn first_channel(image: &RgbImage) -> GrayImage {
    GrayImage::from_fn(image.width(), image.height(), |x, y| image::Luma([image.get_pixel(x, y).0[0]]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn saved(folder: &Path, image: &RgbImage) -> PathBuf {
        let path = folder.join("picture.png");
        image.save(&path).expect("written");
        path
    }

    #[test]
    fn a_file_of_the_right_size_comes_back_unchanged() {
        let folder = tempfile::tempdir().expect("folder");
        let image = RgbImage::from_fn(20, 16, |x, y| image::Rgb([x as u8, y as u8, 7]));
        let picture = Picture::File { path: saved(folder.path(), &image), width: 20, height: 16 };
        assert_eq!(*picture.rgb().expect("read"), image);
        assert_eq!(picture.size(), (20, 16));
    }

    #[test]
    fn a_file_of_another_size_is_resized_and_keeps_its_mean() {
        let folder = tempfile::tempdir().expect("folder");
        let image = RgbImage::from_fn(40, 32, |x, _| image::Rgb([3 * x as u8, 100, 7]));
        let small = Picture::File { path: saved(folder.path(), &image), width: 20, height: 16 }.rgb().expect("read");
        assert_eq!(small.dimensions(), (20, 16));
        let mean = small.pixels().map(|p| f64::from(p.0[0])).sum::<f64>() / 320.0;
        assert!((mean - 58.5).abs() < 1.0, "{mean}");
        assert!(small.pixels().all(|p| p.0[1] == 100 && p.0[2] == 7));
    }

    #[test]
    fn a_mask_stays_black_and_white_when_resized() {
        let folder = tempfile::tempdir().expect("folder");
        let image = RgbImage::from_fn(30, 30, |x, _| image::Rgb([if x < 13 { 255 } else { 0 }; 3]));
        let mask = Picture::File { path: saved(folder.path(), &image), width: 16, height: 16 }.mask().expect("read");
        assert!(mask.pixels().all(|p| p.0[0] == 0 || p.0[0] == 255));
        assert_eq!((mask.get_pixel(0, 3).0[0], mask.get_pixel(15, 3).0[0]), (255, 0));
    }

    #[test]
    fn a_file_that_is_no_picture_is_named_in_the_error() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("broken.png");
        std::fs::write(&path, b"not a picture").expect("written");
        let error = Picture::File { path, width: 16, height: 16 }.rgb().expect_err("broken");
        assert!(matches!(error, DataError::Image { .. }) && error.to_string().contains("broken.png"), "{error}");
    }
}
