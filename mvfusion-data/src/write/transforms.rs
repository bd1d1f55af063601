//! `transforms.json` and related files: cameras for nerfstudio, NeRF On-the-go and D-NeRF.

use serde::Serialize;

use super::package::PictureEntry;
use super::poses;
use crate::scene::Camera;

/// A file of cameras with their own intrinsics.
#[derive(Serialize)]
pub(super) struct Transforms {
    /// The common intrinsics, if all frames share them.
    #[serde(flatten)]
    pub(super) lens: Option<LensRecord>,
    #[serde(flatten)]
    pub(super) split: Option<SplitRecord>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) ply_file_path: Option<String>,
    pub(super) frames: Vec<FrameRecord>,
}

/// The split of the images.
#[derive(Serialize)]
pub(super) struct SplitRecord {
    pub(super) train_filenames: Vec<String>,
    /// The same names as for testing. nerfstudio requires all three lists if there is one.
    pub(super) val_filenames: Vec<String>,
    pub(super) test_filenames: Vec<String>,
}

/// A lens without distortion. It is written as OPENCV with zero coefficients, because every reader supports that model.
#[derive(Clone, Copy, PartialEq, Serialize)]
pub(super) struct LensRecord {
    camera_model: &'static str,
    w: usize,
    h: usize,
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
}

#[derive(Serialize)]
pub(super) struct FrameRecord {
    pub(super) file_path: String,
    #[serde(flatten)]
    pub(super) lens: Option<LensRecord>,
    pub(super) transform_matrix: [[f64; 4]; 4],
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) time: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) mask_path: Option<String>,
}

impl LensRecord {
    fn of(camera: &Camera) -> Self {
        let &Camera { width, height, fx, fy, cx, cy, .. } = camera;
        let (k1, k2, p1, p2) = (0.0, 0.0, 0.0, 0.0);
        Self { camera_model: "OPENCV", w: width, h: height, fl_x: fx, fl_y: fy, cx, cy, k1, k2, p1, p2 }
    }
}

impl FrameRecord {
    /// A frame without intrinsics and time.
    pub(super) fn of(entry: &PictureEntry<'_>, file_path: String) -> Self {
        let transform_matrix = poses::opengl_to_world(&entry.view.camera);
        Self { file_path, lens: None, transform_matrix, time: None, mask_path: entry.mask.clone() }
    }
}

impl Transforms {
    /// Cameras and paths of the images.
    pub(super) fn of(entries: &[PictureEntry<'_>]) -> Self {
        let lenses: Vec<LensRecord> = entries.iter().map(|entry| LensRecord::of(&entry.view.camera)).collect();
        let lens = lenses.first().copied().filter(|first| lenses.iter().all(|other| other == first));
        let frame = |(entry, own): (&PictureEntry<'_>, LensRecord)| FrameRecord {
            lens: lens.is_none().then_some(own),
            ..FrameRecord::of(entry, entry.file.clone())
        };
        let frames = entries.iter().zip(lenses.iter().copied()).map(frame).collect();
        Self { lens, split: None, ply_file_path: None, frames }
    }
}
