//! `camera/<id>.json`: a camera of Nerfies.

use std::path::Path;

use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;

use crate::error::DataError;
use crate::files::{COPY_OR_MEND, read_json, rotation_of};
use crate::readers::shared::shot::FrameLens;
use crate::scene::{Distortion, Lens};

/// Largest skew, in pixels over one focal length. Real files have 0, and our pinhole cameras have no skew.
const LARGEST_SKEW: f64 = 0.1;

/// A camera.
#[derive(Debug)]
pub(super) struct Camera {
    pub(super) lens: FrameLens,
    /// From the world to the camera, OpenCV axes.
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
}

/// The file as stored.
#[derive(Debug, Deserialize)]
struct Record {
    orientation: [[f64; 3]; 3],
    position: [f64; 3],
    focal_length: f64,
    principal_point: [f64; 2],
    #[serde(default)]
    skew: f64,
    #[serde(default = "square")]
    pixel_aspect_ratio: f64,
    #[serde(default)]
    radial_distortion: Vec<f64>,
    /// The name in older files. It takes precedence if both are present.
    tangential: Option<Vec<f64>>,
    #[serde(default)]
    tangential_distortion: Vec<f64>,
    image_size: [f64; 2],
}

fn square() -> f64 {
    1.0
}

/// Reads a camera.
///
/// # Errors
/// [`DataError::Content`] that names the invalid entry.
pub(super) fn read(path: &Path) -> Result<Camera, DataError> {
    let record: Record = read_json(path, COPY_OR_MEND)?;
    record.camera().map_err(|reason| DataError::Content { path: path.to_owned(), reason, advice: COPY_OR_MEND })
}

impl Record {
    fn camera(&self) -> Result<Camera, String> {
        let [right, down, forward] = self.orientation.map(DVec3::from_array);
        let rotation = rotation_of(DMat3::from_cols(right, down, forward).transpose())
            .ok_or_else(|| format!("its orientation {:?} is no rotation", self.orientation))?;
        let position = DVec3::from_array(self.position);
        if !position.is_finite() {
            return Err(format!("its position is {position}"));
        }
        Ok(Camera { lens: self.lens()?, rotation, translation: -(rotation * position) })
    }

    fn lens(&self) -> Result<FrameLens, String> {
        let positive = |name: &str, value: f64| match value {
            value if value.is_finite() && value > 0.0 => Ok(value),
            value => Err(format!("its {name} is {value}; it must be above zero")),
        };
        let focal = positive("focal_length", self.focal_length)?;
        let aspect = positive("pixel_aspect_ratio", self.pixel_aspect_ratio)?;
        let [width, height] = self.image_size;
        let size = DVec2::new(positive("image_size", width)?, positive("image_size", height)?);
        let principal = DVec2::from_array(self.principal_point);
        if !principal.is_finite() {
            return Err(format!("its principal_point is {principal}"));
        }
        if self.skew.is_nan() || self.skew.abs() > LARGEST_SKEW {
            return Err(format!("its skew is {}; only cameras without skew can be used", self.skew));
        }
        let [k1, k2, k3] = coefficients("radial_distortion", &self.radial_distortion)?;
        let tangential = self.tangential.as_ref().unwrap_or(&self.tangential_distortion);
        let tangential = coefficients("tangential_distortion", tangential)?;
        let distortion = Distortion::opencv([k1, k2, k3, 0.0, 0.0, 0.0], tangential);
        Ok(FrameLens::Known { lens: Lens { focal: DVec2::new(focal, focal * aspect), principal, distortion }, size })
    }
}

/// The distortion coefficients. Missing ones are zero.
fn coefficients<const N: usize>(name: &str, values: &[f64]) -> Result<[f64; N], String> {
    if values.len() > N || values.iter().any(|value| !value.is_finite()) {
        return Err(format!("its {name} is {values:?}, and not {N} finite numbers"));
    }
    Ok(std::array::from_fn(|i| values.get(i).copied().unwrap_or(0.0)))
}
