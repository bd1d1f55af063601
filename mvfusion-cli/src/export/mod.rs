//! A trained model as files for other programs: Gaussians of each branch, or of the whole scene as a viewer without
//! masks shows it; cameras; and the folder that the viewers of 3DGS expect.

mod cameras;
mod inria;
mod splat;

pub use cameras::{CAMERAS, write_cameras};
pub use inria::{InriaModel, write_inria};
pub use splat::write_splat;

use mvfusion_data::GaussianCloud;
use mvfusion_model::ModelError;
use mvfusion_model::model::gaussians::{Gaussians, RawGaussians};
use mvfusion_model::model::{DeformationLevel, Model, RenderContext};

use crate::run::Contents;

/// Gaussians of the static branch.
pub const STATIC: &str = "static.ply";
/// Gaussians of the dynamic branch.
pub const DYNAMIC: &str = "dynamic.ply";
/// The whole scene in the format `.splat`.
pub const SPLAT: &str = "scene.splat";
/// Folder of the sequence.
pub const FRAMES: &str = "frames";

/// All that an export writes at the top of its folder.
pub const CONTENTS: Contents = Contents {
    what: "export",
    entries: &[STATIC, DYNAMIC, SPLAT, FRAMES, CAMERAS, inria::POINT_CLOUD, inria::SETTINGS, inria::POINTS],
};

/// Which Gaussians the dynamic branch shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Moment {
    /// The canonical ones, before they are moved.
    Canonical,
    /// Those of a time in `[0, 1]`.
    At(f64),
}

/// A trained model whose Gaussians are asked for.
#[derive(Clone, Debug)]
pub struct Exporter {
    /// The model, without autodiff.
    pub model: Model,
    /// How far the dynamic Gaussians are moved.
    pub level: DeformationLevel,
    /// What it needs to know of the scene and the run.
    pub context: RenderContext,
}

impl Exporter {
    /// The Gaussians of the static branch, if there is one.
    ///
    /// # Errors
    /// If the device cannot hand them over.
    pub fn static_(&self) -> Result<Option<GaussianCloud>, ModelError> {
        self.model.static_.as_ref().map(|branch| in_use(branch, branch.to_cloud()?)).transpose()
    }

    /// The Gaussians of the dynamic branch with the logits of their masks, if they have them.
    ///
    /// # Errors
    /// If the device cannot hand them over.
    pub fn dynamic(&self, moment: Moment) -> Result<GaussianCloud, ModelError> {
        let branch = &self.model.dynamic;
        match moment {
            Moment::Canonical => in_use(branch, branch.to_cloud()?),
            Moment::At(_) => in_use(branch, self.dynamic_at(moment).to_cloud()?),
        }
    }

    /// The Gaussians of both branches, the static ones first, for viewers that know no mask: it weighs the opacities
    /// of the dynamic ones ([`RawGaussians::without_masks`]).
    ///
    /// # Errors
    /// If the device cannot hand them over.
    pub fn scene(&self, moment: Moment) -> Result<GaussianCloud, ModelError> {
        let dynamic = in_use(&self.model.dynamic, self.dynamic_at(moment).without_masks().to_cloud()?)?;
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

/// Gaussians of a branch without the colours that it does not use yet: a viewer, which knows no degree in use, would
/// show what the deformation does to them.
fn in_use(branch: &Gaussians, gaussians: GaussianCloud) -> Result<GaussianCloud, ModelError> {
    Ok(gaussians.zero_above(branch.sh_degree))
}

/// The times of a sequence: evenly spread from 0 to the last time that was trained on.
pub fn frame_times(frames: usize, last: f64) -> Vec<f64> {
    (0..frames).map(|frame| last * frame as f64 / (frames.max(2) - 1) as f64).collect()
}

/// Name of a frame of a sequence: viewers play files of one prefix in the order of the numbers at their ends.
pub fn frame_name(frame: usize) -> String {
    format!("frame{:04}.ply", frame + 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sequence_begins_at_zero_and_ends_at_the_last_trained_time() {
        assert_eq!(frame_times(4, 0.75), [0.0, 0.25, 0.5, 0.75]);
        assert_eq!(frame_times(1, 0.75), [0.0]);
        assert_eq!((frame_name(0), frame_name(99)), ("frame0001.ply".to_owned(), "frame0100.ply".to_owned()));
    }
}
