//! The commands, a file each.

mod check;
mod config;
mod devices;
mod eval;
mod presets;
mod score;
mod synth;
mod train;

pub use check::check;
pub use config::config;
pub use devices::devices;
pub use eval::eval;
pub use presets::presets;
pub use synth::{parse_size, synth};
pub use train::train;
