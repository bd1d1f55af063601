//! The training objective: a main loss that also drives densification, and a light loss that does not (METHOD §4.4). A
//! model with one branch has a single loss (§9).

mod context;
mod light;
mod main;
mod motion;
mod pictures;
mod schedule;
mod single;
pub mod terms;

pub use context::{LossContext, Windows};
pub use light::light_loss;
pub(crate) use light::scale_loss;
pub use main::main_loss;
pub use motion::{MotionMasks, MotionWitness};
pub use pictures::Pictures;
pub use schedule::LossSchedule;
pub use single::single_loss;

#[cfg(test)]
mod tests;
