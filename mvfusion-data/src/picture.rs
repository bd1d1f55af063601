//! A picture in memory or on disk, decoded when it is asked for.

use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::imageops::{self, FilterType};
use image::{DynamicImage, GrayImage, ImageReader, RgbImage};

use crate::jpeg;
use crate::lens::Lens;
use crate::masks::{black_and_white, check_shape};
use crate::paths::open_file;
use crate::undistort::{straighten, straighten_mask};
use crate::{DataError, Video};

/// Fewest pixels along each side that are of any use.
const LEAST_SIDE: u32 = 16;

/// A picture in memory, or a file that is read on demand.
#[derive(Clone, Debug)]
pub enum Picture {
    /// Decoded already.
    Memory(Arc<RgbImage>),
    /// On disk.
    File(PictureFile),
}

/// A picture on disk, and what is made of it when it is read: laid over a backdrop, resized, straightened.
#[derive(Clone, Debug)]
pub struct PictureFile {
    /// Where it is.
    pub source: PictureSource,
    /// Width in pixels after reading.
    pub width: u32,
    /// Height in pixels after reading.
    pub height: u32,
    /// RGB that shows where the file is transparent. Without one an alpha channel is dropped.
    pub backdrop: Option<[u8; 3]>,
    /// The lens that took it and the pinhole that shall seem to have, both for the size after reading.
    pub lenses: Option<Arc<[Lens; 2]>>,
}

/// Where a picture lies.
#[derive(Clone, Debug)]
pub enum PictureSource {
    /// In a file of its own.
    Image(PathBuf),
    /// In a video.
    Frame {
        /// The video.
        video: Arc<Video>,
        /// Number of the frame, from 0.
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

    /// Width and height in pixels before anything is done to it, from the header alone.
    ///
    /// # Errors
    /// [`DataError::Image`] if the header cannot be read.
    pub fn size(&self) -> Result<(u32, u32), DataError> {
        match self {
            Self::Image(path) => file_size(path),
            Self::Frame { video, .. } => Ok(video.size()),
        }
    }

    /// The picture; a frame of a video comes at the size that is asked for.
    fn decode(&self, size: (u32, u32)) -> Result<DynamicImage, DataError> {
        match self {
            Self::Image(path) => decode(path),
            Self::Frame { video, index } => video.frame(*index, size),
        }
    }
}

impl Picture {
    /// A file that is resized when it is read, if it has another size than `width` by `height` pixels.
    pub fn file(path: PathBuf, (width, height): (u32, u32)) -> Self {
        Self::File(PictureFile { source: PictureSource::Image(path), width, height, backdrop: None, lenses: None })
    }

    /// Width and height in pixels, without decoding.
    pub fn size(&self) -> (u32, u32) {
        match self {
            Picture::Memory(image) => image.dimensions(),
            Picture::File(file) => (file.width, file.height),
        }
    }

    /// The picture as RGB, 8 bits a channel.
    ///
    /// # Errors
    /// [`DataError::Image`] if the file cannot be read or decoded.
    pub fn rgb(&self) -> Result<Arc<RgbImage>, DataError> {
        match self {
            Picture::Memory(image) => Ok(Arc::clone(image)),
            Picture::File(file) => file.rgb().map(Arc::new),
        }
    }

    /// The picture as a mask: 255 where it is white, 0 where it is black or transparent. White is what is at least
    /// half as bright as can be in its brightest channel; and where the file holds nothing but 0 and 1, which is how
    /// programs write labels, 1 is. Resized and straightened without blending.
    ///
    /// # Errors
    /// As [`Picture::rgb`], and if the file has another shape than the picture that it is for.
    pub fn mask(&self) -> Result<GrayImage, DataError> {
        match self {
            Picture::Memory(image) => Ok(black_and_white(DynamicImage::ImageRgb8(RgbImage::clone(image)))),
            Picture::File(file) => file.mask(),
        }
    }
}

impl PictureFile {
    /// Resized with a Lanczos filter (METHOD §5.1), then straightened.
    fn rgb(&self) -> Result<RgbImage, DataError> {
        let image = to_rgb8(self.source.decode((self.width, self.height))?, self.backdrop);
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
        let mask = self.source.decode((self.width, self.height))?;
        check_shape(self.source.path(), (mask.width(), mask.height()), (self.width, self.height))?;
        let mask = black_and_white(mask);
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

/// Eight bits a channel: more bits are rounded, linear light (the floats of an EXR file) becomes sRGB, and what is
/// transparent shows the backdrop. The colours of an EXR file come multiplied by its alpha, those of a PNG file do
/// not.
fn to_rgb8(image: DynamicImage, backdrop: Option<[u8; 3]>) -> RgbImage {
    let image = match image {
        DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_) => {
            let mut linear = image.into_rgba32f();
            for pixel in linear.pixels_mut() {
                let alpha = pixel.0[3];
                let share = if alpha > 0.0 && alpha < 1.0 { alpha } else { 1.0 };
                for channel in &mut pixel.0[..3] {
                    *channel = srgb(*channel / share);
                }
            }
            DynamicImage::ImageRgba32F(linear)
        }
        other => other,
    };
    let Some(backdrop) = backdrop.filter(|_| image.color().has_alpha()) else { return image.into_rgb8() };
    let image = image.into_rgba8();
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let image::Rgba([r, g, b, a]) = *image.get_pixel(x, y);
        let alpha = f32::from(a) / 255.0;
        let over =
            |colour: u8, behind: u8| (alpha * f32::from(colour) + (1.0 - alpha) * f32::from(behind)).round() as u8;
        image::Rgb([over(r, backdrop[0]), over(g, backdrop[1]), over(b, backdrop[2])])
    })
}

/// The transfer function of sRGB (IEC 61966-2-1); what is no number becomes 0.
fn srgb(linear: f32) -> f32 {
    let linear = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
    if linear <= 0.003_130_8 { 12.92 * linear } else { 1.055 * linear.powf(1.0 / 2.4) - 0.055 }
}

/// Width and height of a picture file, from its header alone.
///
/// # Errors
/// [`DataError::Image`] if the header cannot be read.
pub(crate) fn file_size(path: &Path) -> Result<(u32, u32), DataError> {
    opened(path)?.into_dimensions().map_err(|e| unreadable(path, &e))
}

/// The size of pictures of `width` by `height` pixels that are made smaller by the factor `downscale`, the option of
/// that name.
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
    let mut bytes = Vec::new();
    let mut file = open_file(path).map_err(|e| unreadable(path, &e))?;
    file.read_to_end(&mut bytes).map_err(|e| unreadable(path, &e))?;
    if jpeg::is_broken_off(&bytes) {
        return Err(unreadable(path, &"the file ends before the picture does"));
    }
    let reader = ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| unreadable(path, &e))?;
    reader.decode().map_err(|e| unreadable(path, &e))
}

/// The kind of file is guessed from its content: photos with a wrong extension are common.
fn opened(path: &Path) -> Result<ImageReader<std::io::BufReader<std::fs::File>>, DataError> {
    ImageReader::open(path).and_then(ImageReader::with_guessed_format).map_err(|e| unreadable(path, &e))
}

fn unreadable(path: &Path, reason: &dyn std::fmt::Display) -> DataError {
    DataError::Image { path: path.to_owned(), reason: reason.to_string() }
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
    fn sixteen_bits_and_linear_floats_become_eight() {
        let deep = image::ImageBuffer::from_pixel(16, 16, image::Rgb([0x8180u16, 0xffff, 0]));
        assert_eq!(to_rgb8(DynamicImage::ImageRgb16(deep), None).get_pixel(3, 3).0, [0x81, 255, 0]);
        let linear = image::Rgb32FImage::from_pixel(16, 16, image::Rgb([0.215_861, 3.0, f32::NAN]));
        assert_eq!(to_rgb8(DynamicImage::ImageRgb32F(linear), None).get_pixel(3, 3).0, [128, 255, 0]);
    }

    #[test]
    fn colours_that_were_multiplied_by_their_alpha_are_divided_by_it() {
        let half = image::Rgba32FImage::from_pixel(16, 16, image::Rgba([0.5 * 0.215_861, 0.5, 0.0, 0.5]));
        let image = to_rgb8(DynamicImage::ImageRgba32F(half), Some([0; 3]));
        assert_eq!(image.get_pixel(3, 3).0, [64, 128, 0]);
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
        assert_eq!(file_size(&path).expect("a header"), (20, 18));
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
