//! A view: an image with its camera, its time and its ground truth.

use std::sync::Arc;

use super::camera::Camera;
use super::mask::Mask;
use super::picture::Picture;

/// One image of a camera at a time.
#[derive(Clone, Debug)]
pub struct View {
    /// Name, unique among the training views and among the held-out views, such as `cam00/0003`.
    pub name: String,
    /// The camera, for the size of [`View::image`].
    pub camera: Camera,
    /// Time in `[0, 1]`.
    pub time: f64,
    /// The photo.
    pub image: Picture,
    /// Mask of its valid pixels; all are valid without a mask.
    pub mask: Option<Mask>,
    /// Ground truth beyond the photo. For evaluation only, never for training.
    pub truth: Truth,
}

/// Ground truth of a view beyond its photo. Unknown items are absent.
#[derive(Clone, Debug, Default)]
pub struct Truth {
    /// The photo without anything that moves.
    pub background: Option<Picture>,
    /// White where something moves.
    pub dynamic_mask: Option<Picture>,
    /// Whether [`Truth::dynamic_mask`] is exact, as in a built-in scene, and not an annotation.
    pub is_mask_exact: bool,
    /// White on visible movers, which change their position; objects that sway in place are excluded. Only built-in
    /// scenes have it, and only together with [`Truth::dynamic_mask`].
    pub movers_mask: Option<Picture>,
    /// Depth along the camera's z axis in world units at the pixel centres, row by row. Only built-in scenes have it.
    pub depth: Option<Arc<Vec<f32>>>,
}
