//! Evaluation on held-out views: render, compare, average.

mod blended_clouds;
mod evaluate;
mod evaluator;
mod heat;
mod layer;
mod layer_scores;
mod layers;
mod metric;
mod metrics;
mod protocol;
mod refinement;
mod render;
mod scores;
mod speed;
mod tone;

pub use blended_clouds::{blended_picture, contributions};
pub use evaluate::{Split, evaluate};
pub use evaluator::{Evaluator, Pair, Regions, ViewMetrics};
pub use heat::{MotionLayers, heat_colours};
pub use layer::Layer;
pub use layer_scores::LayerScores;
pub use layers::{LayerRenderer, LayerScale, RenderedLayer};
pub use metric::{Better, Metric};
pub use metrics::lpips::conversion as lpips_conversion;
pub use metrics::lpips::{Backbone, Distance, InputRange, Lpips, LpipsVariant};
pub use metrics::{
    MaskOverlap, PixelMap, Psnr, RegionSource, SMALL, SSIM_BORDER, SmallMovers, SmallMoversRecall, TemporalDeviation,
    TemporalScores, components, decibels, dilate, dissimilarity, masked_psnr, ms_ssim, psnr, quantise, sequences,
    squared_errors, ssim_map,
};
pub use protocol::{Precision, Protocol};
pub use refinement::{AttentionFigures, ModuleFigures, RefinementFigures, RefinementSurvey, Replacement};
pub use render::{BranchImages, ViewPictures};
pub use scores::{Evaluation, HeldOutPhoto, Scores, ViewScores};
pub use speed::{Speed, WARM_UP, measure_speed};
pub use tone::DepthRange;
