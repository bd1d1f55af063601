//! File access for all formats.
//!
//! The content of files is not trusted: no path leads out of the scene's folder, no header determines how much memory
//! is allocated, and what is no regular file is not opened. The files of a run or a sweep are opened in the same way.

mod denied;
mod npy;
mod open;
mod paths;
mod pictures;
mod rotation;
mod temporary;

pub(crate) use denied::{denied, or_denied};
pub(crate) use npy::{read_npy, read_npz};
pub(crate) use open::{COPY_OR_MEND, dataset_text, parse_json, read_json};
pub use open::{open_file, read_bytes, read_text};
pub(crate) use paths::{below, scene_name, with_slashes};
pub(crate) use pictures::{entries, others_than, picture_named, pictures_in};
pub(crate) use rotation::rotation_of;
pub(crate) use temporary::TemporaryFolder;
