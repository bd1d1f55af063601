//! The deformation network: HexPlane, trunk, heads.

mod deformation;
mod heads;
mod hexplane;
mod layers;

pub use deformation::{DeformationConfig, DeformationNetwork};
pub use heads::{AttributeHeads, HeadChoice, MaskHeads, Offsets};
pub use hexplane::HexPlane;
pub use layers::{Mlp, ModuleInit, residual_mlp, zero_last_layer};
pub(crate) use layers::{Rectified, side_by_side};
