//! Training: stages, batches, one step after the other.

mod batch;
mod births;
mod checkpoint;
mod contribution;
mod finite;
mod parameters;
mod sampler;
mod stage;
mod state;
mod step;
mod still;
mod trainer;
mod turn;
mod update;

pub use batch::{Batch, Photo, Photos, mask_tensor, picture_tensor};
pub use checkpoint::{load_model, parameter_hash};
pub use contribution::Contribution;
pub use sampler::{Sampler, Visits};
pub use stage::{Position, Stage};
pub use state::TrainState;
pub use step::StepLoss;
pub use trainer::{IMAGE_CACHE, Trainer, final_movement};
