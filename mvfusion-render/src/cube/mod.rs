//! The ops on a GPU: which buffers a kernel gets, and how many cubes. The kernels themselves are in
//! `mvfusion_kernels::cube`.
//!
//! Every op works in single precision, and panics on tensors of another dtype.

mod adam;
mod attention;
pub(crate) mod gpu;
mod grid;
mod mlp;
mod penalties;
mod scan;
mod sort;
mod splat;
mod window;
