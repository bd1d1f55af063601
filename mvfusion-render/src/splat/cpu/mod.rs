//! The splat op on slices: the CPU twin, generic over `f32` and `f64`, without Burn.
//!
//! The forward stages are: [`project`] each Gaussian (with [`sh`] for its colour), bin them into [`tiles`], [`blend`]
//! each tile front to back. The backward stages are [`blend_backward`] for each tile, then [`project_backward`] for
//! each Gaussian. Every sum has a fixed order, so results do not depend on the number of threads.

pub(crate) mod backward;
pub(crate) mod blend;
pub(crate) mod blend_backward;
pub(crate) mod cloud;
mod depth_order;
pub(crate) mod forward;
pub(crate) mod lanes;
mod moments;
pub(crate) mod project;
pub(crate) mod project_backward;
pub(crate) mod sh;
pub(crate) mod tile_rectangle;
pub(crate) mod tiles;
pub(crate) mod view;

#[cfg(test)]
mod vector_tests;
