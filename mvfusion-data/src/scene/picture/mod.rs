//! An image in memory or on disk, decoded on demand.

mod binarise;
mod colours;
mod decode;
mod jpeg;
mod shape;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::imageops::{self, FilterType};
use image::{DynamicImage, GrayImage, RgbImage};

use super::lens::Lens;
use super::undistort::{straighten, straighten_mask};
use crate::error::DataError;
use crate::video::Video;
use binarise::black_and_white;
use colours::to_rgb8;
use decode::decode;

pub(crate) use decode::PictureHeader;
pub(crate) use shape::{PictureUse, check_shape};

/// An image in memory, or a file that is decoded on demand.
#[derive(Clone, Debug)]
pub enum Picture {
    /// Decoded already.
    Memory(Arc<RgbImage>),
    /// On disk.
    File(PictureFile),
}

/// An image on disk, and the steps after decoding it: turn, composite over a backdrop, resize, undistort.
#[derive(Clone, Debug)]
pub struct PictureFile {
    /// Its location.
    pub source: PictureSource,
    /// Width in pixels after decoding.
    pub width: u32,
    /// Height in pixels after decoding.
    pub height: u32,
    /// RGB colour behind transparent pixels. Without one, an alpha channel is dropped.
    pub backdrop: Option<[u8; 3]>,
    /// The lens of the photo and the pinhole to undistort it to, both for the size after decoding.
    pub lenses: Option<Arc<[Lens; 2]>>,
    /// What becomes of the orientation in the file's metadata.
    pub exif: ExifOrientation,
}

/// What becomes of the orientation that the metadata (EXIF) of an image file ask for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExifOrientation {
    /// They ask for none.
    #[default]
    Absent,
    /// The pixels are used as they are stored, because the camera is for an image of that size.
    Ignored,
    /// The image is turned, because only so it has the shape that the camera is for.
    Applied,
}

/// The location of an image.
#[derive(Clone, Debug)]
pub enum PictureSource {
    /// A separate file.
    Image(PathBuf),
    /// A frame of a video.
    Frame {
        /// The video.
        video: Arc<Video>,
        /// Index of the frame, from 0.
        index: usize,
    },
}

impl PictureSource {
    /// The file, for messages.
    pub fn path(&self) -> &Path {
        match self {
            Self::Image(path) => path,
            Self::Frame { video, .. } => video.path(),
        }
    }

    /// Width and height in pixels as they are stored, read only from the header.
    ///
    /// # Errors
    /// [`DataError::Image`] if the header cannot be read.
    pub fn size(&self) -> Result<(u32, u32), DataError> {
        match self {
            Self::Image(path) => Ok(PictureHeader::read(path)?.size),
            Self::Frame { video, .. } => Ok(video.size()),
        }
    }

    /// Decodes the image, which must have the aspect ratio of `size`. A frame of a video has the requested size.
    fn decode(&self, size: (u32, u32), exif: ExifOrientation, used_as: PictureUse) -> Result<DynamicImage, DataError> {
        match self {
            Self::Image(path) => decode(path, size, exif, used_as),
            Self::Frame { video, index } => video.frame(*index, size),
        }
    }
}

impl Picture {
    /// A file that is resized to `width` by `height` pixels when it is decoded.
    pub fn file(path: PathBuf, (width, height): (u32, u32)) -> Self {
        let (source, exif) = (PictureSource::Image(path), ExifOrientation::Absent);
        Self::File(PictureFile { source, width, height, backdrop: None, lenses: None, exif })
    }

    /// Width and height in pixels, without decoding.
    pub fn size(&self) -> (u32, u32) {
        match self {
            Picture::Memory(image) => image.dimensions(),
            Picture::File(file) => (file.width, file.height),
        }
    }

    /// The image as RGB, 8 bits per channel.
    ///
    /// # Errors
    /// [`DataError::Image`] if the file cannot be read or decoded, [`DataError::Denied`] if it may not be read.
    /// [`DataError::Content`] if its aspect ratio is not that of the image, or if it is a video that cannot be decoded.
    pub fn rgb(&self) -> Result<Arc<RgbImage>, DataError> {
        match self {
            Picture::Memory(image) => Ok(Arc::clone(image)),
            Picture::File(file) => file.rgb().map(Arc::new),
        }
    }

    /// The image as a mask: 255 where it is white, 0 where it is black or transparent. A pixel is white if its
    /// brightest channel is at least half of the maximum. In a file of labels with only 0 and 1, 1 is white. Masks are
    /// resized and undistorted without interpolation.
    ///
    /// # Errors
    /// Same as [`Picture::rgb`].
    pub fn mask(&self) -> Result<GrayImage, DataError> {
        match self {
            Picture::Memory(image) => Ok(black_and_white(DynamicImage::ImageRgb8(RgbImage::clone(image)))),
            Picture::File(file) => file.mask(),
        }
    }
}

impl PictureFile {
    /// Resized with a Lanczos filter (METHOD §5.1), then undistorted.
    fn rgb(&self) -> Result<RgbImage, DataError> {
        let image =
            to_rgb8(self.source.decode((self.width, self.height), self.exif, PictureUse::Photo)?, self.backdrop);
        let image = match image.dimensions() == (self.width, self.height) {
            true => image,
            false => imageops::resize(&image, self.width, self.height, FilterType::Lanczos3),
        };
        Ok(match self.lenses.as_deref() {
            None => image,
            Some([lens, pinhole]) => straighten(&image, lens, pinhole),
        })
    }

    fn mask(&self) -> Result<GrayImage, DataError> {
        let mask = black_and_white(self.source.decode((self.width, self.height), self.exif, PictureUse::Mask)?);
        let mask = match mask.dimensions() == (self.width, self.height) {
            true => mask,
            false => imageops::resize(&mask, self.width, self.height, FilterType::Nearest),
        };
        Ok(match self.lenses.as_deref() {
            None => mask,
            Some([lens, pinhole]) => straighten_mask(&mask, lens, pinhole),
        })
    }
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
        let picture = Picture::file(saved(folder.path(), &image), (20, 16));
        assert_eq!(*picture.rgb().expect("read"), image);
        assert_eq!(picture.size(), (20, 16));
    }

    #[test]
    fn a_file_of_another_size_is_resized_and_keeps_its_mean() {
        let folder = tempfile::tempdir().expect("folder");
        let image = RgbImage::from_fn(40, 32, |x, _| image::Rgb([3 * x as u8, 100, 7]));
        let small = Picture::file(saved(folder.path(), &image), (20, 16)).rgb().expect("read");
        assert_eq!(small.dimensions(), (20, 16));
        let mean = small.pixels().map(|p| f64::from(p.0[0])).sum::<f64>() / 320.0;
        assert!((mean - 58.5).abs() < 1.0, "{mean}");
        assert!(small.pixels().all(|p| p.0[1] == 100 && p.0[2] == 7));
    }

    #[test]
    fn a_file_of_another_shape_is_refused_before_it_is_decoded() {
        let folder = tempfile::tempdir().expect("folder");
        let path = saved(folder.path(), &RgbImage::new(4000, 1));
        // What follows the header of a PNG, so that decoding it would fail with other words.
        std::fs::write(&path, &std::fs::read(&path).expect("read")[..60]).expect("written");
        let picture = Picture::file(path, (20, 16));
        let error = picture.rgb().expect_err("another shape").to_string();
        assert!(error.contains("4000 x 1") && error.contains("20 x 16"), "{error}");
        assert!(error.contains("its camera is for") && !error.contains("mask"), "{error}");
        let error = picture.mask().expect_err("another shape").to_string();
        assert!(error.contains("4000 x 1") && error.contains("Make the mask again"), "{error}");
    }

    #[test]
    fn a_mask_stays_black_and_white_when_resized() {
        let folder = tempfile::tempdir().expect("folder");
        let image = RgbImage::from_fn(30, 30, |x, _| image::Rgb([if x < 13 { 255 } else { 0 }; 3]));
        let mask = Picture::file(saved(folder.path(), &image), (16, 16)).mask().expect("read");
        assert!(mask.pixels().all(|p| p.0[0] == 0 || p.0[0] == 255));
        assert_eq!((mask.get_pixel(0, 3).0[0], mask.get_pixel(15, 3).0[0]), (255, 0));
    }

    #[test]
    fn what_is_transparent_shows_the_backdrop() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("clear.png");
        image::RgbaImage::from_fn(16, 16, |x, _| image::Rgba([200, 100, 0, if x < 8 { 51 } else { 255 }]))
            .save(&path)
            .expect("written");
        let over = |backdrop| {
            let Picture::File(file) = Picture::file(path.clone(), (16, 16)) else { unreachable!("made as a file") };
            let image = Picture::File(PictureFile { backdrop, ..file }).rgb().expect("read");
            [image.get_pixel(0, 0).0, image.get_pixel(15, 0).0]
        };
        assert_eq!(over(None), [[200, 100, 0]; 2]);
        assert_eq!(over(Some([255; 3])), [[244, 224, 204], [200, 100, 0]]);
        assert_eq!(over(Some([0; 3])), [[40, 20, 0], [200, 100, 0]]);
    }

    #[test]
    fn a_file_that_breaks_off_anywhere_is_an_error_unless_nothing_of_the_picture_is_lacking() {
        let folder = tempfile::tempdir().expect("folder");
        let noise = |x: u32, y: u32| [x, y, x * y].map(|v| (v * 37 % 251) as u8);
        let image = DynamicImage::ImageRgb8(RgbImage::from_fn(20, 18, |x, y| image::Rgb(noise(x, y))));
        for (name, image) in [
            ("a.png", image.clone()),
            ("b.jpg", image.clone()),
            ("c.exr", DynamicImage::ImageRgb32F(image.to_rgb32f())),
            ("d.png", DynamicImage::ImageLuma16(image.to_luma16())),
        ] {
            let path = folder.path().join(name);
            image.save(&path).expect("written");
            let picture = Picture::file(path.clone(), (20, 18));
            let (whole, bytes) = (picture.rgb().expect("whole"), std::fs::read(&path).expect("read"));
            for length in (0..bytes.len()).step_by(5) {
                std::fs::write(&path, &bytes[..length]).expect("written");
                match picture.rgb() {
                    Ok(image) => assert!(image == whole, "{name}: {length} of {} bytes", bytes.len()),
                    Err(error) => assert!(error.to_string().contains(name), "{error}"),
                }
            }
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_refused_and_not_waited_for() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("pipe.png");
        let made = std::process::Command::new("mkfifo").arg(&path).status().expect("a program of the system");
        assert!(made.success());
        let (sender, receiver) = std::sync::mpsc::channel();
        std::thread::spawn(move || sender.send(Picture::file(path, (16, 16)).mask().map_err(|e| e.to_string())));
        let answer = receiver.recv_timeout(std::time::Duration::from_secs(60)).expect("an answer");
        assert!(answer.expect_err("no file").contains("pipe.png"));
    }

    #[test]
    fn a_jpeg_file_that_lacks_its_end_is_refused() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("photo.jpg");
        RgbImage::from_fn(64, 48, |x, y| image::Rgb([x as u8, y as u8, 7])).save(&path).expect("written");
        let picture = Picture::file(path.clone(), (64, 48));
        picture.rgb().expect("whole");
        let bytes = std::fs::read(&path).expect("read");
        for length in [bytes.len() - 2, bytes.len() * 9 / 10] {
            std::fs::write(&path, &bytes[..length]).expect("written");
            assert!(picture.rgb().expect_err("broken off").to_string().contains("photo.jpg"));
        }
    }

    #[test]
    fn exr_files_are_linear_light() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("linear.exr");
        image::Rgb32FImage::from_pixel(20, 18, image::Rgb([0.215_861, 1.0, 0.0])).save(&path).expect("written");
        assert_eq!(PictureHeader::read(&path).expect("a header").size, (20, 18));
        let image = Picture::file(path, (20, 18)).rgb().expect("read");
        assert_eq!(image.get_pixel(7, 7).0, [128, 255, 0]);
    }

    #[test]
    fn a_file_that_is_no_picture_is_named_in_the_error() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("broken.png");
        std::fs::write(&path, b"not a picture").expect("written");
        let error = Picture::file(path, (16, 16)).rgb().expect_err("broken");
        assert!(matches!(error, DataError::Image { .. }) && error.to_string().contains("broken.png"), "{error}");
    }
}
