//! The content of the files of some layouts, checked without our readers. These might share an error with the writers.

use serde_json::Value;

use super::*;

fn json(folder: &Path, name: &str) -> Value {
    let text = std::fs::read_to_string(folder.join(name)).expect(name);
    serde_json::from_str(&text).expect(name)
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

#[test]
fn panoptic_lists_cameras_by_moment_and_packs_the_points() {
    let scene = scene(Capture::Video);
    let folder = written(&scene, Layout::Panoptic);
    for (file, cameras, part) in [("train_meta.json", 7, &scene.train), ("test_meta.json", 1, &scene.test)] {
        let meta = json(folder.path(), file);
        assert_eq!((&meta["w"], &meta["h"]), (&48.into(), &32.into()));
        for key in ["k", "w2c", "fn", "cam_id"] {
            let moments = meta[key].as_array().expect(key);
            assert_eq!(moments.len(), FRAMES, "{file}: {key}");
            assert!(moments.iter().all(|moment| moment.as_array().is_some_and(|list| list.len() == cameras)));
        }
        let name = meta["fn"][2][0].as_str().expect("a name");
        assert_eq!(name, format!("{}/000002.png", meta["cam_id"][2][0]));
        exists(&folder.path().join("ims"), name);
        let camera = &part[2].camera;
        assert_eq!(numbers(&meta["w2c"][2][0][1])[3], camera.translation.y);
        assert_eq!(numbers(&meta["w2c"][2][0][2])[..3], camera.rotation.row(2).to_array());
        assert_eq!(numbers(&meta["k"][2][0][0]), [camera.fx, 0.0, camera.cx]);
    }
    let file = std::fs::File::open(folder.path().join("init_pt_cld.npz")).expect("points");
    let mut archive = zip::ZipArchive::new(file).expect("archive");
    let array = npyz::NpyFile::new(archive.by_name("data.npy").expect("data")).expect("array");
    assert_eq!(array.shape(), [scene.points.len() as u64, 7]);
    let rows: Vec<f64> = array.into_vec().expect("float64");
    let (position, colour) = (scene.points.positions[1], scene.points.colours[1]);
    let row = [position.x, position.y, position.z, colour.x, colour.y, colour.z, 0.0].map(f64::from);
    assert_eq!(rows[7..14], row);
}

#[test]
fn multipleview_has_an_image_a_camera_whose_number_is_the_folders() {
    let scene = scene(Capture::Video);
    let folder = written(&scene, Layout::MultipleView);
    for camera in 0..8 {
        for frame in 1..=FRAMES {
            exists(folder.path(), &format!("cam{camera:02}/frame_{frame:05}.png"));
        }
    }
    let images = std::fs::read(folder.path().join("sparse_/images.bin")).expect("images");
    assert_eq!(images[..8], 8u64.to_le_bytes());
    for camera in 0..8 {
        let name = format!("image{camera}.jpg\0");
        assert!(images.windows(name.len()).any(|part| part == name.as_bytes()), "{name}");
    }
    let rows =
        crate::readers::shared::poses::read_rows(&folder.path().join("poses_bounds_multipleview.npy")).expect("rows");
    assert_eq!(rows.len(), 8);
    let points = crate::read_points(&folder.path().join("points3D_multipleview.ply")).expect("points");
    assert_same_points(&scene.points, &points);
    exists(folder.path(), &format!("{MASKS_TRUTH}/cam03/frame_00002.png"));
}

#[test]
fn hypernerf_describes_every_picture_and_parts_them() {
    let scene = scene(Capture::Video);
    let folder = written(&scene, Layout::HyperNerf);
    let dataset = json(folder.path(), "dataset.json");
    let list = |key: &str| dataset[key].as_array().expect(key).clone();
    assert_eq!(list("ids").len(), scene.train.len() + scene.test.len());
    assert_eq!((list("train_ids").len(), list("val_ids").len()), (scene.train.len(), scene.test.len()));
    let metadata = json(folder.path(), "metadata.json");
    let views = scene.train.iter().chain(&scene.test);
    for (id, view) in list("ids").iter().zip(views) {
        let id = id.as_str().expect("an id");
        exists(folder.path(), &format!("rgb/1x/{id}.png"));
        let camera = json(folder.path(), &format!("camera/{id}.json"));
        assert_eq!(numbers(&camera["position"]), view.camera.centre().to_array());
        assert_eq!(numbers(&camera["orientation"][0]), view.camera.rotation.row(0).to_array());
        assert_eq!(numbers(&camera["image_size"]), [48.0, 32.0]);
        let moment = (view.time * FRAMES as f64).round();
        let number: usize = view.name[3..5].parse().expect("cam00/0000");
        assert_eq!(metadata[id]["warp_id"].as_f64(), Some(moment));
        assert_eq!(metadata[id]["camera_id"].as_f64(), Some(number as f64));
    }
    let record = json(folder.path(), "scene.json");
    assert!(record["near"].as_f64() > Some(0.1) && record["far"].as_f64() > record["near"].as_f64());
    let points = std::fs::read(folder.path().join("points.npy")).expect("points");
    assert_eq!(npyz::NpyFile::new(&points[..]).expect("array").shape(), [scene.points.len() as u64, 3]);
}
