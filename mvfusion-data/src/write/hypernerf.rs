//! Nerfies and HyperNeRF: one file per camera, and lists that define the split.
//!
//! `points.npy` cannot contain colours, so `fused.ply`, which DeGauss reads, repeats the points with colours.

use std::collections::BTreeMap;

use serde::Serialize;

use super::depths::Depths;
use super::encode;
use super::error::Misfit;
use super::package::{Package, PictureEntry};
use super::rig::camera_name;
use crate::scene::{Camera, Scene, View};

#[derive(Serialize)]
struct Dataset<'a> {
    count: usize,
    num_exemplars: usize,
    ids: &'a [String],
    train_ids: &'a [String],
    val_ids: &'a [String],
}

/// Indices of the codes that the original networks learn: for the moment, the lighting and the camera.
#[derive(Serialize)]
struct Metadata {
    warp_id: usize,
    appearance_id: usize,
    camera_id: usize,
}

/// The similarity transform from the world to the world of the cameras; here the identity.
#[derive(Serialize)]
struct SceneRecord {
    scale: f64,
    center: [f64; 3],
    near: f64,
    far: f64,
}

#[derive(Serialize)]
struct CameraRecord {
    /// From the world to the camera, by rows.
    orientation: [[f64; 3]; 3],
    position: [f64; 3],
    focal_length: f64,
    principal_point: [f64; 2],
    skew: f64,
    /// Focal length along y / focal length along x.
    pixel_aspect_ratio: f64,
    radial_distortion: [f64; 3],
    tangential_distortion: [f64; 2],
    image_size: [usize; 2],
}

pub(super) fn package(scene: &Scene) -> Result<Package<'_>, Misfit> {
    let views: Vec<&View> = scene.train.iter().chain(&scene.test).collect();
    let ids: Vec<String> = (0..views.len()).map(|index| format!("{index:06}")).collect();
    let (train_ids, val_ids) = ids.split_at(scene.train.len());
    let dataset = Dataset { count: ids.len(), num_exemplars: train_ids.len(), ids: &ids, train_ids, val_ids };
    let depths = Depths::around(views.iter().map(|view| Depths::of(scene, &[view])));
    let depths = depths.ok_or("it has no view")?;
    let record = SceneRecord { scale: 1.0, center: [0.0; 3], near: depths.near, far: depths.far };
    let positions = scene.points.positions.iter().flat_map(|p| p.to_array());
    let points = encode::npy(&[scene.points.len(), 3], positions).map_err(|e| e.to_string())?;
    let mut files = vec![
        ("dataset.json".into(), encode::json(&dataset)?),
        ("metadata.json".into(), encode::json(&metadata(&views, &ids))?),
        ("scene.json".into(), encode::json(&record)?),
        ("points.npy".into(), points),
        ("fused.ply".into(), encode::ply(&scene.points)),
    ];
    for (id, view) in ids.iter().zip(&views) {
        files.push((format!("camera/{id}.json"), encode::json(&CameraRecord::of(&view.camera))?));
    }
    let entry =
        |(id, view)| PictureEntry { view, file: format!("rgb/1x/{id}.png"), name: String::clone(id), mask: None };
    Ok(Package { pictures: ids.iter().zip(views).map(entry).collect(), files })
}

/// The moment of a view is the rank of its time.
fn metadata<'a>(views: &[&View], ids: &'a [String]) -> BTreeMap<&'a str, Metadata> {
    let mut times: Vec<f64> = views.iter().map(|view| view.time).collect();
    times.sort_by(f64::total_cmp);
    times.dedup();
    let mut cameras: Vec<Option<&str>> = views.iter().map(|view| camera_name(view)).collect();
    cameras.sort();
    cameras.dedup();
    let entry = |(id, view): (&'a String, &&View)| {
        let moment = times.partition_point(|time| *time < view.time);
        let camera_id = cameras.partition_point(|name| *name < camera_name(view));
        (id.as_str(), Metadata { warp_id: moment, appearance_id: moment, camera_id })
    };
    ids.iter().zip(views).map(entry).collect()
}

impl CameraRecord {
    fn of(camera: &Camera) -> Self {
        Self {
            orientation: [0, 1, 2].map(|row| camera.rotation.row(row).to_array()),
            position: camera.centre().to_array(),
            focal_length: camera.fx,
            principal_point: [camera.cx, camera.cy],
            skew: 0.0,
            pixel_aspect_ratio: camera.fy / camera.fx,
            radial_distortion: [0.0; 3],
            tangential_distortion: [0.0; 2],
            image_size: [camera.width, camera.height],
        }
    }
}
