//! The commands, a file each.

mod config;
mod eval;
mod presets;
mod score;
mod train;

pub use config::config;
pub use eval::eval;
pub use presets::presets;
pub use train::train;
