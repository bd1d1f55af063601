//! Motion awareness: trajectory statistics, MVG and MFTA (METHOD §10).

mod attention;
mod cache;
mod encoder;
mod normaliser;
mod refinement;
mod statistics;
mod token;

pub use attention::TemporalAttention;
pub use cache::{MotionCache, Normalisers};
pub use encoder::MotionEncoder;
pub use normaliser::MovingNormaliser;
pub use refinement::{MotionRefinement, RefinementConfig};
pub use statistics::{AttributeSpread, SIGNATURE_WIDTH, Trajectories, TrajectoryStatistics};
pub use token::GEOMETRY_WIDTH;
