//! Motion awareness: trajectory statistics, MVG and MFTA (METHOD §10).

mod attention;
mod average;
mod cache;
mod convolution;
mod direct;
mod encoder;
mod guidance;
mod lifetimes;
mod moments;
mod near;
mod normaliser;
mod position_only;
mod refinement;
mod self_attention;
mod statistics;
mod substitute;
mod temporal;
mod token;
mod tokens;

pub use attention::TemporalAttention;
pub use average::TemporalAverage;
pub use cache::{Encoding, MotionCache, Normalisers};
pub use convolution::TemporalConvolution;
pub use direct::DirectEncoder;
pub use encoder::MotionEncoder;
pub use guidance::Guidance;
pub use lifetimes::Lifetimes;
pub use moments::MomentRows;
pub use near::Near;
pub use normaliser::MovingNormaliser;
pub use refinement::{MotionRefinement, RefinedFeature, RefinementConfig, RefinementRules};
pub use statistics::{AttributeSpread, SIGNATURE_WIDTH, Trajectories, TrajectoryStatistics, VELOCITY_WIDTH};
pub use substitute::{MotionModule, Substitute, Substitutes};
pub use temporal::TemporalModule;
pub use token::GEOMETRY_WIDTH;
pub use tokens::Tokens;
