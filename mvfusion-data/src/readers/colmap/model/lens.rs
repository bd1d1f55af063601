//! COLMAP's camera models: the meaning of their parameters.

use glam::DVec2;

use super::complaint::Complaint;
use crate::scene::{Distortion, Lens};

/// A camera model. Its parameters are the focal lengths, the principal point `cx, cy` and the distortion coefficients,
/// in this order. Lengths are in pixels.
#[derive(Debug)]
pub(super) struct LensModel {
    name: &'static str,
    /// 1 if both axes share a focal length, otherwise 2.
    focal_lengths: usize,
    /// Number of distortion coefficients.
    coefficients: usize,
    /// The distortion that the coefficients describe.
    distortion: fn(&[f64]) -> Distortion,
}

/// The models, indexed by COLMAP's model number. The next model of COLMAP, EQUIRECTANGULAR, is a panorama of all
/// directions, which no pinhole camera can show.
const MODELS: [LensModel; 17] = [
    LensModel { name: "SIMPLE_PINHOLE", focal_lengths: 1, coefficients: 0, distortion: |_| Distortion::NONE },
    LensModel { name: "PINHOLE", focal_lengths: 2, coefficients: 0, distortion: |_| Distortion::NONE },
    LensModel { name: "SIMPLE_RADIAL", focal_lengths: 1, coefficients: 1, distortion: |k| perspective(k, &[]) },
    LensModel { name: "RADIAL", focal_lengths: 1, coefficients: 2, distortion: |k| perspective(k, &[]) },
    LensModel { name: "OPENCV", focal_lengths: 2, coefficients: 4, distortion: |k| perspective(&k[..2], &k[2..]) },
    LensModel {
        name: "OPENCV_FISHEYE",
        focal_lengths: 2,
        coefficients: 4,
        distortion: |k| fisheye(k, &[], &[], false),
    },
    LensModel {
        name: "FULL_OPENCV",
        focal_lengths: 2,
        coefficients: 8,
        distortion: |k| perspective(&[k[0], k[1], k[4], k[5], k[6], k[7]], &k[2..4]),
    },
    LensModel { name: "FOV", focal_lengths: 2, coefficients: 1, distortion: |k| Distortion::Angular { omega: k[0] } },
    LensModel {
        name: "SIMPLE_RADIAL_FISHEYE",
        focal_lengths: 1,
        coefficients: 1,
        distortion: |k| fisheye(k, &[], &[], false),
    },
    LensModel {
        name: "RADIAL_FISHEYE",
        focal_lengths: 1,
        coefficients: 2,
        distortion: |k| fisheye(k, &[], &[], false),
    },
    LensModel {
        name: "THIN_PRISM_FISHEYE",
        focal_lengths: 2,
        coefficients: 8,
        distortion: |k| fisheye(&[k[0], k[1], k[4], k[5]], &k[2..4], &[k[6], 0.0, k[7], 0.0], false),
    },
    LensModel {
        name: "RAD_TAN_THIN_PRISM_FISHEYE",
        focal_lengths: 2,
        coefficients: 12,
        // Its tangential coefficients are in the opposite order of OpenCV's.
        distortion: |k| fisheye(&k[..6], &[k[7], k[6]], &k[8..], true),
    },
    LensModel {
        name: "SIMPLE_DIVISION",
        focal_lengths: 1,
        coefficients: 1,
        distortion: |k| Distortion::Division { k: k[0] },
    },
    LensModel { name: "DIVISION", focal_lengths: 2, coefficients: 1, distortion: |k| Distortion::Division { k: k[0] } },
    LensModel {
        name: "SIMPLE_FISHEYE",
        focal_lengths: 1,
        coefficients: 0,
        distortion: |_| fisheye(&[], &[], &[], false),
    },
    LensModel { name: "FISHEYE", focal_lengths: 2, coefficients: 0, distortion: |_| fisheye(&[], &[], &[], false) },
    LensModel {
        name: "EUCM",
        focal_lengths: 2,
        coefficients: 2,
        distortion: |k| Distortion::Unified { alpha: k[0], beta: k[1] },
    },
];

/// The names of the models that are read.
pub fn lens_models() -> [&'static str; MODELS.len()] {
    MODELS.each_ref().map(|model| model.name)
}

fn perspective(radial: &[f64], tangential: &[f64]) -> Distortion {
    Distortion::opencv(filled(radial), filled(tangential))
}

fn fisheye(radial: &[f64], tangential: &[f64], prism: &[f64], shifted_last: bool) -> Distortion {
    Distortion::Fisheye { radial: filled(radial), tangential: filled(tangential), prism: filled(prism), shifted_last }
}

/// The numbers, padded with zeros.
fn filled<const N: usize>(numbers: &[f64]) -> [f64; N] {
    std::array::from_fn(|i| numbers.get(i).copied().unwrap_or(0.0))
}

impl LensModel {
    /// The model with COLMAP's number `number`, for the camera `camera`.
    pub(super) fn numbered(number: i32, camera: u32) -> Result<&'static Self, Complaint> {
        let place = usize::try_from(number).unwrap_or(usize::MAX);
        MODELS.get(place).ok_or_else(|| unknown(camera, &format!("number {number}")))
    }

    /// The model with COLMAP's name `name`, for the camera `camera`.
    pub(super) fn named(name: &str, camera: u32) -> Result<&'static Self, Complaint> {
        MODELS.iter().find(|model| model.name == name).ok_or_else(|| unknown(camera, name))
    }

    /// Number of parameters.
    pub(super) fn parameters(&self) -> usize {
        self.focal_lengths + 2 + self.coefficients
    }
}

fn unknown(camera: u32, model: &str) -> Complaint {
    let names = MODELS.map(|model| model.name).join(", ");
    Complaint {
        reason: format!("camera {camera} has the model {model}, and only these are read: {names}"),
        advice: "Undistort with `colmap image_undistorter` and give the folder that it writes",
    }
}

/// A camera as the file stores it.
#[derive(Debug)]
pub(crate) struct CameraRecord {
    pub(super) id: u32,
    pub(super) model: &'static LensModel,
    /// Pixels.
    pub(super) width: u64,
    /// Pixels.
    pub(super) height: u64,
    pub(super) parameters: Vec<f64>,
}

impl CameraRecord {
    /// The lens, and the width and height of its images.
    ///
    /// # Errors
    /// If the parameters do not describe a camera.
    pub(super) fn lens(&self) -> Result<(Lens, DVec2), Complaint> {
        let about = format!("camera {} ({})", self.id, self.model.name);
        let (given, needed) = (self.parameters.len(), self.model.parameters());
        if given != needed {
            return Err(format!("{about} has {given} parameters, not {needed}").into());
        }
        let (focal, rest) = self.parameters.split_at(self.model.focal_lengths);
        let (principal, coefficients) = rest.split_at(2);
        let focal = DVec2::new(focal[0], focal[focal.len() - 1]);
        let principal = DVec2::from_slice(principal);
        if !(focal.is_finite() && principal.is_finite() && focal.min_element() > 0.0) {
            let numbers = format!("focal lengths {focal} and principal point {principal}");
            return Err(format!("{about} has {numbers}; all must be finite, and focal lengths above zero").into());
        }
        if let Some(coefficient) = coefficients.iter().find(|k| !k.is_finite()) {
            return Err(format!("{about} has a coefficient {coefficient}").into());
        }
        let side = |pixels: u64| u32::try_from(pixels).ok().filter(|&p| p > 0).map(f64::from);
        let (Some(width), Some(height)) = (side(self.width), side(self.height)) else {
            return Err(format!("{about} has images of {} x {} pixels", self.width, self.height).into());
        };
        let distortion = (self.model.distortion)(coefficients);
        if matches!(distortion, Distortion::Unified { alpha, beta } if !(0.0..=1.0).contains(&alpha) || beta <= 0.0) {
            return Err(format!("{about} has alpha and beta of {coefficients:?}: from 0 to 1, and above 0").into());
        }
        Ok((Lens { focal, principal, distortion }, DVec2::new(width, height)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(name: &str, parameters: &[f64]) -> CameraRecord {
        let model = LensModel::named(name, 7).expect("known");
        CameraRecord { id: 7, model, width: 48, height: 32, parameters: parameters.to_vec() }
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
            assert_eq!(record.model.parameters(), parameters.len());
            let (lens, size) = record.lens().expect(name);
            assert!(lens.distortion.is_none(), "{name}");
            assert_eq!((lens.focal, lens.principal), (DVec2::splat(40.0), DVec2::new(23.0, 17.0)), "{name}");
            assert_eq!(size, DVec2::new(48.0, 32.0));
        }
    }

    #[test]
    fn coefficients_go_where_the_model_has_them() {
        let distortion = |name: &str, parameters: &[f64]| record(name, parameters).lens().expect(name).0.distortion;
        let full = distortion("FULL_OPENCV", &[40., 41., 23., 17., 1., 2., 3., 4., 5., 6., 7., 8.]);
        assert_eq!(full, Distortion::opencv([1., 2., 5., 6., 7., 8.], [3., 4.]));
        let prism = distortion("THIN_PRISM_FISHEYE", &[40., 41., 23., 17., 1., 2., 3., 4., 5., 6., 7., 8.]);
        let wanted = Distortion::Fisheye {
            radial: [1., 2., 5., 6., 0., 0.],
            tangential: [3., 4.],
            prism: [7., 0., 8., 0.],
            shifted_last: false,
        };
        assert_eq!(prism, wanted);
        assert_eq!(distortion("FOV", &[40., 41., 23., 17., 0.9]), Distortion::Angular { omega: 0.9 });
        let aria = distortion(
            "RAD_TAN_THIN_PRISM_FISHEYE",
            &[40., 41., 23., 17., 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12.],
        );
        let wanted = Distortion::Fisheye {
            radial: [1., 2., 3., 4., 5., 6.],
            tangential: [8., 7.],
            prism: [9., 10., 11., 12.],
            shifted_last: true,
        };
        assert_eq!(aria, wanted);
        let equidistant =
            Distortion::Fisheye { radial: [0.0; 6], tangential: [0.0; 2], prism: [0.0; 4], shifted_last: false };
        assert_eq!(distortion("SIMPLE_FISHEYE", &[40., 23., 17.]), equidistant);
        assert_eq!(distortion("FISHEYE", &[40., 41., 23., 17.]), equidistant);
        assert_eq!(distortion("SIMPLE_DIVISION", &[40., 23., 17., -0.1]), Distortion::Division { k: -0.1 });
        assert_eq!(distortion("DIVISION", &[40., 41., 23., 17., -0.1]), Distortion::Division { k: -0.1 });
        assert_eq!(distortion("EUCM", &[40., 41., 23., 17., 0.6, 1.1]), Distortion::Unified { alpha: 0.6, beta: 1.1 });
        for parameters in [[40., 41., 23., 17., 1.5, 1.0], [40., 41., 23., 17., 0.5, 0.0]] {
            assert!(record("EUCM", &parameters).lens().expect_err("refused").reason.contains("above 0"));
        }
    }

    #[test]
    fn numbers_and_names_mean_the_same_models() {
        for (number, model) in MODELS.iter().enumerate() {
            let numbered = LensModel::numbered(number as i32, 1).expect("known");
            assert_eq!(numbered.name, LensModel::named(model.name, 1).expect("known").name);
        }
    }

    #[test]
    fn other_models_are_refused_by_name() {
        for (error, part) in [
            (LensModel::numbered(99, 3), "number 99"),
            (LensModel::numbered(-1, 3), "number -1"),
            (LensModel::numbered(17, 3), "number 17"),
            (LensModel::named("EQUIRECTANGULAR", 3), "EQUIRECTANGULAR"),
            (LensModel::named("PLENOPTIC", 3), "PLENOPTIC"),
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
            assert!(record("PINHOLE", parameters).lens().is_err(), "{parameters:?}");
        }
        assert!(record("SIMPLE_RADIAL", &[40.0, 23.0, 17.0, f64::NAN]).lens().is_err());
        let empty = CameraRecord { width: 0, ..record("PINHOLE", &[40.0, 40.0, 23.0, 17.0]) };
        assert!(empty.lens().expect_err("no pixels").reason.contains("0 x 32"));
        let huge = CameraRecord { height: u64::MAX, ..record("PINHOLE", &[40.0, 40.0, 23.0, 17.0]) };
        assert!(huge.lens().is_err());
    }
}
