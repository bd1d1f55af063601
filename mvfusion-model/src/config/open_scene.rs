//! The scene that a configuration asks for.

use mvfusion_data::{BuiltinOptions, ReadOptions, Scene};
use tracing::warn;

use super::Config;
use crate::ModelError;

impl Config {
    /// Opens the folder `scene.data`, or creates the built-in scene, and attaches the masks of `eval.dynamic_masks`.
    ///
    /// # Errors
    /// If the folder or the masks cannot be read.
    pub fn open_scene(&self) -> Result<Scene, ModelError> {
        let options = &self.scene;
        let mut scene = match &options.data {
            Some(folder) => mvfusion_data::open(folder, &self.read_options())?,
            None => {
                let of_folders = [
                    ("format", options.format.is_some()),
                    ("downscale", options.downscale != 1.0),
                    ("test_cameras", options.test_cameras.is_some()),
                ];
                for (key, _) in of_folders.into_iter().filter(|(_, is_set)| *is_set) {
                    warn!(
                        "scene.{key} has no effect on the built-in scene; scene.data names the folder of another one"
                    );
                }
                let (seed, photos) = (options.seed, options.photos);
                let builtin = BuiltinOptions { seed, photos, ..BuiltinOptions::of_kind(options.kind) };
                mvfusion_data::builtin::builtin(&builtin)
            }
        };
        if let Some(folder) = &self.eval.dynamic_masks {
            mvfusion_data::attach_masks(&mut scene, folder)?;
        }
        Ok(scene)
    }

    /// The options for reading a scene folder.
    pub fn read_options(&self) -> ReadOptions {
        let scene = &self.scene;
        ReadOptions {
            format: scene.format,
            capture: scene.capture,
            downscale: scene.downscale,
            frames: Some(scene.frames),
            time: scene.time,
            test_every: scene.test_every,
            test_cameras: scene.test_cameras.clone(),
            // Transparent images are composited over the background colour of the renderer.
            backdrop: [(255.0 * self.model.background.level()).round() as u8; 3],
            invert_masks: scene.invert_masks,
            frame_store: scene.frame_store.clone(),
        }
    }
}
