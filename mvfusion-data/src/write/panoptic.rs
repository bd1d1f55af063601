//! Panoptic Sports in the format of Dynamic 3D Gaussians: files of training and test cameras, `ims/`, and
//! `init_pt_cld.npz`.

use serde::Serialize;

use super::error::Misfit;
use super::package::{Package, PictureEntry};
use super::rig::{Rig, RigCamera};
use super::{encode, poses};
use crate::scene::{PointCloud, Scene};

/// Values per point: position, colour, and a foreground flag.
const POINT: usize = 7;

/// `train_meta.json` and `test_meta.json`: lists by moment, then by camera.
#[derive(Serialize)]
struct Meta {
    w: usize,
    h: usize,
    k: Vec<Vec<[[f64; 3]; 3]>>,
    w2c: Vec<Vec<[[f64; 4]; 4]>>,
    #[serde(rename = "fn")]
    file: Vec<Vec<String>>,
    cam_id: Vec<Vec<usize>>,
}

pub(super) fn package(scene: &Scene) -> Result<Package<'_>, Misfit> {
    let rig = Rig::of(scene)?;
    let mut pictures = Vec::with_capacity(scene.train.len() + scene.test.len());
    for camera in rig.part(false).chain(rig.part(true)) {
        for (index, &view) in camera.views.iter().enumerate() {
            let name = frame_name(camera, index);
            pictures.push(PictureEntry { view, file: format!("ims/{name}.png"), name, mask: None });
        }
    }
    let points = init_points(&scene.points).map_err(|e| e.to_string())?;
    Ok(Package {
        pictures,
        files: vec![
            ("train_meta.json".into(), encode::json(&meta(&rig, false))?),
            ("test_meta.json".into(), encode::json(&meta(&rig, true))?),
            ("init_pt_cld.npz".into(), points),
        ],
    })
}

/// `7/000003`, for camera 7.
fn frame_name(camera: &RigCamera<'_>, index: usize) -> String {
    format!("{}/{index:06}", camera.number)
}

fn meta(rig: &Rig<'_>, held_out: bool) -> Meta {
    let size = &rig.cameras[0].views[0].camera;
    let mut meta =
        Meta { w: size.width, h: size.height, k: Vec::new(), w2c: Vec::new(), file: Vec::new(), cam_id: Vec::new() };
    for index in 0..rig.frames() {
        let cameras = || rig.part(held_out).map(|c| &c.views[index].camera);
        meta.k.push(cameras().map(poses::intrinsics).collect());
        meta.w2c.push(cameras().map(poses::world_to_camera).collect());
        meta.file.push(rig.part(held_out).map(|c| format!("{}.png", frame_name(c, index))).collect());
        meta.cam_id.push(rig.part(held_out).map(|c| c.number).collect());
    }
    meta
}

/// The points. All count as background, because structure from motion finds still points.
fn init_points(points: &PointCloud) -> std::io::Result<Vec<u8>> {
    let rows = points.positions.iter().zip(&points.colours);
    let numbers = rows.flat_map(|(p, c)| [p.x, p.y, p.z, c.x, c.y, c.z, 0.0].map(f64::from));
    encode::npz("data", &encode::npy(&[points.len(), POINT], numbers)?)
}
