//! From what a reader knows of a picture to a view of the scene: one path for all formats.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec2, DVec3};
use rayon::prelude::*;
use tracing::info;

use crate::lens::{Bend, Lens};
use crate::picture::reduced_size;
use crate::shapes::check_shapes;
use crate::undistort::pinhole_within;
use crate::{Camera, DataError, Mask, Picture, PictureFile, PictureSource, ReadOptions, Truth, View};

/// Longest side of a picture in pixels, as JPEG has it: a header that lies must not cost the time for its claim.
const LONGEST_SIDE: u32 = 65_535;

/// A picture, its camera and its moment.
#[derive(Clone, Debug)]
pub(crate) struct Shot {
    /// Name of the view.
    pub(crate) name: String,
    /// The picture.
    pub(crate) source: PictureSource,
    /// A file that says which of its pixels count.
    pub(crate) mask: Option<PathBuf>,
    pub(crate) lens: FrameLens,
    /// From the world to the camera, OpenCV axes.
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
    /// In `[0, 1]`.
    pub(crate) time: f64,
}

/// What is said of a picture's lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum FrameLens {
    /// For pictures of this width and height.
    Known { lens: Lens, size: DVec2 },
    /// The focal length in widths of the picture, whatever its size; square pixels, and the axis in the middle.
    Angle { focal_in_widths: f64 },
}

impl FrameLens {
    /// The lens for a picture of that size.
    fn at_size(&self, size: DVec2) -> Lens {
        match *self {
            Self::Known { lens, size: own } => lens.scaled(size / own),
            Self::Angle { focal_in_widths } => {
                Lens { focal: DVec2::splat(focal_in_widths * size.x), principal: 0.5 * size, bend: Bend::NONE }
            }
        }
    }
}

/// The views of shots, whose pictures must be there and of one size, that of their lenses or a scaled one. Only the headers
/// of the pictures are read.
///
/// # Errors
/// [`DataError::Missing`] if a picture or mask is not there, [`DataError::Image`] if a header cannot be read,
/// [`DataError::Disagreement`] if sizes or shapes differ, [`DataError::Setting`] if `downscale` makes no sense,
/// [`DataError::Content`] if two views have one name, a lens shows nothing that a pinhole could, or a camera's numbers are
/// none to compute with.
pub(crate) fn views(folder: &Path, shots: Vec<Shot>, options: &ReadOptions) -> Result<Vec<View>, DataError> {
    if shots.is_empty() {
        return Ok(Vec::new());
    }
    check_presence(folder, &shots)?;
    check_names(&shots)?;
    let on_disk = common_size(folder, &shots)?;
    check_shapes(folder, on_disk, &shots)?;
    let size = reduced_size(on_disk, options.downscale)?;
    let bent = shots.iter().filter(|shot| shot.lens.at_size(DVec2::ONE).bend != Bend::NONE).count();
    if bent > 0 {
        info!("{bent} pictures are straightened as they are read: their lenses bend");
    }
    let masked = shots.iter().filter(|shot| shot.mask.is_some()).count();
    if masked > 0 {
        let counting = if options.invert_masks { "black" } else { "white" };
        info!("{masked} of {} pictures have masks: {counting} counts, the rest is ignored", shots.len());
    }

    // Most pictures come from one camera, and its pinhole takes a walk around the border to find.
    let mut pinholes = Pinholes::default();
    shots.into_iter().map(|shot| view(shot, size, options, &mut pinholes)).collect()
}

fn view(
    shot: Shot,
    (width, height): (u32, u32),
    options: &ReadOptions,
    pinholes: &mut Pinholes,
) -> Result<View, DataError> {
    let lens = shot.lens.at_size(DVec2::new(f64::from(width), f64::from(height)));
    let pinhole = pinholes.of(&lens, width, height).ok_or_else(|| no_pinhole(&shot))?;
    let lenses = (!lens.bend.is_none()).then(|| Arc::new([lens, pinhole]));
    let file =
        |source, backdrop| Picture::File(PictureFile { source, width, height, backdrop, lenses: lenses.clone() });
    let mask = |path| Mask { picture: file(PictureSource::Image(path), None), inverted: options.invert_masks };
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
    if !is_computable(&camera) {
        return Err(no_camera(&shot, &camera));
    }
    Ok(View {
        name: shot.name,
        camera,
        time: shot.time,
        image: file(shot.source, Some(options.backdrop)),
        mask: shot.mask.map(mask),
        truth: Truth::default(),
    })
}

/// The pinhole of the last lens.
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

/// Whether single precision, in which training computes, can hold the camera. Files have numbers that cannot be, and products
/// of those that can.
fn is_computable(camera: &Camera) -> bool {
    let focal = DVec2::new(camera.fx, camera.fy).as_vec2();
    let principal = DVec2::new(camera.cx, camera.cy).as_vec2();
    let places = [camera.translation, camera.centre()].map(|place| place.as_vec3());
    focal.is_finite()
        && focal.min_element() > 0.0
        && principal.is_finite()
        && camera.rotation.is_finite()
        && places.iter().all(|place| place.is_finite())
}

/// Pictures and masks must be there.
fn check_presence(folder: &Path, shots: &[Shot]) -> Result<(), DataError> {
    let pictures: Vec<&Path> = shots.iter().map(|shot| shot.source.path()).collect();
    let masks: Vec<&Path> = shots.iter().filter_map(|shot| shot.mask.as_deref()).collect();
    for (what, paths) in [("picture", pictures), ("mask", masks)] {
        let absent: Vec<&Path> = paths.iter().copied().filter(|path| !path.is_file()).collect();
        let Some(first) = absent.first() else { continue };
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

/// Views are named without extension, and results and masks go by the names.
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

/// The size that all pictures have, because batches are stacked.
fn common_size(folder: &Path, shots: &[Shot]) -> Result<(u32, u32), DataError> {
    let sizes: Vec<(u32, u32)> = shots
        .par_iter()
        .map(|shot| shot.source.size())
        .collect::<Vec<_>>()
        .into_iter() // The first error in the order of the shots, whichever thread met one first.
        .collect::<Result<_, _>>()?;
    if let Some(huge) = sizes.iter().position(|&(width, height)| width.max(height) > LONGEST_SIDE) {
        let (width, height) = sizes[huge];
        let path = shots[huge].source.path().to_owned();
        let reason = format!("its header tells of {width} x {height} pixels, and a side has {LONGEST_SIDE} at most");
        return Err(DataError::Image { path, reason });
    }
    let Some(other) = sizes.iter().position(|size| *size != sizes[0]) else { return Ok(sizes[0]) };
    let shown = |i: usize| {
        let path = shots[i].source.path();
        let path = path.strip_prefix(folder).unwrap_or(path);
        format!("{} has {} x {} pixels", path.display(), sizes[i].0, sizes[i].1)
    };
    Err(DataError::Disagreement {
        folder: folder.to_owned(),
        first: shown(0),
        second: shown(other),
        advice: "All pictures of a scene must have one size: extract them again, or scale them alike".into(),
    })
}

fn no_pinhole(shot: &Shot) -> DataError {
    DataError::Content {
        path: shot.source.path().to_owned(),
        reason: "its lens, as the scene describes it, shows nothing in front of the camera".into(),
        advice: "Check the distortion coefficients, or undistort the pictures with another program",
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
        advice: "Check the entry of the picture in the scene's files",
    }
}
