//! Neu3D: `camNN/images/0000.png`, `poses_bounds.npy` and `points3D.ply`.

use super::error::Misfit;
use super::package::{Package, PictureEntry};
use super::rig::{Rig, RigCamera};
use super::{encode, poses};
use crate::readers::shared::poses::ROW;
use crate::scene::Scene;

pub(super) fn package(scene: &Scene) -> Result<Package<'_>, Misfit> {
    let rig = Rig::of(scene)?;
    let (held_out, count) = (rig.part(true).count(), rig.cameras.len());
    if held_out != 1 {
        return Err(format!(
            "{held_out} of its {count} cameras are held out, and that layout holds out the first alone"
        ));
    }
    let mut rows = Vec::with_capacity(count * ROW);
    for camera in &rig.cameras {
        let still = camera.still()?;
        if !poses::is_plain(still) {
            let name = camera.name;
            return Err(format!("the pixels of {name} are not square, or its principal point is not in the middle"));
        }
        rows.extend(poses::llff_row(still, camera.depths(scene)));
    }
    let rows = encode::npy(&[count, ROW], rows).map_err(|e| e.to_string())?;
    // Rows follow the sorted names, so all numbers need equally many digits.
    let digits = rig.cameras.last().map_or(0, |c| c.number).to_string().len().max(2);
    Ok(Package {
        pictures: rig.cameras.iter().flat_map(|camera| pictures(camera, digits)).collect(),
        files: vec![("poses_bounds.npy".into(), rows), ("points3D.ply".into(), encode::ply(&scene.points))],
    })
}

fn pictures<'a>(camera: &RigCamera<'a>, digits: usize) -> Vec<PictureEntry<'a>> {
    let name = format!("cam{:0digits$}", camera.number);
    let entry = |(index, &view)| PictureEntry {
        view,
        file: format!("{name}/images/{index:04}.png"),
        name: format!("{name}/{index:04}"),
        mask: None,
    };
    camera.views.iter().enumerate().map(entry).collect()
}
