//! Which kinds of files there are, what checks each, and which of their outputs are not compared, with the reason.

use anyhow::Result;
use burn::tensor::Device;

use crate::archive::Archive;
use crate::{
    cameras, clouds, composition, densify, hexplane, images, lenses, losses, metrics, network, refinement, schedule,
    splat, statistics,
};

/// A check of one file on one device (without autodiff).
pub type Check = fn(&Archive, &Device) -> Result<()>;

/// Folders with oracles.
pub const FOLDERS: [&str; 3] = ["oracle_gsplat", "oracle_method", "oracle_metrics"];

/// A kind of files.
#[derive(Clone, Copy, Debug)]
pub struct Kind {
    /// Name in trials, and what files of the kind are called but for their seed.
    pub name: &'static str,
    /// What checks it.
    pub check: Check,
    /// Outputs that are not compared, by a part of their name, and why not.
    pub left_out: &'static [(&'static str, &'static str)],
    /// A folder beside the file's that the check reads as well.
    pub needs: Option<&'static str>,
}

const fn checked(name: &'static str, check: Check, left_out: &'static [(&'static str, &'static str)]) -> Kind {
    Kind { name, check, left_out, needs: None }
}

/// Every kind.
pub const KINDS: &[Kind] = &[
    checked("gsplat", splat::check, splat::LEFT_OUT),
    checked("hexplane", hexplane::check, &[("xyz_normalised", "an intermediate of the look-up op")]),
    checked("deform", network::check, network::LEFT_OUT),
    checked("deform_4dgs", network::check, network::LEFT_OUT),
    checked("regularisers", hexplane::check_regularisers, &[("tv_unused", "training does not use it")]),
    checked("image_ops", images::check, &[("out.psnr", "ours compares 8-bit pictures")]),
    checked("compose_eval", composition::check_evaluation, &[]),
    checked("brightness", composition::check_brightness, &[]),
    checked("lr_schedule", schedule::check, &[]),
    checked("knn_init", clouds::check, &[("f_rest_shape", "ours stores no dead coefficients")]),
    checked("densify", densify::check, densify::LEFT_OUT),
    checked("cameras_neu3d", cameras::check, cameras::LEFT_OUT),
    checked("motion_stats", statistics::check, statistics::LEFT_OUT),
    checked("normaliser", statistics::check_normaliser, &[]),
    checked("motion_forward", refinement::check, refinement::LEFT_OUT),
    checked("loss_coarse", losses::check_geometry, &[]),
    checked("loss_fine", losses::check_deformation, &[]),
    checked("undistort", lenses::check, lenses::LEFT_OUT),
    Kind { needs: Some(metrics::WEIGHTS), ..checked("grads", metrics::check_gradients, &[]) },
];

/// The kind of a file, from its folder and its name without extension; `None` if no check knows it.
pub fn kind_of(folder: &str, stem: &str) -> Option<&'static Kind> {
    let kind = |name: &str| KINDS.iter().find(|kind| kind.name == name);
    match folder {
        "oracle_gsplat" if is_scene(stem) => kind("gsplat"),
        "oracle_method" => {
            let (name, seed) = stem.rsplit_once("_seed")?;
            seed.parse::<u32>().ok().and_then(|_| kind(name))
        }
        "oracle_metrics" if stem.starts_with("grads_") => kind("grads"),
        _ => None,
    }
}

/// Whether a name is one of the splatted scenes: `s00_tiny_sh0` and its like.
fn is_scene(stem: &str) -> bool {
    stem.split_once('_').is_some_and(|(number, _)| {
        number.strip_prefix('s').is_some_and(|n| n.len() == 2 && n.bytes().all(|b| b.is_ascii_digit()))
    })
}
