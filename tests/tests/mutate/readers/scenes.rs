//! The formats of scenes, masks and camera paths.

use std::fs;
use std::path::Path;

use mvfusion_data::camera_path::read_camera_path;
use mvfusion_data::{BuiltinKind, BuiltinOptions, Capture, Layout, ReadOptions, Scene, View, builtin, open, write};

use super::{SCENES, Target, Targets, answer_of, bytes_below};
use crate::mutation::Kind;

/// The readers of this file.
pub const READERS: &[(&str, Targets)] = &[
    ("colmap_binary", |place| {
        let files = ["cameras", "images", "points3D"].map(|name| (format!("sparse/0/{name}.bin"), Kind::Plain));
        targets(place, Layout::Colmap, &files)
    }),
    ("colmap_text", |place| {
        let files = TEXT_MODEL.map(|(name, _)| (format!("0/sparse/0/{name}"), Kind::Plain));
        targets(place, Layout::RobustNerf, &files)
    }),
    ("colmap_lists", |place| {
        let files = ["train_list.txt", "test_list.txt"].map(|name| (name, Kind::Plain));
        targets(place, Layout::OnTheGoColmap, &files)
    }),
    ("dnerf", |place| targets(place, Layout::DNerf, &json(["transforms_train.json", "transforms_test.json"]))),
    ("nerfstudio", |place| targets(place, Layout::Nerfstudio, &json(["transforms.json"]))),
    ("hypernerf", |place| {
        targets(place, Layout::HyperNerf, &json(["dataset.json", "metadata.json", "scene.json", "camera/000000.json"]))
    }),
    ("panoptic", |place| targets(place, Layout::Panoptic, &json(["train_meta.json", "test_meta.json"]))),
    ("neu3d", |place| {
        let files =
            [("poses_bounds.npy", Kind::Npy), ("cam00/images/0000.png", Kind::Png), ("points3D.ply", Kind::Ply)];
        targets(place, Layout::Neu3d, &files)
    }),
    ("onthego", |place| targets(place, Layout::OnTheGo, &json(["transforms.json", "split.json"]))),
    ("multipleview", |place| {
        let files = [("sparse_/images.bin", Kind::Plain), ("points3D_multipleview.ply", Kind::Ply)];
        targets(place, Layout::MultipleView, &files)
    }),
    ("npy", |place| targets(place, Layout::HyperNerf, &[("points.npy", Kind::Npy)])),
    ("npz", |place| targets(place, Layout::Panoptic, &[("init_pt_cld.npz", Kind::Npz("data.npy"))])),
    ("camera_path", camera_paths),
];

/// A model of three photos as text. Our writers write no text models.
const TEXT_MODEL: [(&str, &str); 3] = [
    ("cameras.txt", "# Camera list\n1 OPENCV 16 16 14.5 14.5 8 8 0.01 -0.002 0.0003 0.0001\n"),
    (
        "images.txt",
        "# Image list\n1 1 0 0 0 0 0 4 1 2clutter000.png\n3.5 4.5 1\n2 0.99 0.1 0 0 0.1 0 4 1 2clutter001.png\n\n\
         3 0.98 0 0.2 0 0.2 0 4 1 1extra000.png\n1 2 -1\n",
    ),
    ("points3D.txt", "# Points\n1 0.5 0.25 1 200 100 50 0.3 1 0 2 0\n2 -0.5 0.25 1.5 20 10 250 0.3 1 1\n"),
];

fn json<const N: usize>(names: [&'static str; N]) -> [(&'static str, Kind); N] {
    names.map(|name| (name, Kind::Json))
}

/// Files of a small sound scene.
fn targets<S: AsRef<str>>(place: &Path, layout: Layout, files: &[(S, Kind)]) -> Vec<Target> {
    let folder = place.join("scene");
    write_scene(layout, &folder, (16, 16));
    complete(layout, &folder);
    sound(&open(&folder, &ReadOptions::default()).expect("a sound scene")).expect("a sound scene");
    let target = |(name, kind): &(S, Kind)| {
        let (folder, file) = (folder.clone(), folder.join(name.as_ref()));
        let others = bytes_below(&folder) - fs::metadata(&file).expect("there").len() as usize;
        let read = move || answer_of(open(&folder, &ReadOptions::default()), |scene| sound(&scene));
        Target { file, kind: *kind, room: SCENES, others, read: Box::new(read) }
    };
    files.iter().map(target).collect()
}

/// The smallest scene that a layout can hold: three photos or two frames of each camera.
pub fn write_scene(layout: Layout, folder: &Path, (width, height): (usize, usize)) {
    let kind = match layout.capture() {
        Capture::Video => BuiltinKind::Video,
        Capture::Photos => BuiltinKind::Casual,
    };
    let options = BuiltinOptions { kind, width, height, frames: 2, photos: 2, test_photos: 1, seed: 1 };
    write(&builtin::builtin(&options), layout, folder).expect("written");
}

/// Adds what our writers leave out, and removes what keeps another file from being read.
fn complete(layout: Layout, folder: &Path) {
    match layout {
        Layout::RobustNerf => {
            let model = folder.join("0/sparse/0");
            fs::remove_dir_all(&model).expect("removed");
            fs::create_dir_all(&model).expect("made");
            for (name, text) in TEXT_MODEL {
                fs::write(model.join(name), text).expect("written");
            }
        }
        Layout::OnTheGoColmap => {
            fs::write(folder.join("train_list.txt"), "2clutter000.png\n2clutter001.png\n").expect("written");
            fs::write(folder.join("test_list.txt"), "1extra000.png\n").expect("written");
        }
        // It would be read instead of `points.npy`.
        Layout::HyperNerf => fs::remove_file(folder.join("fused.ply")).expect("removed"),
        _ => {}
    }
}

/// Whether single precision can hold all numbers of a scene, times are in `[0, 1]`, and something trains.
pub fn sound(scene: &Scene) -> Result<(), String> {
    if scene.train.is_empty() {
        return Err("nothing to train on".into());
    }
    for View { name, camera, time, .. } in scene.train.iter().chain(&scene.test) {
        let intrinsics = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
        let places = [camera.centre(), camera.translation].map(|place| place.as_vec3());
        let is_finite = intrinsics.iter().all(|v| v.is_finite()) && places.iter().all(|place| place.is_finite());
        let turned = (camera.rotation.determinant() - 1.0).abs() < 0.01;
        if !is_finite || !turned || intrinsics[0] <= 0.0 || intrinsics[1] <= 0.0 || !(0.0..=1.0).contains(time) {
            return Err(format!("the view {name} at the time {time} has {camera:?}"));
        }
    }
    match scene.points.positions.iter().chain(&scene.points.colours).find(|point| !point.is_finite()) {
        Some(point) => Err(format!("a point holds {point}")),
        None => Ok(()),
    }
}

/// A path of nerfstudio's viewer, and one of 3DGS.
const CAMERA_PATHS: [&str; 2] = [
    r#"{"camera_path": [{"camera_to_world": [1,0,0,0.5, 0,1,0,0.25, 0,0,1,2, 0,0,0,1], "fov": 50, "render_time": 0.5},
        {"camera_to_world": [1,0,0,1, 0,1,0,0, 0,0,1,2, 0,0,0,1], "fov": 45}],
        "render_width": 64, "render_height": 48, "fps": 24, "camera_type": "perspective"}"#,
    r#"[{"id": 0, "position": [0, 0, -3], "rotation": [[1,0,0],[0,1,0],[0,0,1]], "fx": 60.5, "fy": 60, "width": 64,
        "height": 48, "time": 0.25}, {"position": [1, 0, -3], "rotation": [[1,0,0],[0,1,0],[0,0,1]], "fx": 60, "fy": 60,
        "width": 64, "height": 48}]"#,
];

fn camera_paths(place: &Path) -> Vec<Target> {
    let target = |(number, text): (usize, &str)| {
        let file = place.join(format!("{number}.json"));
        fs::write(&file, text).expect("written");
        let path = file.clone();
        let read = move || {
            answer_of(read_camera_path(&path), |path| {
                let numbers = |camera: &mvfusion_data::Camera| [camera.fx, camera.fy, camera.cx, camera.cy];
                let is_sound = |camera: &mvfusion_data::Camera| {
                    numbers(camera).iter().all(|v| v.is_finite()) && camera.rotation.is_finite()
                };
                let times = path.entries.iter().filter_map(|entry| entry.time);
                let odd = times.filter(|time| !(0.0..=1.0).contains(time)).count();
                let fine = path.entries.iter().all(|entry| is_sound(&entry.camera)) && !path.entries.is_empty();
                if fine && odd == 0 { Ok(()) } else { Err(format!("accepted: {path:?}")) }
            })
        };
        Target { file, kind: Kind::Json, room: super::RECORDS, others: 0, read: Box::new(read) }
    };
    CAMERA_PATHS.into_iter().enumerate().map(target).collect()
}
