//! What the tests that cross crates share: the compiled backends, numbers in and out of tensors, comparisons that tell
//! where they fail, a reader for files of Gaussians, and a cluster of one node.

mod backends;
mod checklist;
mod numbers;
mod ply;
mod slurm;

pub use backends::{Backend, backends, every_backend, gpu_backends, is_there};
pub use checklist::{Checklist, Few, Tolerance};
pub use numbers::{Array, gradient, numbers, tensor};
pub use ply::Ply;
pub use slurm::Cluster;
