//! The layout of 4DGaussians for custom captures: `camNN/frame_00001.png` and a COLMAP model `sparse_` with one image
//! per camera.
//!
//! Its reader derives a folder's name from the image's name: the text between `image` and the extension.

use tracing::warn;

use super::colmap::LensModel;
use super::error::Misfit;
use super::package::{Package, PictureEntry};
use super::rig::{Rig, RigCamera};
use super::{colmap, encode, poses};
use crate::readers::shared::poses::ROW;
use crate::scene::Scene;

pub(super) fn package(scene: &Scene) -> Result<Package<'_>, Misfit> {
    let rig = Rig::of(scene)?;
    let held_out: Vec<String> = rig.part(true).map(folder).collect();
    if !held_out.is_empty() {
        warn!(
            "this layout cannot say that {held_out:?} are held out: read it with \
             `--set 'scene.test_cameras={held_out:?}'`"
        );
    }
    let stills = rig.cameras.iter().map(|camera| Ok((format!("image{}.jpg", camera.number), camera.still()?)));
    let stills = stills.collect::<Result<Vec<_>, Misfit>>()?;
    let rows: Vec<f64> = rig
        .cameras
        .iter()
        .zip(&stills)
        .flat_map(|(camera, (_, still))| poses::llff_row(still, camera.depths(scene)))
        .collect();
    let rows = encode::npy(&[stills.len(), ROW], rows).map_err(|e| e.to_string())?;
    let mut files = colmap::model("sparse_", &stills, LensModel::Pinhole, &scene.points);
    files.push(("points3D_multipleview.ply".into(), encode::ply(&scene.points)));
    files.push(("poses_bounds_multipleview.npy".into(), rows));
    Ok(Package { pictures: rig.cameras.iter().flat_map(pictures).collect(), files })
}

fn folder(camera: &RigCamera<'_>) -> String {
    format!("cam{:02}", camera.number)
}

fn pictures<'a>(camera: &RigCamera<'a>) -> Vec<PictureEntry<'a>> {
    let entry = |(index, &view)| {
        let name = format!("{}/frame_{:05}", folder(camera), index + 1);
        PictureEntry { view, file: format!("{name}.png"), name, mask: None }
    };
    camera.views.iter().enumerate().map(entry).collect()
}
