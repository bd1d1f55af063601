//! Export of a trained model for other programs: the Gaussians of each branch, or of the whole scene for viewers
//! without mask support; the cameras; and the folder layout that the viewers of 3DGS expect.

mod axes;
mod cameras;
mod compared_views;
mod fidelity;
mod glb;
pub mod html;
mod inria;
pub mod moving;
mod splat;

pub use cameras::{CAMERAS, write_cameras};
pub use compared_views::ComparedTimes;
pub use fidelity::{Fidelity, Loss, ShownGaussians};
pub use glb::encode_glb;
pub use inria::{InriaModel, write_inria};
pub use splat::{decode_splat, encode_splat};

use glam::DVec3;
use mvfusion_data::{GaussianCloud, Scene};
use mvfusion_model::ModelError;
use mvfusion_model::model::gaussians::{Gaussians, RawGaussians};
use mvfusion_model::model::{DeformationLevel, Model, RenderContext};
use mvfusion_model::timeline::spread;

use crate::args::CropArgs;
use crate::progress::Verbosity;
use crate::run::{Contents, OpenRun};

/// Gaussians of the static branch.
pub const STATIC: &str = "static.ply";
/// Gaussians of the dynamic branch.
pub const DYNAMIC: &str = "dynamic.ply";
/// The whole scene in the format `.splat`.
pub const SPLAT: &str = "scene.splat";
/// The whole scene at one time, as glTF.
pub const GLB: &str = "scene.glb";
/// The whole scene in motion.
pub const MOVING: &str = "scene.4dgs";
/// Gaussians of the static branch, as NumPy arrays.
pub const STATIC_NPZ: &str = "static.npz";
/// Gaussians of the dynamic branch, as NumPy arrays.
pub const DYNAMIC_NPZ: &str = "dynamic.npz";
/// Folder of the sequence.
pub const FRAMES: &str = "frames";

/// Everything that an export writes at the top level of its folder.
pub const CONTENTS: Contents = Contents {
    what: "export",
    entries: &[
        STATIC,
        DYNAMIC,
        SPLAT,
        GLB,
        MOVING,
        STATIC_NPZ,
        DYNAMIC_NPZ,
        FRAMES,
        CAMERAS,
        inria::POINT_CLOUD,
        inria::SETTINGS,
        inria::POINTS,
    ],
    foreign: &[],
    mark: CAMERAS,
    is_ours: cameras::is_ours,
    // An export can be made again: what waits is dropped by the next one that is complete.
    is_complete: |_| false,
    is_of_use: |_| false,
};

/// The state of the dynamic Gaussians.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// The canonical Gaussians, before deformation.
    Canonical,
    /// The Gaussians deformed to a time in `[0, 1]`.
    At(f64),
}

/// A trained model for export.
#[derive(Clone, Debug)]
pub struct Exporter {
    /// The model, without autodiff.
    pub model: Model,
    /// How the dynamic Gaussians are deformed.
    pub level: DeformationLevel,
    /// The context from the scene and the run.
    pub context: RenderContext,
}

impl Exporter {
    /// The model of a run; without temporal attention on request.
    pub fn of(run: &OpenRun, no_mfta: bool, verbosity: Verbosity) -> Self {
        Self { model: run.model(no_mfta, verbosity), level: run.level(), context: run.render_context() }
    }

    /// The part of the model in the box of the arguments, if they have one. Prints what is kept.
    ///
    /// # Errors
    /// If no Gaussian lies in the box, or the device fails.
    pub fn cropped(self, args: &CropArgs, verbosity: Verbosity) -> anyhow::Result<Self> {
        let model = args.crop(self.model, self.level, &self.context, verbosity)?;
        Ok(Self { model, ..self })
    }

    /// The Gaussians of the static branch, if there is one.
    ///
    /// # Errors
    /// If reading them from the device fails.
    pub fn static_(&self) -> Result<Option<GaussianCloud>, ModelError> {
        self.model.static_.as_ref().map(|branch| in_use(branch, branch.to_cloud()?)).transpose()
    }

    /// The Gaussians of the dynamic branch, with their mask logits if they have any.
    ///
    /// # Errors
    /// If reading them from the device fails.
    pub fn dynamic(&self, moment: Moment) -> Result<GaussianCloud, ModelError> {
        let branch = &self.model.dynamic;
        match moment {
            Moment::Canonical => in_use(branch, branch.to_cloud()?),
            Moment::At(_) => in_use(branch, self.dynamic_at(moment).to_cloud()?),
        }
    }

    /// The dynamic Gaussians for viewers without mask support: to be drawn together with the static ones, or alone if
    /// there are none ([`RawGaussians::without_masks`]).
    ///
    /// # Errors
    /// If reading them from the device fails.
    pub fn dynamic_without_masks(&self, moment: Moment) -> Result<GaussianCloud, ModelError> {
        in_use(&self.model.dynamic, self.dynamic_at(moment).without_masks().to_cloud()?)
    }

    /// The Gaussians of both branches, the static ones first, for viewers without mask support.
    ///
    /// # Errors
    /// If reading them from the device fails.
    pub fn scene(&self, moment: Moment) -> Result<GaussianCloud, ModelError> {
        let dynamic = self.dynamic_without_masks(moment)?;
        Ok(match self.static_()? {
            Some(static_) => static_.joined(dynamic),
            None => dynamic,
        })
    }

    fn dynamic_at(&self, moment: Moment) -> RawGaussians {
        match moment {
            Moment::Canonical => self.model.dynamic.canonical(),
            Moment::At(time) => self.model.dynamic_at(time, self.level, &self.context),
        }
    }
}

/// Gaussians of a branch as a viewer can show them: with values in range, and with the SH coefficients above the degree in
/// use set to zero. A viewer does not know this degree and would show the values that the deformation gives them.
fn in_use(branch: &Gaussians, gaussians: GaussianCloud) -> Result<GaussianCloud, ModelError> {
    Ok(gaussians.zero_above(branch.sh_degree).with_values_in_range())
}

/// Maximum number of [`eyes`].
const MOST_EYES: usize = 32;

/// Places from which the scene was seen, for formats whose colours do not depend on the direction: centres of training
/// cameras, spread over all of them.
pub fn eyes(scene: &Scene) -> Vec<DVec3> {
    let mut centres: Vec<DVec3> = Vec::new();
    for view in &scene.train {
        let centre = view.camera.centre();
        if !centres.contains(&centre) {
            centres.push(centre);
        }
    }
    spread(centres.len(), MOST_EYES).into_iter().map(|index| centres[index]).collect()
}

/// The times of a sequence, evenly spaced from 0 to the last training time.
pub fn frame_times(frames: usize, last: f64) -> Vec<f64> {
    (0..frames).map(|frame| last * frame as f64 / (frames.max(2) - 1) as f64).collect()
}

/// File name of a frame of a sequence. Viewers play files with a common prefix in the order of their final numbers.
pub fn frame_name(frame: usize, ending: &str) -> String {
    format!("frame{:04}.{ending}", frame + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sequence_begins_at_zero_and_ends_at_the_last_trained_time() {
        assert_eq!(frame_times(4, 0.75), [0.0, 0.25, 0.5, 0.75]);
        assert_eq!(frame_times(1, 0.75), [0.0]);
        assert_eq!([frame_name(0, "ply"), frame_name(99, "npz")], ["frame0001.ply", "frame0100.npz"]);
    }
}
