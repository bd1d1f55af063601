//! A COLMAP model: photos with cameras, and points.

pub(super) mod binary;
mod complaint;
mod files;
mod lens;
mod records;
pub(super) mod text;

pub use lens::lens_models;

use std::collections::BTreeMap;
use std::path::{Component, Path};

use glam::{DMat3, DQuat, DVec2, DVec3, DVec4};

use crate::error::DataError;
use crate::scene::{Lens, PointCloud};
use complaint::Complaint;
use files::{ModelFiles, Part};
use lens::CameraRecord;
use records::ImageRecord;

/// Minimum norm of a quaternion. COLMAP writes unit quaternions.
const LEAST_QUATERNION: f64 = 1e-6;

/// A model with resolved references.
#[derive(Debug)]
pub(crate) struct Model {
    /// Sorted by name. Names are unique.
    pub(crate) photos: Vec<Photo>,
    pub(crate) points: PointCloud,
}

/// A photo with a known pose.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Photo {
    /// Path below the folder of the photos, such as `2clutter008.JPG`. It cannot lead out of that folder.
    pub(crate) name: String,
    /// The lens, for images of the model's size.
    pub(crate) lens: Lens,
    /// Width and height in the model.
    pub(crate) size: DVec2,
    /// From the world to the camera.
    pub(crate) rotation: DMat3,
    pub(crate) translation: DVec3,
}

impl Photo {
    /// The name without the extension, which is also the name of its mask.
    pub(crate) fn view_name(&self) -> String {
        Path::new(&self.name).with_extension("").to_string_lossy().into_owned()
    }
}

/// Reads the model in the folder `sparse` or in a numbered subfolder (see [`ModelFiles::locate`]).
///
/// # Errors
/// [`DataError::Missing`] if a file does not exist, [`DataError::Content`] if one cannot be used.
pub(crate) fn read(sparse: &Path) -> Result<Model, DataError> {
    let files = ModelFiles::locate(sparse)?;
    let cameras = by_number(&files.cameras()?).map_err(|complaint| files.blame(Part::Cameras, complaint))?;
    let photos = photos(files.images()?, &cameras).map_err(|complaint| files.blame(Part::Images, complaint))?;
    Ok(Model { photos, points: files.points()? })
}

fn by_number(records: &[CameraRecord]) -> Result<BTreeMap<u32, (Lens, DVec2)>, Complaint> {
    let mut cameras = BTreeMap::new();
    for record in records {
        if cameras.insert(record.id, record.lens()?).is_some() {
            return Err(format!("it lists the camera {} twice", record.id).into());
        }
    }
    Ok(cameras)
}

fn photos(records: Vec<ImageRecord>, cameras: &BTreeMap<u32, (Lens, DVec2)>) -> Result<Vec<Photo>, Complaint> {
    let mut photos = records.into_iter().map(|record| photo(record, cameras)).collect::<Result<Vec<_>, _>>()?;
    photos.sort_by(|a, b| a.name.cmp(&b.name));
    let mut names = BTreeMap::new();
    for photo in &photos {
        match names.insert(photo.view_name(), &photo.name) {
            None => {}
            Some(twin) if *twin == photo.name => return Err(format!("it lists the image {twin} twice").into()),
            Some(twin) => {
                let reason = format!("the images {twin} and {} differ in nothing but their extensions", photo.name);
                return Err(Complaint { reason, advice: "Views are named without extension: keep one of the two" });
            }
        }
    }
    Ok(photos)
}

fn photo(record: ImageRecord, cameras: &BTreeMap<u32, (Lens, DVec2)>) -> Result<Photo, Complaint> {
    let name = record.name;
    let mut parts = Path::new(&name).components().peekable();
    // An empty name has no parts. `..`, a root or a drive would lead out of the folder of the photos.
    if parts.peek().is_none() || !parts.all(|part| matches!(part, Component::Normal(_))) {
        let reason = format!("the image name `{name}` is no path below the folder of the photos");
        return Err(Complaint { reason, advice: "Image names must be relative and free of `..`" });
    }
    let &(lens, size) = cameras
        .get(&record.camera)
        .ok_or_else(|| format!("the image {name} refers to the camera {}, which is not in the model", record.camera))?;
    let [w, x, y, z] = record.quaternion;
    let translation = DVec3::from_array(record.translation);
    let length = DVec4::new(w, x, y, z).length();
    // The length is infinite if a number is not finite, or too large for a rotation.
    if !length.is_finite() || length < LEAST_QUATERNION || !translation.is_finite() {
        let numbers = format!("quaternion {w}, {x}, {y}, {z} and translation {translation}");
        return Err(format!("the image {name} has no pose: {numbers}").into());
    }
    let rotation = DMat3::from_quat(DQuat::from_vec4(DVec4::new(x, y, z, w) / length));
    Ok(Photo { name, lens, size, rotation, translation })
}
