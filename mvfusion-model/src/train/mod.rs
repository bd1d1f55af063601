//! Training: stages, batches, steps, losses, densification, checkpoints.

mod bad_step;
mod batch;
pub mod births;
mod checkpoint;
pub mod densify;
mod finite;
pub mod loss;
mod losses;
pub mod optim;
mod parameters;
mod rendered;
mod sampler;
mod stage;
mod state;
mod step;
mod still;
mod trainer;
mod turn;
mod update;
mod view;

pub use bad_step::{BadSteps, MOST_BAD_STEPS};
pub use batch::{Batch, TrainingViews, mask_tensor, picture_tensor};
pub use checkpoint::{Checkpoint, TrainedModel, parameter_bytes, parameter_hash};
pub use densify::{BranchGradients, Visibility};
pub use losses::Losses;
pub use rendered::RenderedBatch;
pub use sampler::{Sampler, Visits};
pub use stage::{Position, Stage};
pub use state::TrainState;
pub use trainer::{IMAGE_CACHE, Trainer};
pub use update::StepGradients;
pub use view::TrainingView;
