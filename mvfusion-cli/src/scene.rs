//! The scene that a configuration asks for.

use mvfusion_data::colmap::ColmapOptions;
use mvfusion_data::neu3d::Neu3dOptions;
use mvfusion_data::{BuiltinOptions, ReadOptions, Scene};
use mvfusion_model::Config;

/// Opens the folder `scene.data`, or makes the built-in scene, and attaches the masks of `eval.dynamic_masks`.
///
/// # Errors
/// If folder or masks cannot be read.
pub fn open(config: &Config) -> anyhow::Result<Scene> {
    let options = &config.scene;
    let mut scene = match &options.data {
        Some(folder) => {
            let neu3d = Neu3dOptions { downscale: options.downscale, frames: Some(options.frames), time: options.time };
            let colmap = ColmapOptions { downscale: options.downscale, ..Default::default() };
            mvfusion_data::open(folder, &ReadOptions { colmap, neu3d })?
        }
        None => {
            let builtin = BuiltinOptions { seed: options.seed, ..BuiltinOptions::of_kind(options.kind) };
            mvfusion_data::builtin::builtin(&builtin)
        }
    };
    if let Some(folder) = &config.eval.dynamic_masks {
        mvfusion_data::attach_masks(&mut scene, folder)?;
    }
    Ok(scene)
}

/// A scene in a line, for people.
pub fn describe(scene: &Scene) -> String {
    let size = scene.train.first().map_or(String::new(), |view| {
        let (width, height) = view.image.size();
        format!(" of {width}x{height}")
    });
    let (train, test) = (scene.train.len(), scene.test.len());
    let points = scene.points.len();
    format!("{}: {train} views to train on and {test} held out{size}, {points} points to start from", scene.name)
}
