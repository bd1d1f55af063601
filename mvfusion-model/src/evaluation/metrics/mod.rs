//! Image metrics, one file per metric. [`super::Protocol`] lists the metrics of each protocol.

pub mod lpips;
mod ms_ssim;
mod overlap;
mod picture;
mod pixel_map;
mod psnr;
mod region;
mod small_movers;
mod ssim;
mod temporal;

pub use ms_ssim::{dissimilarity, ms_ssim};
pub use overlap::MaskOverlap;
pub use picture::quantise;
pub use pixel_map::PixelMap;
pub use psnr::{Psnr, decibels, masked_psnr, psnr, squared_errors};
pub use region::{RegionSource, TemporalDeviation, dilate};
pub use small_movers::{SMALL, SmallMovers, SmallMoversRecall, components};
pub use ssim::{SSIM_BORDER, ssim_map};
pub use temporal::{TemporalScores, sequences};
