//! Where Gaussians are added, removed and made transparent (METHOD §4.7 to §4.11).

mod branch;
mod plan;
mod relocation;
mod statistics;

pub use branch::{Branch, Census, Growth, PruneRule};
pub use plan::{DensifyPlan, ResetPlan};
pub use relocation::{RelocationPlan, Share};
pub use statistics::DensifyStatistics;
