//! Motion masks: files that are attached to the views of a scene.

use std::path::Path;

use tracing::{debug, warn};

use crate::error::DataError;
use crate::files::{denied, or_denied, picture_named};
use crate::scene::{
    ExifOrientation, Picture, PictureFile, PictureHeader, PictureSource, PictureUse, Scene, check_shape,
};

/// Sets [`Truth::dynamic_mask`](crate::Truth) of every view that has a file with its name in `folder`, such as
/// `cam00/0003.png` or `2clutter008.png`. White means moving. Returns the number of masks. A mask with another size
/// than its view's image is resized without interpolation, and undistorted like the image.
///
/// # Errors
/// [`DataError::Folder`] if the folder does not exist, [`DataError::Denied`] if it may not be read.
/// [`DataError::Image`] if a mask has no readable header, [`DataError::Content`] if its aspect ratio is not that of its
/// image.
/// [`DataError::Missing`] if no view has a mask.
pub fn attach_masks(scene: &mut Scene, folder: &Path) -> Result<usize, DataError> {
    if let Err(error) = std::fs::read_dir(folder) {
        let advice = "Give the folder that holds the masks, named as the frames (white = moving)";
        return Err(or_denied(DataError::Folder { folder: folder.to_owned(), reason: error.to_string(), advice }));
    }
    let mut attached = 0;
    for view in scene.train.iter_mut().chain(&mut scene.test) {
        let Some(path) = picture_named(folder, &view.name) else {
            match denied(&folder.join(&view.name)) {
                Some(path) => return Err(DataError::Denied { path }),
                None => continue,
            }
        };
        let (width, height) = (view.camera.width as u32, view.camera.height as u32);
        check_shape(&path, PictureHeader::read(&path)?.size, (width, height), PictureUse::Mask)?;
        let lenses = match &view.image {
            Picture::File(file) => file.lenses.clone(),
            Picture::Memory(_) => None,
        };
        let source = PictureSource::Image(path);
        let exif = ExifOrientation::Absent;
        let file = PictureFile { source, width, height, backdrop: None, lenses, exif };
        view.truth.dynamic_mask = Some(Picture::File(file));
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
    for (split, views) in [("training", &scene.train), ("held-out", &scene.test)] {
        let masked = views.iter().filter(|view| view.truth.dynamic_mask.is_some()).count();
        if masked > 0 && masked < views.len() {
            warn!(
                "{}: only {masked} of {} {split} views have a mask. The metrics of their dynamic region are those of these \
                 views alone.",
                folder.display(),
                views.len()
            );
        }
    }
    Ok(attached)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::{DMat3, DVec2, DVec3};
    use image::{GrayImage, Rgb, RgbImage};

    use super::*;
    use crate::scene::{Camera, Capture, Distortion, Lens, PointCloud, Truth, View};

    const SIZE: (u32, u32) = (24, 18);

    /// A scene with one view whose lens distorts.
    fn distorted(folder: &Path) -> Scene {
        let path = folder.join("photo.png");
        RgbImage::from_fn(SIZE.0, SIZE.1, |x, _| Rgb([if x < 4 { 255 } else { 0 }; 3])).save(&path).expect("written");
        let distortion = Distortion::opencv([-0.3, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0; 2]);
        let lens = Lens { focal: DVec2::splat(20.0), principal: DVec2::new(12.0, 9.0), distortion };
        let pinhole = Lens { distortion: Distortion::NONE, ..lens };
        let (width, height) = SIZE;
        let source = PictureSource::Image(path);
        let lenses = Some(Arc::new([lens, pinhole]));
        let view = View {
            name: "photo".into(),
            camera: Camera::centred(width as usize, height as usize, 20.0, DMat3::IDENTITY, DVec3::ZERO),
            time: 0.0,
            image: Picture::File(PictureFile {
                source,
                width,
                height,
                backdrop: None,
                lenses,
                exif: Default::default(),
            }),
            mask: None,
            truth: Truth::default(),
        };
        let points = PointCloud::default();
        Scene { name: String::new(), capture: Capture::Photos, train: vec![view], test: Vec::new(), points, near: None }
    }

    #[test]
    fn a_mask_of_what_moves_is_straightened_as_its_picture_is() {
        let folder = tempfile::tempdir().expect("folder");
        let mut scene = distorted(folder.path());
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
        let mut scene = distorted(folder.path());
        GrayImage::new(SIZE.1, SIZE.0).save(folder.path().join("photo.png")).expect("written");
        let error = attach_masks(&mut scene, folder.path()).expect_err("turned").to_string();
        assert!(error.contains("photo.png") && error.contains("another shape"), "{error}");
    }
}
