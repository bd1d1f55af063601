//! COLMAP models in binary files, and the photo layouts with such a model.
//!
//! It is unknown which image shows which point, so images have no observations and points no tracks.

use super::encode::byte;
use super::package::Package;
use super::{photos, poses};
use crate::scene::{Camera, PointCloud, Scene};

/// A camera model of COLMAP.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LensModel {
    /// Focal lengths and principal point. 3DGS accepts no other model.
    Pinhole,
    /// The same plus four distortion coefficients, here zero. DeGauss undistorts its input and requires them.
    OpenCv,
}

/// `images/` and `sparse/0` in the folder `inner`, which is empty or ends with a slash.
pub(super) fn package<'a>(scene: &'a Scene, inner: &str, lens: LensModel) -> Package<'a> {
    let pictures = photos::entries(scene, inner);
    let mut images: Vec<(String, &Camera)> =
        pictures.iter().map(|entry| (format!("{}.png", entry.name), &entry.view.camera)).collect();
    images.sort_by(|a, b| a.0.cmp(&b.0));
    let files = model(&format!("{inner}sparse/0"), &images, lens, &scene.points);
    Package { pictures, files }
}

/// The three files of a model. Images are numbered in order, from 1. Equal cameras share one number.
pub(super) fn model(
    folder: &str,
    images: &[(String, &Camera)],
    lens: LensModel,
    points: &PointCloud,
) -> Vec<(String, Vec<u8>)> {
    let mut lenses: Vec<Lens> = Vec::new();
    let mut numbers = Vec::with_capacity(images.len());
    for (_, camera) in images {
        let own = Lens::of(camera);
        let place = lenses.iter().position(|other| *other == own).unwrap_or_else(|| {
            lenses.push(own);
            lenses.len() - 1
        });
        numbers.push(place as u32 + 1);
    }
    vec![
        (format!("{folder}/cameras.bin"), cameras(&lenses, lens)),
        (format!("{folder}/images.bin"), posed(images, &numbers)),
        (format!("{folder}/points3D.bin"), cloud(points)),
    ]
}

/// A camera in COLMAP's sense: intrinsics without pose.
#[derive(PartialEq)]
struct Lens {
    size: [u64; 2],
    parameters: [f64; 4],
}

impl Lens {
    fn of(camera: &Camera) -> Self {
        let size = [camera.width as u64, camera.height as u64];
        Self { size, parameters: [camera.fx, camera.fy, camera.cx, camera.cy] }
    }
}

/// A count and records: camera number, model number, size, parameters.
fn cameras(lenses: &[Lens], model: LensModel) -> Vec<u8> {
    let (number, distortion): (i32, &[f64]) = match model {
        LensModel::Pinhole => (1, &[]),
        LensModel::OpenCv => (4, &[0.0; 4]),
    };
    let mut bytes = count(lenses.len()).to_vec();
    for (index, lens) in lenses.iter().enumerate() {
        bytes.extend((index as u32 + 1).to_le_bytes());
        bytes.extend(number.to_le_bytes());
        bytes.extend(lens.size.map(u64::to_le_bytes).concat());
        bytes.extend(floats(&lens.parameters));
        bytes.extend(floats(distortion));
    }
    bytes
}

/// A count and records: image number, pose, camera number, name, observations.
fn posed(images: &[(String, &Camera)], numbers: &[u32]) -> Vec<u8> {
    let mut bytes = count(images.len()).to_vec();
    for (index, ((name, camera), number)) in images.iter().zip(numbers).enumerate() {
        bytes.extend((index as u32 + 1).to_le_bytes());
        bytes.extend(floats(&poses::quaternion(camera)));
        bytes.extend(floats(&camera.translation.to_array()));
        bytes.extend(number.to_le_bytes());
        bytes.extend(name.bytes().chain([0]));
        bytes.extend(count(0));
    }
    bytes
}

/// A count and records: point number, position, colour, reprojection error, track.
fn cloud(points: &PointCloud) -> Vec<u8> {
    let mut bytes = count(points.len()).to_vec();
    for (index, (position, colour)) in points.positions.iter().zip(&points.colours).enumerate() {
        bytes.extend(count(index + 1));
        bytes.extend(floats(&position.as_dvec3().to_array()));
        bytes.extend(colour.to_array().map(byte));
        bytes.extend(floats(&[0.0]));
        bytes.extend(count(0));
    }
    bytes
}

fn count(number: usize) -> [u8; 8] {
    (number as u64).to_le_bytes()
}

fn floats(values: &[f64]) -> impl Iterator<Item = u8> {
    values.iter().flat_map(|value| value.to_le_bytes())
}
