//! The lens of a frame of a `transforms.json`.

use glam::DVec2;

use super::record::LensRecord;
use crate::readers::shared::shot::FrameLens;
use crate::scene::{Distortion, Lens};

pub(super) fn read_lens(record: &LensRecord) -> Result<FrameLens, String> {
    let positive = |name: &str, value: Option<f64>| match value {
        Some(value) if !(value.is_finite() && value > 0.0) => Err(format!("its {name} is {value}")),
        value => Ok(value),
    };
    let [fl_x, fl_y, w, h] = [("fl_x", record.fl_x), ("fl_y", record.fl_y), ("w", record.w), ("h", record.h)]
        .map(|(name, value)| positive(name, value));
    let (fl_x, fl_y, size, distortion) = (fl_x?, fl_y?, w?.zip(h?), read_bend(record)?);
    let focal_in_widths = || {
        let angle = positive("camera_angle_x", record.camera_angle_x)?.filter(|angle| *angle < std::f64::consts::PI);
        angle
            .map(|angle| 0.5 / (0.5 * angle).tan())
            .ok_or("it has neither fl_x nor a camera_angle_x below π".to_owned())
    };
    let focal_in_heights = || match positive("camera_angle_y", record.camera_angle_y)? {
        Some(angle) if angle >= std::f64::consts::PI => {
            Err(format!("its camera_angle_y is {angle}, and π is too large"))
        }
        angle => Ok(angle.map(|angle| 0.5 / (0.5 * angle).tan())),
    };
    let Some((w, h)) = size else {
        // Angles alone are valid for images of any size, all other intrinsics only for one size.
        let alone = fl_x.or(fl_y).or(record.cx).or(record.cy).is_none() && distortion.is_none();
        return match (fl_x, alone) {
            (None, true) => {
                Ok(FrameLens::Angle { focal_in_widths: focal_in_widths()?, focal_in_heights: focal_in_heights()? })
            }
            (Some(_), _) => Err("it has fl_x but not w and h, the size that it is for".into()),
            (None, false) => Err("it has intrinsics but not w and h, the size that they are for".into()),
        };
    };
    let fl_x = fl_x.map_or_else(|| focal_in_widths().map(|focal| w * focal), Ok)?;
    let fl_y = match fl_y {
        Some(fl_y) => fl_y,
        None => focal_in_heights()?.map_or(fl_x, |focal| h * focal),
    };
    let principal = DVec2::new(record.cx.unwrap_or(0.5 * w), record.cy.unwrap_or(0.5 * h));
    if !principal.is_finite() {
        return Err(format!("its principal point is {principal}"));
    }
    let lens = Lens { focal: DVec2::new(fl_x, fl_y), principal, distortion };
    Ok(FrameLens::Known { lens, size: DVec2::new(w, h) })
}

fn read_bend(record: &LensRecord) -> Result<Distortion, String> {
    let of = |value: Option<f64>| value.unwrap_or(0.0);
    let [k1, k2, k3, k4, k5, k6] = [record.k1, record.k2, record.k3, record.k4, record.k5, record.k6].map(of);
    let tangential = [record.p1, record.p2].map(of);
    if ![k1, k2, k3, k4, k5, k6, tangential[0], tangential[1]].iter().all(|k| k.is_finite()) {
        return Err("a coefficient of its distortion is not finite".into());
    }
    let unnamed = if record.is_fisheye == Some(true) { "OPENCV_FISHEYE" } else { "OPENCV" };
    match record.camera_model.as_deref().unwrap_or(unnamed) {
        "FULL_OPENCV" => Ok(Distortion::opencv([k1, k2, k3, k4, k5, k6], tangential)),
        // nerfstudio reads four radial coefficients for OPENCV, as Metashape and RealityCapture write them: the fourth is
        // that of r⁸, and no part of OpenCV's fraction. It also applies them if the model is called a pinhole.
        "OPENCV" | "RADIAL" | "SIMPLE_RADIAL" | "PINHOLE" | "SIMPLE_PINHOLE" | "perspective" => Ok(match (k5, k6) {
            (0.0, 0.0) => Distortion::Perspective { numerator: [k1, k2, k3, k4], denominator: [0.0; 3], tangential },
            _ => Distortion::opencv([k1, k2, k3, k4, k5, k6], tangential),
        }),
        "OPENCV_FISHEYE" | "fisheye" => Ok(Distortion::Fisheye {
            radial: [k1, k2, k3, k4, 0.0, 0.0],
            tangential: [0.0; 2],
            prism: [0.0; 4],
            shifted_last: false,
        }),
        other => Err(format!(
            "its camera_model is {other}, and only these are read: PINHOLE, SIMPLE_PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, \
             FULL_OPENCV, OPENCV_FISHEYE"
        )),
    }
}
