//! What the tests that cross crates share: the compiled backends, numbers in and out of tensors, comparisons that tell
//! where they fail, the random numbers of test scenes, and a cluster of one node.

mod backends;
mod checklist;
mod numbers;
mod slurm;

pub use backends::{Backend, backends, every_backend, gpu_backends, is_there};
pub use checklist::{Checklist, Few, Tolerance};
pub use numbers::{Array, gradient, numbers, tensor};
pub use slurm::Cluster;
