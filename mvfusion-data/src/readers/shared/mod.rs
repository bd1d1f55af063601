//! What several readers share: kinds of files, and the way from a reader's record of a picture to a view.

pub(crate) mod frames;
pub(crate) mod ply;
pub(crate) mod poses;
pub(crate) mod reduced;
pub(crate) mod shot;
mod sizes;
pub(crate) mod transforms;
pub(crate) mod views;
