//! Evaluation on held-out views: render, compare, average.

mod metrics;
mod protocol;
mod render;

pub use metrics::{MaskOverlap, Psnr, masked_psnr, psnr, quantise, ssim};
pub use protocol::{Evaluation, LayerScores, PROTOCOL, Scores, Split, ViewScores, evaluate};
pub use render::{BranchLayers, ViewPictures, render_view};
