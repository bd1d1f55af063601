//! The files beside the branches' own: cameras, `.splat`, the folder of 3DGS.

use std::fs;

use glam::{DMat3, DVec3};
use mvfusion_cli::args::ExportFormat;
use mvfusion_cli::export::eyes;
use mvfusion_data::read_gaussians;
use mvfusion_model::model::harmonics::mean_colours;
use serde_json::Value;

use super::{Run, names, parse, standard};
use crate::training::config;

#[test]
fn the_cameras_see_what_the_views_see() {
    let run = Run::new(config());
    let out = run.export("cameras", |_| {});
    let text = fs::read_to_string(out.join("cameras.json")).expect("read");
    let cameras: Vec<Value> = serde_json::from_str(&text).expect("JSON");
    let views: Vec<_> = run.scene.test.iter().chain(&run.scene.train).collect();
    assert_eq!(cameras.len(), views.len());
    let point = DVec3::new(0.1, 0.2, 0.3);
    for (id, (camera, view)) in cameras.iter().zip(views).enumerate() {
        let number = |value: &Value| value.as_f64().expect("a number");
        let vector = |value: &Value| DVec3::from_array([0, 1, 2].map(|index| number(&value[index])));
        let mut keys: Vec<&String> = camera.as_object().expect("an object").keys().collect();
        keys.sort();
        assert_eq!(keys, ["cx", "cy", "fx", "fy", "height", "id", "img_name", "position", "rotation", "width"]);
        assert_eq!((&camera["id"], &camera["img_name"]), (&id.into(), &view.name.clone().into()));
        let size = [number(&camera["width"]), number(&camera["height"])];
        assert_eq!(size, [48.0, 36.0]);
        // Rows of the rotation from camera to world, so that its transpose takes the point to the camera.
        let rotation = [0, 1, 2].map(|row| vector(&camera["rotation"][row]));
        let to_world = DMat3::from_cols_array_2d(&rotation.map(|row| row.to_array())).transpose();
        let seen = to_world.transpose() * (point - vector(&camera["position"]));
        let pixel = [
            number(&camera["fx"]) * seen.x / seen.z + number(&camera["cx"]),
            number(&camera["fy"]) * seen.y / seen.z + number(&camera["cy"]),
        ];
        let wanted = view.camera.project(point).expect("in front of every camera");
        assert!((pixel[0] - wanted.x).abs() < 1e-6 && (pixel[1] - wanted.y).abs() < 1e-6, "{}", view.name);
    }
}

#[test]
fn a_splat_file_has_a_record_for_every_gaussian_and_the_weightiest_come_first() {
    let run = Run::new(config());
    let out = run.export("splat", |args| {
        (args.format, args.time) = (vec![ExportFormat::Splat, ExportFormat::Inria], Some(0.25));
    });
    // The same Gaussians as a PLY file, whose own test is elsewhere.
    let iteration = format!("iteration_{}", run.trainer.state().completed);
    let place = out.join("point_cloud").join(iteration).join("point_cloud.ply");
    let ply = parse(&place);
    let columns = ["x", "y", "z", "scale_0", "scale_1", "scale_2", "opacity"].map(|name| ply.column(name));
    let [x, y, z, .., opacity] = &columns;
    // One colour instead of one for each direction; how it is found has tests of its own.
    let whole = read_gaussians(&place).expect("Gaussians");
    let colours = mean_colours(&whole, &eyes(&run.scene));
    let bytes = fs::read(out.join("scene.splat")).expect("read");
    assert_eq!(bytes.len(), 32 * ply.rows.len());
    let mut last = f32::INFINITY;
    for record in bytes.chunks_exact(32) {
        let float = |place: usize| f32::from_le_bytes([0, 1, 2, 3].map(|byte| record[4 * place + byte]));
        let index = (0..x.len()).find(|&i| [x[i], y[i], z[i]] == [float(0), float(1), float(2)]).expect("one of them");
        let alpha = 1.0 / (1.0 + (-opacity[index]).exp());
        let volume: f32 = (0..3).map(|axis| columns[3 + axis][index]).sum::<f32>().exp();
        let sizes = [0, 1, 2].map(|axis| (float(3 + axis) / columns[3 + axis][index].exp() - 1.0).abs());
        assert!(sizes.iter().all(|&off| off < 1e-5), "{sizes:?}");
        let level = 255.0 * colours[index][0].min(1.0);
        assert!((f32::from(record[24]) - level).abs() <= 0.51 && (f32::from(record[27]) - 255.0 * alpha).abs() <= 0.51);
        assert!(volume * alpha <= last * 1.0001, "{} after {last}", volume * alpha);
        last = volume * alpha;
    }
}

#[test]
fn the_folder_of_3dgs_has_all_that_its_viewers_ask_for() {
    let run = Run::new(config());
    let out = run.export("inria", |args| args.format = vec![ExportFormat::Inria]);
    assert_eq!(names(&out), ["cameras.json", "cfg_args", "input.ply", "point_cloud"]);
    assert_eq!(run.trainer.state().completed, 32);
    let cloud = parse(&out.join("point_cloud/iteration_32/point_cloud.ply"));
    assert_eq!(cloud.names, standard(24));
    let model = run.model();
    assert_eq!(cloud.rows.len(), model.branches().map(|(_, branch)| branch.count()).sum::<usize>());

    let settings = fs::read_to_string(out.join("cfg_args")).expect("read");
    let inside = settings.strip_prefix("Namespace(").and_then(|text| text.strip_suffix(')')).expect("a Namespace");
    let data = run.config.scene.data.as_ref().expect("a folder").display().to_string();
    for wanted in ["sh_degree=2", "white_background=False", &format!("source_path='{data}'")] {
        assert!(inside.split(", ").any(|setting| setting == wanted), "{wanted}: {settings}");
    }

    let points = fs::read(out.join("input.ply")).expect("read");
    let header = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float y\n\
         property float z\nproperty float nx\nproperty float ny\nproperty float nz\nproperty uchar red\nproperty uchar green\n\
         property uchar blue\nend_header\n",
        run.scene.points.len()
    );
    assert!(points.starts_with(header.as_bytes()));
    assert_eq!(points.len(), header.len() + 27 * run.scene.points.len());
}
