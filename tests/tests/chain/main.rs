//! The whole chain, from parameters to pictures and back: gradients against finite differences, the start of the last
//! stage, sameness of runs, checkpoints, memory, exports and imports.
#![recursion_limit = "256"]

mod allocations;
mod bad_steps;
mod child;
mod differences;
mod exports;
mod layouts;
mod lpips_weights;
mod margins;
mod memory;
mod network_gradients;
mod pictures;
mod ranges;
mod splat_gradients;
mod start;
mod switches;
mod training;
mod variants;
mod viewer;

#[global_allocator]
static ALLOCATOR: allocations::Counting = allocations::Counting;
