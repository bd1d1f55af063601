//! File access for all scene formats.
//!
//! The content of files is not trusted: no path leads out of the scene's folder, and no header determines how much
//! memory is allocated.

mod npy;
mod open;
mod paths;
mod pictures;
mod rotation;

pub(crate) use npy::{read_npy, read_npz};
pub(crate) use open::{COPY_OR_MEND, open_file, parse_json, read_json, read_text};
pub(crate) use paths::{below, scene_name};
pub(crate) use pictures::{entries, picture_named, pictures_in};
pub(crate) use rotation::rotation_of;
