//! Adam for changing rows, Adam for modules, and the learning rates of a step (METHOD §4.5).

mod gaussian;
mod module;
mod rates;

pub use gaussian::{GaussianGradients, GaussianOptimiser};
pub use module::ModuleOptimiser;
pub use rates::{GaussianRates, Rates};
