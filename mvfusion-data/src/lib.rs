//! Cameras, scenes, dataset readers and the built-in scenes of MVFusion-GS.
//!
//! Everything downstream uses one type, [`Scene`]: training and held-out views, each with a camera, a time and an
//! image, and initial points. Only the readers convert conventions of files into ours. Cameras look along +z with x
//! right and y down (OpenCV). Pixel centres are at +0.5, and times are in `[0, 1]`.
//!
//! The crate contains no tensors and no devices, and depends on no other crate of the project.
//!
//! # First scene
//! ```
//! use mvfusion_data::builtin::builtin;
//! use mvfusion_data::{BuiltinOptions, DataError};
//!
//! # fn main() -> Result<(), DataError> {
//! // A scene without files; `mvfusion_data::open(folder, &ReadOptions::default())` reads a folder.
//! let scene = builtin(&BuiltinOptions { width: 64, height: 48, frames: 4, ..BuiltinOptions::default() });
//! let view = &scene.train[0];
//! let photo = view.image.rgb()?;
//! assert_eq!((photo.width(), photo.height()), (64, 48));
//!
//! // Every point of the cloud in front of a camera has a pixel.
//! let point = scene.points.positions[0].as_dvec3();
//! assert_eq!(view.camera.project(point).is_some(), view.camera.to_camera(point).z > 0.0);
//! # Ok(())
//! # }
//! ```
//!
//! # Which module do I use?
//! | module | is |
//! |---|---|
//! | [`open`] | reads a folder in any supported format |
//! | `scene` | the types that everything downstream uses: scene, view, camera, lens, image, mask, point clouds |
//! | [`readers`] | a reader for each format of a folder |
//! | [`write`](mod@write) | a writer for each layout |
//! | [`builtin`] | the built-in scenes |
//! | [`inspect`] | what is wrong with a scene |
//! | [`prepare`](mod@prepare) | a scene from photos or videos without poses, by the program COLMAP |
//! | [`motion`] | what moves in the images of still cameras |
//! | [`camera_path`] | cameras for rendering |
//! | [`keyframes`] | moving Gaussians as few bytes |
//! | `video` | decoding and encoding of videos |
//! | [`files`] | opening files whose content is not trusted |

pub mod builtin;
pub mod camera_path;
mod error;
pub mod files;
pub mod inspect;
pub mod keyframes;
pub mod motion;
pub mod prepare;
pub mod preview;
pub mod readers;
mod scene;
mod video;
pub mod write;

pub use builtin::{BuiltinKind, BuiltinOptions};
pub use error::{DataError, Refusal};
pub use readers::{Format, ReadOptions, TimeRule, attach_masks, open, read_gaussians, read_points, recognise};
pub use scene::{
    Bounds, Camera, Capture, Decoded, Distortion, ExifOrientation, GaussianCloud, LARGEST_COORDINATE, LIFETIME_FIELDS,
    Lens, Lifetime, MASK_FIELDS, Mask, NamedArray, Picture, PictureCache, PictureFile, PictureSource, PointCloud,
    Scene, Truth, View, by_camera, distinct_cameras, logit, rest_width, sigmoid, unit_quaternion,
};
pub use video::{Video, VideoWriter, can_write_videos};
pub use write::{Layout, WriteError, write};
