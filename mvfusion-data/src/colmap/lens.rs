//! Camera models of COLMAP: which of them are pinholes, and what their parameters mean.

use glam::{DMat3, DVec3};

use super::files::Complaint;
use crate::Camera;

/// What to do about cameras that are no pinholes.
const UNDISTORT: &str = "Undistort first with `colmap image_undistorter` and give the folder that it writes";

/// A camera model that is a pinhole where its distortion is zero.
///
/// Its parameters are the focal lengths, the principal point `cx, cy`, and the distortion, in this order and in pixels.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Lens {
    name: &'static str,
    focal: FocalLengths,
    /// Names of the coefficients.
    distortion: &'static [&'static str],
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FocalLengths {
    /// `f`, for both axes.
    Shared,
    /// `fx, fy`.
    PerAxis,
}

use FocalLengths::{PerAxis, Shared};

/// The models that are read. COLMAP's number of a model is its place here.
const LENSES: [Lens; 5] = [
    Lens { name: "SIMPLE_PINHOLE", focal: Shared, distortion: &[] },
    Lens { name: "PINHOLE", focal: PerAxis, distortion: &[] },
    Lens { name: "SIMPLE_RADIAL", focal: Shared, distortion: &["k"] },
    Lens { name: "RADIAL", focal: Shared, distortion: &["k1", "k2"] },
    Lens { name: "OPENCV", focal: PerAxis, distortion: &["k1", "k2", "p1", "p2"] },
];

/// Names of the models that are not read, for messages; the first has the number after the last of [`LENSES`].
const OTHERS: [&str; 7] = [
    "OPENCV_FISHEYE",
    "FULL_OPENCV",
    "FOV",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
];

impl Lens {
    /// The model with COLMAP's number `number`, of the camera `camera`.
    pub(super) fn numbered(number: i32, camera: u32) -> Result<&'static Self, Complaint> {
        let place = usize::try_from(number).unwrap_or(usize::MAX);
        LENSES.get(place).ok_or_else(|| {
            let other = place.checked_sub(LENSES.len()).and_then(|place| OTHERS.get(place));
            not_read(camera, &other.map_or_else(|| format!("number {number}"), ToString::to_string))
        })
    }

    /// The model with COLMAP's name `name`, of the camera `camera`.
    pub(super) fn named(name: &str, camera: u32) -> Result<&'static Self, Complaint> {
        LENSES.iter().find(|lens| lens.name == name).ok_or_else(|| not_read(camera, name))
    }

    /// Number of parameters.
    pub(super) fn parameters(&self) -> usize {
        let focal = match self.focal {
            Shared => 1,
            PerAxis => 2,
        };
        focal + 2 + self.distortion.len()
    }
}

fn not_read(camera: u32, model: &str) -> Complaint {
    let names = LENSES.map(|lens| lens.name).join(", ");
    let reason = format!("camera {camera} has the model {model}, and only these are read: {names}");
    Complaint { reason, advice: UNDISTORT }
}

/// A camera as it stands in the file.
#[derive(Debug)]
pub(super) struct CameraRecord {
    pub(super) id: u32,
    pub(super) lens: &'static Lens,
    /// Pixels.
    pub(super) width: u64,
    /// Pixels.
    pub(super) height: u64,
    pub(super) parameters: Vec<f64>,
}

impl CameraRecord {
    /// The camera, standing at the world's origin and looking along its z axis.
    ///
    /// # Errors
    /// If the parameters are no camera's, or there is distortion.
    pub(super) fn camera(&self) -> Result<Camera, Complaint> {
        let about = format!("camera {} ({})", self.id, self.lens.name);
        let coefficients = self.lens.distortion.len();
        let (fx, fy, cx, cy, distortion) = match (self.lens.focal, &self.parameters[..]) {
            (Shared, &[f, cx, cy, ref rest @ ..]) if rest.len() == coefficients => (f, f, cx, cy, rest),
            (PerAxis, &[fx, fy, cx, cy, ref rest @ ..]) if rest.len() == coefficients => (fx, fy, cx, cy, rest),
            _ => {
                let (given, needed) = (self.parameters.len(), self.lens.parameters());
                return Err(format!("{about} has {given} parameters, not {needed}").into());
            }
        };
        if ![fx, fy, cx, cy].iter().all(|v| v.is_finite()) || fx <= 0.0 || fy <= 0.0 {
            let numbers = format!("focal lengths {fx}, {fy} and principal point {cx}, {cy}");
            return Err(format!("{about} has {numbers}; all must be finite, and focal lengths above zero").into());
        }
        let bent: Vec<String> = self.lens.distortion.iter().zip(distortion).filter_map(bent).collect();
        if !bent.is_empty() {
            let reason = format!("{about} is distorted: {}", bent.join(", "));
            return Err(Complaint { reason, advice: UNDISTORT });
        }
        let side = |pixels: u64| u32::try_from(pixels).ok().filter(|&p| p > 0).map(|p| p as usize);
        let (Some(width), Some(height)) = (side(self.width), side(self.height)) else {
            return Err(format!("{about} has pictures of {} x {} pixels", self.width, self.height).into());
        };
        Ok(Camera { width, height, fx, fy, cx, cy, rotation: DMat3::IDENTITY, translation: DVec3::ZERO })
    }
}

/// A coefficient in words, if it bends anything.
fn bent((name, &value): (&&str, &f64)) -> Option<String> {
    (value != 0.0).then(|| format!("{name} = {value}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(name: &str, parameters: &[f64]) -> CameraRecord {
        let lens = Lens::named(name, 7).expect("known");
        CameraRecord { id: 7, lens, width: 48, height: 32, parameters: parameters.to_vec() }
    }

    #[test]
    fn undistorted_models_are_pinholes_and_a_shared_focal_length_serves_both_axes() {
        for (name, parameters) in [
            ("SIMPLE_PINHOLE", &[40.0, 23.0, 17.0][..]),
            ("PINHOLE", &[40.0, 40.0, 23.0, 17.0]),
            ("SIMPLE_RADIAL", &[40.0, 23.0, 17.0, 0.0]),
            ("RADIAL", &[40.0, 23.0, 17.0, 0.0, -0.0]),
            ("OPENCV", &[40.0, 40.0, 23.0, 17.0, 0.0, 0.0, 0.0, 0.0]),
        ] {
            let record = record(name, parameters);
            assert_eq!(record.lens.parameters(), parameters.len());
            let camera = record.camera().expect(name);
            assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (40.0, 40.0, 23.0, 17.0), "{name}");
        }
    }

    #[test]
    fn numbers_and_names_mean_the_same_models() {
        for (number, lens) in LENSES.iter().enumerate() {
            assert_eq!(Lens::numbered(number as i32, 1).expect("known"), Lens::named(lens.name, 1).expect("known"));
        }
    }

    #[test]
    fn distortion_is_refused_with_its_coefficients_and_a_way_out() {
        for (name, parameters, part) in [
            ("SIMPLE_RADIAL", &[40.0, 23.0, 17.0, 0.01][..], "k = 0.01"),
            ("RADIAL", &[40.0, 23.0, 17.0, 0.0, 1e-9], "k2 = 0.000000001"),
            ("OPENCV", &[40.0, 40.0, 23.0, 17.0, 0.0, 0.2, 0.0, f64::NAN], "k2 = 0.2, p2 = NaN"),
        ] {
            let complaint = record(name, parameters).camera().expect_err(name);
            assert!(complaint.reason.contains(part) && complaint.reason.contains(&format!("camera 7 ({name})")));
            assert!(complaint.advice.contains("image_undistorter"));
        }
    }

    #[test]
    fn other_models_are_refused_by_name() {
        for (error, part) in [
            (Lens::numbered(5, 3), "OPENCV_FISHEYE"),
            (Lens::numbered(11, 3), "RAD_TAN_THIN_PRISM_FISHEYE"),
            (Lens::numbered(99, 3), "number 99"),
            (Lens::numbered(-1, 3), "number -1"),
            (Lens::named("FOV", 3), "FOV"),
        ] {
            let complaint = error.expect_err(part);
            assert!(complaint.reason.contains(part) && complaint.reason.contains("camera 3"), "{}", complaint.reason);
            assert!(complaint.advice.contains("image_undistorter"));
        }
    }

    #[test]
    fn parameters_that_are_no_camera_are_refused() {
        for parameters in [
            &[0.0, 40.0, 23.0, 17.0][..],
            &[40.0, -1.0, 23.0, 17.0],
            &[f64::NAN, 40.0, 23.0, 17.0],
            &[40.0, f64::INFINITY, 23.0, 17.0],
            &[40.0, 40.0, f64::NAN, 17.0],
            &[40.0, 40.0, 23.0],
            &[40.0, 40.0, 23.0, 17.0, 0.0],
            &[],
        ] {
            assert!(record("PINHOLE", parameters).camera().is_err(), "{parameters:?}");
        }
        let empty = CameraRecord { width: 0, ..record("PINHOLE", &[40.0, 40.0, 23.0, 17.0]) };
        assert!(empty.camera().expect_err("no pixels").reason.contains("0 x 32"));
        let huge = CameraRecord { height: u64::MAX, ..record("PINHOLE", &[40.0, 40.0, 23.0, 17.0]) };
        assert!(huge.camera().is_err());
    }
}
