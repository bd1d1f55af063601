//! Masks: which pixels of a picture count, and which show what moves.

use std::path::{Path, PathBuf};

use image::{ColorType, DynamicImage, GrayImage, Rgba, imageops};
use tracing::debug;

use crate::frames::picture_named;
use crate::picture::file_size;
use crate::{DataError, Picture, PictureFile, PictureSource, Scene};

/// Which pixels of a picture count: for the loss of training and for scores.
#[derive(Clone, Debug)]
pub struct Mask {
    /// Read by [`Picture::mask`].
    pub picture: Picture,
    /// Whether black counts and white is ignored. Else white counts, as nerfstudio and COLMAP have it.
    pub inverted: bool,
}

impl Mask {
    /// The mask: 255 where the picture's pixel counts, 0 where it is to be ignored.
    ///
    /// # Errors
    /// As [`Picture::mask`].
    pub fn read(&self) -> Result<GrayImage, DataError> {
        let mut mask = self.picture.mask()?;
        if self.inverted {
            imageops::invert(&mut mask);
        }
        Ok(mask)
    }
}

/// 255 where a picture is white, 0 where it is black, by the rule of [`Picture::mask`].
pub(crate) fn black_and_white(mask: DynamicImage) -> GrayImage {
    /// Half of the brightest level.
    const HALF: u32 = 1 << 15;
    // The level of a 1 in the file, after its 8 bits have become 16.
    let one = match mask.color() {
        ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => Some(0x101),
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => Some(1),
        _ => None,
    };
    let mask = mask.into_rgba16();
    let level = |&Rgba([r, g, b, alpha]): &Rgba<u16>| u32::from(r.max(g).max(b)) * u32::from(alpha) / 0xffff;
    let white = one.filter(|&one| mask.pixels().all(|pixel| level(pixel) <= one)).unwrap_or(HALF);
    GrayImage::from_fn(mask.width(), mask.height(), |x, y| {
        image::Luma([if level(mask.get_pixel(x, y)) >= white { 255 } else { 0 }])
    })
}

/// Makes sure that a mask of the first size can be that of a picture of the second, smaller or larger: the sides of
/// both may have been rounded by a pixel.
///
/// # Errors
/// [`DataError::Image`] if not: stretched, it would say something about other pixels than it means.
pub(crate) fn check_shape(path: &Path, mask: (u32, u32), picture: (u32, u32)) -> Result<(), DataError> {
    let [w, h, width, height] = [mask.0, mask.1, picture.0, picture.1].map(u64::from);
    if (w * height).abs_diff(h * width) <= w + h + width + height {
        return Ok(());
    }
    let reason = format!("the mask has {w} x {h} pixels, another shape than its picture's {width} x {height}");
    Err(DataError::Image { path: path.to_owned(), reason })
}

/// The mask of a picture that lies in `masks/` beside the pictures' folder: `2clutter008.png`, or
/// `2clutter008.JPG.png` as COLMAP names it, for `2clutter008.JPG`.
pub(crate) fn mask_beside(folder: &Path, picture: &str) -> Option<PathBuf> {
    let masks = folder.join("masks");
    let candidates = [masks.join(picture).with_extension("png"), masks.join(format!("{picture}.png"))];
    candidates.into_iter().find(|path| path.is_file())
}

/// Sets [`Truth::dynamic_mask`](crate::Truth) of every view for which `folder` holds a file of the view's name, such
/// as `cam00/0003.png` or `2clutter008.png`, and returns for how many. White means moving. A mask of another size than
/// its view's picture is resized without blending when it is read, and straightened as the picture is.
///
/// # Errors
/// [`DataError::Folder`] if the folder does not exist, [`DataError::Image`] if a mask has no readable header or
/// another shape than its picture, [`DataError::Missing`] if no view has a mask.
pub fn attach_masks(scene: &mut Scene, folder: &Path) -> Result<usize, DataError> {
    if let Err(error) = std::fs::read_dir(folder) {
        let advice = "Give the folder that holds the masks, named as the frames (white = moving)";
        return Err(DataError::Folder { folder: folder.to_owned(), reason: error.to_string(), advice });
    }
    let mut attached = 0;
    for view in scene.train.iter_mut().chain(&mut scene.test) {
        let Some(path) = picture_named(folder, &view.name) else { continue };
        let (width, height) = (view.camera.width as u32, view.camera.height as u32);
        check_shape(&path, file_size(&path)?, (width, height))?;
        let lenses = match &view.image {
            Picture::File(file) => file.lenses.clone(),
            Picture::Memory(_) => None,
        };
        let source = PictureSource::Image(path);
        view.truth.dynamic_mask = Some(Picture::File(PictureFile { source, width, height, backdrop: None, lenses }));
        view.truth.is_mask_exact = false;
        attached += 1;
    }
    let views = scene.train.len() + scene.test.len();
    if attached == 0 {
        let example = scene.train.iter().chain(&scene.test).next().map_or("", |v| &v.name);
        return Err(DataError::Missing {
            what: "mask of any view".into(),
            folder: folder.to_owned(),
            advice: format!("Masks are named as the views, for example {example}.png"),
        });
    }
    debug!(masks = attached, views, "masks attached, white = moving");
    Ok(attached)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec2, DVec3};
    use image::{ImageBuffer, Luma, LumaA, Rgb, RgbImage};

    use super::*;
    use crate::{Bend, Camera, Capture, Lens, PointCloud, Truth, View};

    const SIZE: (u32, u32) = (24, 18);

    /// A mask of two colours, of which the left one is to be white, as it is read from a file.
    fn read<P>(left: P, right: P, inverted: bool) -> [u8; 2]
    where
        P: image::Pixel + image::PixelWithColorType,
        [P::Subpixel]: image::EncodableLayout,
    {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("mask.png");
        let side = |x| if x < SIZE.0 / 2 { left } else { right };
        ImageBuffer::from_fn(SIZE.0, SIZE.1, |x, _| side(x)).save(&path).expect("written");
        let mask = Mask { picture: Picture::file(path, SIZE), inverted }.read().expect("read");
        assert!(mask.pixels().all(|pixel| matches!(pixel.0[0], 0 | 255)));
        [mask.get_pixel(0, 9).0[0], mask.get_pixel(SIZE.0 - 1, 9).0[0]]
    }

    #[test]
    fn what_is_at_least_half_as_bright_as_can_be_counts() {
        const WHITE_LEFT: [u8; 2] = [255, 0];
        assert_eq!(read(Luma([255u8]), Luma([0]), false), WHITE_LEFT);
        assert_eq!(read(Luma([128u8]), Luma([127]), false), WHITE_LEFT);
        assert_eq!(read(Luma([0x8000u16]), Luma([0x7fff]), false), WHITE_LEFT);
        assert_eq!(read(Rgb([0u8, 0, 128]), Rgb([127, 127, 127]), false), WHITE_LEFT);
        assert_eq!(read(LumaA([255u8, 255]), LumaA([255, 0]), false), WHITE_LEFT);
        assert_eq!(read(Rgba([255u8, 255, 255, 200]), Rgba([255, 255, 255, 100]), false), WHITE_LEFT);
        assert_eq!(read(Luma([127u8]), Luma([128]), true), WHITE_LEFT);
        assert_eq!(read(Luma([255u8]), Luma([255]), false), [255, 255]);
    }

    #[test]
    fn a_file_of_noughts_and_ones_holds_labels() {
        assert_eq!(read(Luma([1u8]), Luma([0]), false), [255, 0]);
        assert_eq!(read(Luma([1u16]), Luma([0]), false), [255, 0]);
        assert_eq!(read(Luma([0u16]), Luma([1]), true), [255, 0]);
        assert_eq!(read(Luma([1u8]), Luma([1]), false), [255, 255]);
        assert_eq!(read(Luma([0u8]), Luma([0]), false), [0, 0]);
        // Two is no label: what is dark is black.
        assert_eq!(read(Luma([1u8]), Luma([2]), false), [0, 0]);
    }

    #[test]
    fn a_mask_of_another_shape_is_refused_and_one_of_another_size_is_not() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("mask.png");
        let read = |width, height, picture| {
            GrayImage::from_pixel(width, height, Luma([255])).save(&path).expect("written");
            Picture::file(path.clone(), picture).mask()
        };
        for (width, height, picture) in [(96, 72, SIZE), (12, 9, SIZE), (251, 167, (125, 83)), (96, 72, (1352, 1014))] {
            assert_eq!(read(width, height, picture).expect("scaled").dimensions(), picture);
        }
        for (width, height, picture) in [(180, 240, (240, 180)), (1080, 1920, (1920, 1080)), (640, 480, (640, 360))] {
            let error = read(width, height, picture).expect_err("another shape").to_string();
            assert!(error.contains("mask.png") && error.contains("another shape"), "{error}");
        }
    }

    /// A scene of one view whose lens bends.
    fn bent(folder: &Path) -> Scene {
        let path = folder.join("photo.png");
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, _| Rgb([if x < 4 { 255 } else { 0 }; 3])).save(&path).expect("written");
        let bend = Bend::Perspective { radial: [-0.3, 0.0, 0.0, 0.0, 0.0, 0.0], tangential: [0.0; 2] };
        let lens = Lens { focal: DVec2::splat(20.0), principal: DVec2::new(12.0, 9.0), bend };
        let pinhole = Lens { bend: Bend::NONE, ..lens };
        let (width, height) = SIZE;
        let source = PictureSource::Image(path);
        let lenses = Some(Arc::new([lens, pinhole]));
        let view = View {
            name: "photo".into(),
            camera: Camera::centred(width as usize, height as usize, 20.0, DMat3::IDENTITY, DVec3::ZERO),
            time: 0.0,
            image: Picture::File(PictureFile { source, width, height, backdrop: None, lenses }),
            mask: None,
            truth: Truth::default(),
        };
        let points = PointCloud::default();
        Scene { name: String::new(), capture: Capture::Photos, train: vec![view], test: Vec::new(), points, near: None }
    }

    #[test]
    fn a_mask_of_what_moves_is_straightened_as_its_picture_is() {
        let folder = tempfile::tempdir().expect("folder");
        let mut scene = bent(folder.path());
        assert_eq!(attach_masks(&mut scene, folder.path()).expect("the photo is its own mask"), 1);
        let view = &scene.train[0];
        let (picture, mask) = (view.image.rgb().expect("read"), view.truth.dynamic_mask.as_ref().expect("attached"));
        let mask = mask.mask().expect("read");
        let unlike = mask.pixels().zip(picture.pixels()).filter(|(mask, pixel)| mask.0[0].abs_diff(pixel.0[0]) > 127);
        assert_eq!(unlike.count(), 0);
    }

    #[test]
    fn masks_of_another_shape_are_not_attached() {
        let folder = tempfile::tempdir().expect("folder");
        let mut scene = bent(folder.path());
        GrayImage::new(SIZE.1, SIZE.0).save(folder.path().join("photo.png")).expect("written");
        let error = attach_masks(&mut scene, folder.path()).expect_err("turned").to_string();
        assert!(error.contains("photo.png") && error.contains("another shape"), "{error}");
    }
}
