//! Files, whatever the format of the scene that they belong to.
//!
//! Their content is not trusted: no path leads out of the scene's folder, and no header decides how much memory is
//! taken.

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
