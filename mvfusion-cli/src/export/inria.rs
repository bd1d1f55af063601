//! The folder layout of 3DGS, for SIBR and other viewers.

use std::path::Path;

use mvfusion_data::write::gaussian_ply;
use mvfusion_data::{GaussianCloud, PointCloud, Scene};
use mvfusion_model::Config;
use mvfusion_model::config::Background;
use mvfusion_model::model::gaussians::SH_C0;

use super::cameras::{CAMERAS, write_cameras};
use crate::atomic;
use crate::run::{self, RunFolder};

/// Folder of the Gaussians.
pub(super) const POINT_CLOUD: &str = run::POINT_CLOUD;
/// The settings of a 3DGS run, as Python writes them.
pub(super) const SETTINGS: &str = "cfg_args";
/// The initial points.
pub(super) const POINTS: &str = "input.ply";

/// The contents of the folder.
#[derive(Clone, Copy, Debug)]
pub struct InriaModel<'a> {
    /// All Gaussians, for a viewer without mask support.
    pub gaussians: &'a GaussianCloud,
    /// The scene.
    pub scene: &'a Scene,
    /// The configuration of the run.
    pub config: &'a Config,
    /// Number of training steps.
    pub steps: usize,
}

/// Writes `point_cloud/iteration_N/point_cloud.ply`, `cfg_args`, `cameras.json` and `input.ply`.
///
/// # Errors
/// If a file cannot be written.
pub fn write_inria(model: &InriaModel<'_>, folder: &RunFolder) -> anyhow::Result<()> {
    let iteration = format!("iteration_{}", model.steps);
    atomic::write(&folder.place(&[POINT_CLOUD, &iteration, "point_cloud.ply"])?, &gaussian_ply(model.gaussians))?;
    write_cameras(model.scene, &folder.place(&[CAMERAS])?)?;
    let points = match model.scene.points.is_empty() {
        true => &centres(model.gaussians),
        false => &model.scene.points,
    };
    atomic::write(&folder.place(&[POINTS])?, &mvfusion_data::write::ply(points))?;
    atomic::write(&folder.place(&[SETTINGS])?, settings(model, folder)?.as_bytes())
}

/// The settings as `repr(Namespace(…))`. Viewers read the SH degree, the background and the path of the data.
fn settings(model: &InriaModel<'_>, folder: &RunFolder) -> anyhow::Result<String> {
    let absolute = |path: &Path| anyhow::Ok(std::path::absolute(path)?.display().to_string());
    let source = model.config.scene.data.as_deref().map_or(Ok(String::new()), absolute)?;
    let here = absolute(folder.path())?;
    let white = if model.config.model.background == Background::White { "True" } else { "False" };
    Ok(format!(
        "Namespace(data_device='cuda', eval=True, images='images', model_path={}, resolution=-1, sh_degree={}, \
         source_path={}, white_background={white})",
        quoted(&here),
        model.gaussians.sh_degree,
        quoted(&source)
    ))
}

/// A text as Python writes it.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\\', "\\\\").replace('\'', "\\'"))
}

/// The centres and colours of the Gaussians, used if the scene has no points. Viewers derive the scene size from them.
fn centres(gaussians: &GaussianCloud) -> PointCloud {
    let colour = |dc: [f32; 3]| dc.map(|dc| (0.5 + SH_C0 as f32 * dc).clamp(0.0, 1.0));
    PointCloud {
        positions: gaussians.means.iter().map(|&mean| mean.into()).collect(),
        colours: gaussians.sh_dc.iter().map(|&dc| colour(dc).into()).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_are_quoted_as_python_does() {
        assert_eq!(quoted(r"C:\it's"), r"'C:\\it\'s'");
    }
}
