//! The views and files of `mvfusion render`.

mod choices;
mod exr;
mod gif;
mod mark;
mod mp4;
mod outputs;
mod views;

pub use choices::{
    FileFormat, LayerChoice, chosen_layers, parse_fps, parse_frames, parse_layer, parse_size, parse_time, parse_weights,
};
pub use outputs::{Outputs, OutputsPlan};
pub use views::{Film, Frame, LEAST_SIDE, Reframing, Selection, Views};
