//! Motion awareness: trajectory statistics, MVG and MFTA (METHOD §10).

mod attention;
mod average;
mod cache;
mod convolution;
mod direct;
mod encoder;
mod guidance;
mod normaliser;
mod position_only;
mod refinement;
mod self_attention;
mod statistics;
mod temporal;
mod token;

pub use attention::TemporalAttention;
pub use average::TemporalAverage;
pub use cache::{Encoding, MotionCache, Normalisers};
pub use convolution::TemporalConvolution;
pub use direct::DirectEncoder;
pub use encoder::MotionEncoder;
pub use guidance::Guidance;
pub use normaliser::MovingNormaliser;
pub use refinement::{MotionRefinement, RefinementConfig, RefinementRules};
pub use statistics::{AttributeSpread, SIGNATURE_WIDTH, Trajectories, TrajectoryStatistics};
pub use temporal::{TemporalModule, Tokens};
pub use token::GEOMETRY_WIDTH;
