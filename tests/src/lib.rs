//! What the tests that cross crates share: the compiled backends, numbers in and out of tensors, comparisons that tell
//! where they fail, and the random numbers of test scenes.

mod backends;
mod checklist;
mod numbers;

pub use backends::{Backend, backends, every_backend, gpu_backends, is_there};
pub use checklist::{Checklist, Few, Tolerance};
pub use numbers::{Array, gradient, numbers, tensor};
