//! Conversion of shots to the views of a scene, for all formats.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use glam::DVec2;
use tracing::info;

use super::shot::Shot;
use super::sizes::{check_shapes, common_size, images_as_used, reduced_size};
use crate::error::DataError;
use crate::files::denied;
use crate::readers::options::ReadOptions;
use crate::scene::{
    Camera, Distortion, ExifOrientation, Lens, Mask, Picture, PictureFile, PictureSource, Truth, View, pinhole_within,
};

/// The views of shots. Their images must exist and have the same size: that of their lenses or a scaled one. Only the
/// headers of the images are read.
///
/// # Errors
/// [`DataError::Missing`] if an image or mask does not exist, [`DataError::Denied`] if it may not be read,
/// [`DataError::Image`] if a header cannot be read.
/// [`DataError::Disagreement`] if sizes or aspect ratios differ. [`DataError::Setting`] if `downscale` is invalid.
/// [`DataError::Content`] if images are too small, two views have the same name, a lens shows nothing that a pinhole
/// could show, or a camera's values are out of range.
pub(crate) fn views(folder: &Path, shots: Vec<Shot>, options: &ReadOptions) -> Result<Vec<View>, DataError> {
    if shots.is_empty() {
        return Ok(Vec::new());
    }
    check_presence(folder, &shots)?;
    check_names(&shots)?;
    let images = images_as_used(&shots)?;
    let on_disk = common_size(folder, &shots, &images)?;
    check_shapes(folder, on_disk, &shots)?;
    let size = reduced_size(shots[0].source.path(), on_disk, options.downscale)?;
    let bent = shots.iter().filter(|shot| shot.lens.at_size(DVec2::ONE).distortion != Distortion::NONE).count();
    if bent > 0 {
        info!("{bent} images are undistorted as they are read: their lenses distortion");
    }
    let masked = shots.iter().filter(|shot| shot.mask.is_some()).count();
    if masked > 0 {
        let counting = if options.invert_masks { "black" } else { "white" };
        info!("{masked} of {} images have masks: {counting} counts, the rest is ignored", shots.len());
    }

    // Most images are from one camera, and computing its pinhole traverses the border.
    let mut pinholes = Pinholes::default();
    shots.into_iter().zip(images).map(|(shot, image)| view(shot, image.exif, size, options, &mut pinholes)).collect()
}

fn view(
    shot: Shot,
    exif: ExifOrientation,
    (width, height): (u32, u32),
    options: &ReadOptions,
    pinholes: &mut Pinholes,
) -> Result<View, DataError> {
    let lens = shot.lens.at_size(DVec2::new(f64::from(width), f64::from(height)));
    let pinhole = pinholes.of(&lens, width, height).ok_or_else(|| no_pinhole(&shot))?;
    let lenses = (!lens.distortion.is_none()).then(|| Arc::new([lens, pinhole]));
    let file = |source, backdrop, exif| {
        Picture::File(PictureFile { source, width, height, backdrop, lenses: lenses.clone(), exif })
    };
    // Masks are made by programs, which store them as they are to be seen.
    let of_mask = |path| file(PictureSource::Image(path), None, ExifOrientation::Absent);
    let mask = |path| Mask { picture: of_mask(path), inverted: options.invert_masks };
    let camera = Camera {
        width: width as usize,
        height: height as usize,
        fx: pinhole.focal.x,
        fy: pinhole.focal.y,
        cx: pinhole.principal.x,
        cy: pinhole.principal.y,
        rotation: shot.rotation,
        translation: shot.translation,
    };
    if !camera.is_computable() {
        return Err(no_camera(&shot, &camera));
    }
    Ok(View {
        name: shot.name,
        camera,
        time: shot.time,
        image: file(shot.source, Some(options.backdrop), exif),
        mask: shot.mask.map(mask),
        truth: Truth::default(),
    })
}

/// A cache of the pinhole for the last lens.
#[derive(Default)]
struct Pinholes(Option<[Lens; 2]>);

impl Pinholes {
    fn of(&mut self, lens: &Lens, width: u32, height: u32) -> Option<Lens> {
        match self.0 {
            Some([known, pinhole]) if known == *lens => Some(pinhole),
            _ => {
                let pinhole = pinhole_within(lens, width, height)?;
                self.0 = Some([*lens, pinhole]);
                Some(pinhole)
            }
        }
    }
}

/// Checks that all images and masks exist.
fn check_presence(folder: &Path, shots: &[Shot]) -> Result<(), DataError> {
    let pictures: Vec<&Path> = shots.iter().map(|shot| shot.source.path()).collect();
    let masks: Vec<&Path> = shots.iter().filter_map(|shot| shot.mask.as_deref()).collect();
    for (what, paths) in [("image", pictures), ("mask", masks)] {
        let absent: Vec<&Path> = paths.iter().copied().filter(|path| !path.is_file()).collect();
        let Some(first) = absent.first() else { continue };
        if let Some(path) = denied(first) {
            return Err(DataError::Denied { path });
        }
        let path = first.strip_prefix(folder).unwrap_or(first);
        return Err(DataError::Missing {
            what: format!("{what} {}", path.display()),
            folder: folder.to_owned(),
            advice: format!(
                "{} of {} {what}s that the scene lists are not there: put them there under the names that it has for them",
                absent.len(),
                paths.len()
            ),
        });
    }
    Ok(())
}

/// Checks that names are unique. Views are named without extension, and the names of results and masks depend on them.
fn check_names(shots: &[Shot]) -> Result<(), DataError> {
    let mut paths = BTreeMap::new();
    for shot in shots {
        if let Some(twin) = paths.insert(&shot.name, shot.source.path()) {
            return Err(DataError::Content {
                path: shot.source.path().to_owned(),
                reason: format!("its view would have the name of that of {}, {}", twin.display(), shot.name),
                advice: "Views are named without extension: rename or remove one of the two",
            });
        }
    }
    Ok(())
}

fn no_pinhole(shot: &Shot) -> DataError {
    DataError::Content {
        path: shot.source.path().to_owned(),
        reason: "its lens, as the scene describes it, shows nothing in front of the camera".into(),
        advice: "Check the distortion coefficients, or undistort the images with another program",
    }
}

fn no_camera(shot: &Shot, camera: &Camera) -> DataError {
    let &Camera { fx, fy, cx, cy, translation, .. } = camera;
    DataError::Content {
        path: shot.source.path().to_owned(),
        reason: format!(
            "its camera has focal lengths {fx:?}, {fy:?}, principal point {cx:?}, {cy:?} and translation {:?}, which are too \
             large or too small to compute with",
            translation.to_array()
        ),
        advice: "Check the entry of the image in the scene's files",
    }
}
