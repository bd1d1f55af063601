//! Cameras, scenes, dataset readers and the built-in scene of MVFusion-GS.
//!
//! Everything downstream sees one type, [`Scene`]: views with a camera, a time and a picture, split into training and
//! test, plus a cloud of points to start from. Conventions of the files are turned into ours in the readers and nowhere
//! else: cameras look along +z with x right and y down (OpenCV), pixel centres lie at +0.5, times lie in `[0, 1]`.
//!
//! [`open`] reads a folder, [`builtin`](builtin::builtin) makes a scene that needs no files, [`inspect`](inspect::inspect)
//! says what a folder lacks, and [`write`](write::write()) puts a scene on the disk in a layout of the field.

pub mod builtin;
mod cache;
mod camera;
pub mod camera_path;
pub mod colmap;
pub mod dnerf;
mod error;
mod frames;
mod gaussian_cloud;
pub mod hypernerf;
pub mod inspect;
mod jpeg;
mod lens;
mod masks;
pub mod motion;
pub mod multipleview;
pub mod nerfstudio;
pub mod neu3d;
mod npy;
pub mod onthego;
mod options;
pub mod panoptic;
mod paths;
mod picture;
mod ply;
mod points;
mod poses;
mod reader;
mod reduced;
mod rotation;
mod scene;
mod shapes;
mod shot;
#[cfg(test)]
mod testing;
mod transforms;
mod undistort;
mod video;
pub mod write;

pub use builtin::{BuiltinKind, BuiltinOptions};
pub use cache::{Decoded, PictureCache};
pub use camera::Camera;
pub use error::{DataError, Refusal};
pub use gaussian_cloud::{GaussianCloud, LIFETIME_FIELDS, Lifetime, MASK_FIELDS, rest_width};
pub use lens::{Bend, Lens};
pub use masks::{Mask, attach_masks};
pub use options::{ReadOptions, TimeRule};
pub use picture::{Picture, PictureFile, PictureSource};
pub use ply::{read_gaussians, read_points};
pub use points::PointCloud;
pub use reader::{Format, open, recognise};
pub use scene::{Bounds, Capture, Scene, Truth, View};
pub use video::{Video, VideoWriter, can_write_videos};
pub use write::{Layout, WriteError, write};
