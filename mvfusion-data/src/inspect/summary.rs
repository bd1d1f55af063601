//! The summary of a scene.

use serde::{Serialize, Serializer};

use super::rig::all_views;
use super::sight::Fit;
use crate::scene::{Capture, Picture, Scene, by_camera};

/// The contents of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// The scene's name.
    pub name: String,
    /// The kind of capture.
    #[serde(serialize_with = "capture_key")]
    pub capture: Capture,
    /// Distinct cameras (pose and lens).
    pub cameras: usize,
    /// Minimum and maximum number of views per camera.
    pub views_per_camera: [usize; 2],
    /// Training views.
    pub train: usize,
    /// Held-out views.
    pub test: usize,
    /// Distinct times of all views.
    pub moments: usize,
    /// First and last time.
    pub times: [f64; 2],
    /// Width of the training images in pixels.
    pub width: usize,
    /// Height of the training images in pixels.
    pub height: usize,
    /// Smallest and largest horizontal field of view, degrees.
    pub field_of_view: [f64; 2],
    /// Bytes of all images when decoded.
    pub decoded_bytes: u64,
    /// Images that were decoded for the inspection.
    pub decoded: usize,
    /// Views with a distorting lens. Their images are undistorted when read.
    pub straightened: usize,
    /// Views with a mask of valid pixels.
    pub masked: usize,
    /// Initial points.
    pub points: usize,
    /// Fraction of the points within a camera's image, as the median over the cameras; absent without points.
    pub points_seen: Option<f64>,
    /// Correlation of the points' colours with the pixels at their projections, as the median over the photos. It is in
    /// -1 to 1, and 0 for unrelated colours. Absent unless images were decoded and colours are meaningful.
    pub colour_agreement: Option<f64>,
    /// 1.1 times the largest distance of a training camera from the mean of all, in world units ([`Scene::extent`]).
    pub extent: f64,
    /// Lower bound of the distance from a camera to any surface, in world units, if the capture states it.
    pub near: Option<f64>,
}

impl Summary {
    pub(super) fn of(scene: &Scene, decoded: usize, fit: Option<Fit>) -> Self {
        let cameras = by_camera(all_views(scene));
        let per_camera = cameras.iter().map(Vec::len);
        let mut times: Vec<f64> = all_views(scene).map(|view| view.time).collect();
        times.sort_by(f64::total_cmp);
        times.dedup();
        let degrees: Vec<f64> = all_views(scene).map(|view| view.camera.field_of_view().x.to_degrees()).collect();
        let (width, height) = all_views(scene).next().map_or((0, 0), |view| view.image.size());
        Self {
            name: scene.name.clone(),
            capture: scene.capture,
            cameras: cameras.len(),
            views_per_camera: [per_camera.clone().min().unwrap_or(0), per_camera.max().unwrap_or(0)],
            train: scene.train.len(),
            test: scene.test.len(),
            moments: times.len(),
            times: [times.first().copied().unwrap_or(0.0), times.last().copied().unwrap_or(0.0)],
            width: width as usize,
            height: height as usize,
            field_of_view: [
                degrees.iter().copied().reduce(f64::min).unwrap_or(0.0),
                degrees.iter().copied().reduce(f64::max).unwrap_or(0.0),
            ],
            decoded_bytes: all_views(scene).map(|view| bytes(&view.image)).sum(),
            decoded,
            straightened: all_views(scene).filter(|view| bends(&view.image)).count(),
            masked: all_views(scene).filter(|view| view.mask.is_some()).count(),
            points: scene.points.len(),
            points_seen: fit.map(|fit| fit.seen),
            colour_agreement: fit.and_then(|fit| fit.agreement),
            extent: scene.extent(),
            near: scene.near,
        }
    }
}

fn bytes(picture: &Picture) -> u64 {
    let (width, height) = picture.size();
    3 * u64::from(width) * u64::from(height)
}

fn bends(picture: &Picture) -> bool {
    matches!(picture, Picture::File(file) if file.lenses.is_some())
}

fn capture_key<S: Serializer>(capture: &Capture, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(match capture {
        Capture::Video => "video",
        Capture::Photos => "photos",
    })
}
