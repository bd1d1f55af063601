//! The commands, a file each.

mod config;
mod devices;
mod eval;
mod presets;
mod score;
mod train;

pub use config::config;
pub use devices::devices;
pub use eval::eval;
pub use presets::presets;
pub use train::train;
