//! The ops on a GPU: buffers and launch sizes. The kernels themselves are in `mvfusion_kernels::cube`.
//!
//! All ops use single precision.

mod activation;
mod adam;
mod attention;
pub(crate) mod batch;
mod bins;
mod depth;
mod frame;
pub(crate) mod gpu;
mod grid;
mod mlp;
mod objective;
mod offsets;
mod penalties;
mod picture;
mod scales;
mod scan;
pub(crate) mod shared_memory;
mod sort;
mod splat;
mod totals;
pub(crate) mod window;
