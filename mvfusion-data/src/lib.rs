//! Cameras, scenes, dataset readers and the built-in scene of MVFusion-GS.
//!
//! Everything downstream sees one type, [`Scene`]: views with a camera, a time and a picture, split into training and
//! test, plus a cloud of points to start from. Conventions of the files are turned into ours in the readers and nowhere
//! else: cameras look along +z with x right and y down (OpenCV), pixel centres lie at +0.5, times lie in `[0, 1]`.

mod camera;
mod error;
mod points;
mod scene;

pub use camera::Camera;
pub use error::DataError;
pub use points::PointCloud;
pub use scene::{Bounds, Capture, Picture, Scene, Truth, View};
