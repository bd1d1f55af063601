//! What the tests that cross crates share: the compiled backends, aligned poses, numbers in and out of tensors,
//! comparisons that tell where they fail, readers for files of Gaussians, a cluster of one node, and a page of the
//! viewer without a browser.

mod alignment;
mod backends;
mod checklist;
mod glb;
mod numbers;
mod ply;
mod slurm;
mod torch;
mod viewer;

pub use alignment::{PoseError, PoseErrors, Similarity};
pub use backends::{Backend, backends, every_backend, gpu_backends, is_there};
pub use checklist::{Checklist, Few, Tolerance};
pub use glb::Glb;
pub use numbers::{Array, gradient, numbers, splat_gradients, tensor, with_padded_rows};
pub use ply::Ply;
pub use slurm::Cluster;
pub use torch::{TorchContainer, TorchTensors, pickled, text};
pub use viewer::ViewerClient;

/// Settings of `mvfusion train` for a model that learns a step in milliseconds.
pub const SMALL_MODEL: [&str; 6] = [
    "train.batch_size=1",
    "model.width=8",
    "model.grid={features=2, resolution=[4, 4, 4, 4], multipliers=[1]}",
    "init.dynamic_points=60",
    "init.motion_points=60",
    "motion.samples=4",
];
