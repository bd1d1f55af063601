//! The ops on a GPU: which buffers a kernel gets, and how many cubes. The kernels themselves are in
//! `mvfusion_kernels::cube`.
//!
//! Every op works in single precision.

mod adam;
mod attention;
mod bins;
mod frame;
pub(crate) mod gpu;
mod grid;
mod mlp;
mod penalties;
mod scan;
pub(crate) mod shared_memory;
mod sort;
mod splat;
mod window;
