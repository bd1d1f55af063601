//! The commands, one file each.

mod check;
mod completions;
mod config;
mod devices;
mod duration;
mod eval;
mod export;
mod export_page;
mod json;
mod lpips_weights;
mod man;
mod prepare;
mod presets;
mod render;
mod replace;
mod report;
mod restore;
mod score;
mod speed;
mod sweep;
mod sweep_status;
mod synth;
mod train;
#[cfg(feature = "viewer")]
mod view;

pub use check::check;
pub use completions::completions;
pub use config::config;
pub use devices::devices;
pub use eval::eval;
pub use export::export;
pub use lpips_weights::lpips_weights;
pub use man::man;
pub use prepare::prepare;
pub use presets::presets;
pub use render::render;
pub use report::report;
pub use restore::restore;
pub use sweep::sweep;
pub use synth::synth;
#[cfg(feature = "viewer")]
pub use train::train_in_thread;
pub use train::{Observer, train, train_observed};
#[cfg(feature = "viewer")]
pub use view::{view, view_until};
