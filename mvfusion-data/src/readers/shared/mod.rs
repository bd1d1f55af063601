//! Code for several readers: file types, and the conversion of a reader's shot to a view.

mod exif;
pub(crate) mod frame_numbers;
pub(crate) mod frames;
pub(crate) mod ignored_masks;
pub(crate) mod ply;
pub(crate) mod poses;
pub(crate) mod reduced;
pub(crate) mod shot;
pub(crate) mod sizes;
pub(crate) mod transforms;
pub(crate) mod views;
