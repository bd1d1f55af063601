//! Evaluation on held-out views: render, compare, average.

mod evaluate;
mod figure;
mod judge;
mod layer;
mod layers;
mod metrics;
mod protocol;
mod render;
mod scores;
mod speed;
mod tone;

pub use evaluate::{Split, evaluate};
pub use figure::{Better, Figure};
pub use judge::{Judge, Pair, Regions, Verdict};
pub use layer::Layer;
pub use layers::{LayerRenderer, RenderedLayer};
pub use metrics::lpips::{Backbone, Distance, InputRange, Lpips, LpipsVariant};
pub use metrics::{
    MaskOverlap, PixelMap, Psnr, RegionSource, SMALL, SSIM_BORDER, SmallMovers, SmallMoversRecall, TemporalDeviation,
    TemporalScores, components, decibels, dilate, dissimilarity, masked_psnr, ms_ssim, psnr, quantise, sequences,
    squared_errors, ssim_map,
};
pub use protocol::{Precision, Protocol};
pub use render::{BranchLayers, ViewPictures};
pub use scores::{Evaluation, HeldOutPhoto, LayerScores, Scores, ViewScores};
pub use speed::{Speed, WARM_UP, measure_speed};
