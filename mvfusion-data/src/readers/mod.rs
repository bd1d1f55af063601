//! Readers of datasets.
//!
//! Each format has a file or folder here, whose module comment lists its assumptions. [`open`] reads a folder with the
//! first reader that recognises it. Only the readers convert the conventions of files (axes, times, splits) into ours.
//! Code for several readers is in `shared`.
//!
//! A new format is a file with a constant of [`Format`] and a `READER`, and a line in `table`.

pub mod colmap;
pub mod dnerf;
mod format;
pub mod hypernerf;
mod masks;
pub mod multipleview;
pub mod nerfstudio;
pub mod neu3d;
pub mod onthego;
mod open;
mod options;
pub mod panoptic;
mod reader;
pub(crate) mod shared;
mod table;
#[cfg(test)]
mod testing;

pub use format::Format;
pub use masks::attach_masks;
pub(crate) use open::reader_for;
pub use open::{open, recognise};
pub use options::{ReadOptions, TimeRule};
pub(crate) use reader::{Reader, UsualSize};
pub use shared::ply::{read_gaussians, read_points};
pub(crate) use table::reader_of;
