//! Cameras, scenes, dataset readers and the built-in scene of MVFusion-GS.
//!
//! Everything downstream sees one type, [`Scene`]: views with a camera, a time and a picture, split into training and
//! test, plus a cloud of points to start from. Conventions of the files are turned into ours in the readers and nowhere
//! else: cameras look along +z with x right and y down (OpenCV), pixel centres lie at +0.5, times lie in `[0, 1]`.
//!
//! [`open`] reads a folder, [`builtin`](builtin::builtin) makes a scene that needs no files.

pub mod builtin;
mod camera;
pub mod colmap;
mod error;
mod frames;
mod masks;
pub mod neu3d;
mod picture;
mod ply;
mod points;
mod poses;
mod reader;
mod scene;

pub use builtin::{BuiltinKind, BuiltinOptions};
pub use camera::Camera;
pub use error::{DataError, Refusal};
pub use masks::attach_masks;
pub use picture::Picture;
pub use ply::read_points;
pub use points::PointCloud;
pub use reader::{ReadOptions, open};
pub use scene::{Bounds, Capture, Scene, Truth, View};
