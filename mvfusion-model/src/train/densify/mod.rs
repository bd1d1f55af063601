//! Densification, pruning, relocation and opacity resets (METHOD §4.7 to §4.11).

mod branch;
mod gradients;
mod plan;
mod relocation;
mod statistics;
mod visibility;

pub use branch::{Branch, BranchState, DensifyCounts, PruneRule};
pub use gradients::BranchGradients;
pub use plan::{DensifyPlan, ResetPlan};
pub use relocation::{RelocationPlan, Share};
pub use statistics::DensifyStatistics;
pub use visibility::Visibility;
