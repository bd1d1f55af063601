//! The kernels that run on a GPU, written once in CubeCL for every runtime: one stage a file.
//!
//! Each file names the CPU twin whose results it has. None assumes a width of the hardware's vectors, and none
//! reads more than its arguments; how large a launch must be, and which buffers it needs, is the caller's to know.
//! A launch may be folded in two dimensions: kernels count cubes by `CUBE_POS` and units by `ABSOLUTE_POS`, and those
//! beyond the work do nothing.

pub mod adam;
pub mod atomic;
pub mod attention;
pub mod backward_kind;
pub mod blend;
pub mod blend_backward;
pub mod geometry;
pub mod grid;
pub mod maths;
mod moments;
pub mod penalties;
pub mod product;
pub mod project;
pub mod project_backward;
pub mod scan;
pub mod sh;
pub mod sort;
pub mod stage;
pub mod tiles;
pub mod view;
pub mod window;

/// Buffers that the kernel with the most of them binds, `project_backward`.
pub const MOST_BUFFERS: u32 = 16;

/// Units of a cube, in every kernel but those that blend or multiply: as many as a tile has pixels.
pub const UNITS: usize = crate::splat::TILE_PIXELS;
