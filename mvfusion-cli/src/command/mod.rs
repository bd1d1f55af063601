//! The commands, one file each.

mod check;
mod config;
mod devices;
mod duration;
mod eval;
mod export;
mod export_page;
mod prepare;
mod presets;
mod render;
mod replace;
mod report;
mod restore;
mod score;
mod speed;
mod sweep;
mod synth;
mod train;
#[cfg(feature = "viewer")]
mod view;

pub use check::check;
pub use config::config;
pub use devices::devices;
pub use eval::eval;
pub use export::export;
pub use prepare::prepare;
pub use presets::presets;
pub use render::render;
pub use report::report;
pub use restore::restore;
pub use sweep::sweep;
pub use synth::synth;
pub use train::train;
#[cfg(feature = "viewer")]
pub use train::train_in_thread;
#[cfg(feature = "viewer")]
pub use view::{view, view_until};
