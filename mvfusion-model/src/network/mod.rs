//! The deformation network: HexPlane, trunk, heads.

mod deformation;
mod heads;
mod hexplane;
mod layers;

pub use deformation::{DeformationConfig, DeformationNetwork, HeadChoice};
pub use heads::{AttributeHeads, MaskHeads, Offsets};
pub use hexplane::HexPlane;
pub use layers::{LayerInit, Mlp, zero_last_layer};
pub(crate) use layers::{Rectified, side_by_side};
