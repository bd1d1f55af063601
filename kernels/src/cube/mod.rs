//! The GPU kernels, written once in CubeCL for every runtime, one stage per file.
//!
//! Each file names the CPU twin with the same results. No kernel assumes a subgroup width or reads anything but its
//! arguments. The caller determines the launch size and the buffers. A launch may be folded into two dimensions:
//! kernels count cubes by `CUBE_POS` and units by `ABSOLUTE_POS`, and excess ones do nothing.

pub mod activation;
pub mod adam;
pub mod atomic;
pub mod attention;
pub mod backward_kind;
pub mod blend;
pub mod blend_backward;
pub mod catalogue;
pub mod geometry;
pub mod grid;
pub mod maths;
pub mod matrix;
mod moments;
pub mod objective;
pub mod offsets;
pub mod penalties;
pub mod picture;
pub mod product;
pub mod product_kind;
pub mod project;
pub mod project_backward;
pub mod records;
pub mod scales;
pub mod scan;
pub mod sh;
pub mod similarity;
pub mod sort;
pub mod stage;
pub mod sums;
pub mod tiles;
pub mod view;
pub mod window;

/// Largest number of buffers that a kernel takes, in `project_backward`. CubeCL binds one more, for numbers.
pub const MOST_BUFFERS: u32 = 15;

/// Units of a cube in all kernels except those for blending and products: one per pixel of a tile.
pub const UNITS: usize = crate::splat::TILE_PIXELS;
