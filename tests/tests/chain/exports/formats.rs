//! The interchange formats: glTF of one instant, and the container for moving Gaussians.

use std::fs;
use std::num::NonZeroUsize;

use fourdgs::keyframe_delta_file::{DecodedSequence, decode_streamed, reconstruct_at};
use glam::{DMat3, DQuat, DVec3};
use mvfusion_cli::args::ExportFormat;
use mvfusion_cli::export::moving::{Clock, MovingFile};
use mvfusion_tests::{Glb, Ply, numbers};
use serde_json::Value;

use super::{Run, parse};
use crate::training::config;

/// Rounding of numbers around one in single precision.
const ROUNDING: f64 = 1e-5;

/// One instant as glTF, and as PLY, whose own test is elsewhere.
fn instant(run: &Run, time: f64) -> (Glb, Ply, String) {
    let said = run.export_saying("instant", |args| {
        (args.format, args.time) = (vec![ExportFormat::Glb, ExportFormat::Inria], Some(time));
    });
    let out = run.place.path().join("instant");
    let iteration = format!("iteration_{}", run.trainer.state().completed);
    let ply = parse(&out.join("point_cloud").join(iteration).join("point_cloud.ply"));
    (Glb::read(&out.join("scene.glb")).expect("a file of the format"), ply, said)
}

/// The rotation from the world to glTF that a file states.
fn stated_rotation(document: &Value) -> DMat3 {
    let rows = &document["asset"]["extras"]["rotation_from_world"];
    let numbers: Vec<f64> = rows.as_array().expect("a list").iter().filter_map(Value::as_f64).collect();
    DMat3::from_cols_array(&numbers.try_into().expect("nine numbers")).transpose()
}

#[test]
fn a_glb_file_has_the_activated_values_of_every_gaussian_in_its_own_axes() {
    let run = Run::new(config());
    let (glb, ply, said) = instant(&run, 0.25);
    let document = &glb.document;
    assert_eq!((&document["asset"]["version"], &document["asset"]["extras"]["time"]), (&"2.0".into(), &0.25.into()));
    assert_eq!(document["extensionsUsed"], serde_json::json!(["KHR_gaussian_splatting"]));
    let primitive = &document["meshes"][0]["primitives"][0];
    let extension = &primitive["extensions"]["KHR_gaussian_splatting"];
    assert_eq!((&primitive["mode"], &extension["kernel"]), (&0.into(), &"ellipse".into()));
    assert_eq!(extension["colorSpace"], "srgb_rec709_display");

    let attributes = primitive["attributes"].as_object().expect("attributes");
    let rows = |name: &str| glb.rows(&attributes[name]).unwrap_or_else(|error| panic!("{name}: {error:#}"));
    let own = |name: &str| rows(&format!("KHR_gaussian_splatting:{name}"));
    // Degree 2: one, three and five coefficients; and five other attributes.
    assert_eq!(attributes.len(), 5 + 1 + 3 + 5);
    let turn = stated_rotation(document);
    assert!((turn.determinant() - 1.0).abs() < ROUNDING);
    let columns = |names: &[&str]| names.iter().map(|name| ply.column(name)).collect::<Vec<_>>();
    let (places, sizes) = (columns(&["x", "y", "z"]), columns(&["scale_0", "scale_1", "scale_2"]));
    let (opacities, rotations) = (ply.column("opacity"), columns(&["rot_0", "rot_1", "rot_2", "rot_3"]));
    let red = ply.column("f_dc_0");
    let (positions, scales, alphas) = (rows("POSITION"), own("SCALE"), own("OPACITY"));
    let (turned, constants, fallback) = (own("ROTATION"), own("SH_DEGREE_0_COEF_0"), rows("COLOR_0"));
    assert_eq!(positions.len(), ply.rows.len());
    for index in 0..positions.len() {
        let vector = |row: &[f32]| DVec3::new(row[0].into(), row[1].into(), row[2].into());
        let place = DVec3::from_array([0, 1, 2].map(|axis| f64::from(places[axis][index])));
        assert!(vector(&positions[index]).abs_diff_eq(turn * place, 1e-4), "{index}");
        for axis in 0..3 {
            let wanted = sizes[axis][index].exp();
            assert!(scales[index][axis] >= 0.0 && (scales[index][axis] / wanted - 1.0).abs() < 1e-5);
        }
        let alpha = 1.0 / (1.0 + (-f64::from(opacities[index])).exp());
        assert!((f64::from(alphas[index][0]) - alpha).abs() < ROUNDING && (0.0..=1.0).contains(&alphas[index][0]));
        assert!((f64::from(fallback[index][3]) - alpha).abs() < ROUNDING);
        assert_eq!(constants[index][0], red[index]);
        // The axes of a Gaussian turn with the world; a rotation is a unit quaternion x, y, z, w.
        let [w, x, y, z] = [0, 1, 2, 3].map(|part| f64::from(rotations[part][index]));
        let before = DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize());
        let [x, y, z, w] = [0, 1, 2, 3].map(|part| f64::from(turned[index][part]));
        let after = DQuat::from_xyzw(x, y, z, w);
        assert!((after.length() - 1.0).abs() < ROUNDING);
        assert!(DMat3::from_quat(after).abs_diff_eq(turn * before, 1e-4), "{index}");
    }
    assert!(said.contains("scene.glb") && said.contains(" dB against `mvfusion render`"), "{said}");
}

#[test]
fn the_cameras_of_a_glb_file_see_what_the_held_out_cameras_see() {
    let run = Run::new(config());
    let (glb, _, _) = instant(&run, 0.0);
    let document = &glb.document;
    let turn = stated_rotation(document);
    let nodes = document["nodes"].as_array().expect("nodes");
    let listed = document["scenes"][0]["nodes"].as_array().expect("a scene").len();
    assert_eq!((listed, &nodes[0]["mesh"]), (nodes.len(), &0.into()));
    let view = &run.scene.test[0].camera;
    let (node, point) = (&nodes[1], DVec3::new(0.1, 0.2, 0.3));
    let list = |value: &Value| value.as_array().expect("a list").iter().filter_map(Value::as_f64).collect::<Vec<_>>();
    let place = DVec3::from_slice(&list(&node["translation"]));
    let rotation = DQuat::from_slice(&list(&node["rotation"]));
    let seen = rotation.inverse() * (turn * point - place);
    let lens = &document["cameras"][0]["perspective"];
    // Clip coordinates by the formulas of glTF: x and y from -1 to 1, y up.
    let tan = (lens["yfov"].as_f64().expect("an angle") / 2.0).tan();
    let [x, y] = [seen.x / (tan * lens["aspectRatio"].as_f64().expect("a ratio")), seen.y / tan];
    let pixel = [(x / -seen.z + 1.0) / 2.0 * view.width as f64, (1.0 - y / -seen.z) / 2.0 * view.height as f64];
    let wanted = view.project(point).expect("in front of the camera");
    let off = [
        pixel[0] - (wanted.x - view.cx + view.width as f64 / 2.0),
        pixel[1] - (wanted.y - view.cy + view.height as f64 / 2.0),
    ];
    assert!(off.iter().all(|off| off.abs() < 1e-6), "{off:?}");
}

/// A film of this many samples, decoded front to back, which is another way than the program's own.
fn film(run: &Run, samples: usize) -> (DecodedSequence, String) {
    let said = run.export_saying("film", |args| {
        (args.format, args.samples) = (vec![ExportFormat::Moving], NonZeroUsize::new(samples));
    });
    let bytes = fs::read(run.place.path().join("film/scene.4dgs")).expect("read");
    (decode_streamed(&bytes).expect("a file of the format"), said)
}

#[test]
fn a_moving_file_keeps_its_error_bound_at_every_sample() {
    let run = Run::new(config());
    let context = run.trainer.render_context();
    let clock = Clock::of(&context.timeline);
    let (sequence, said) = film(&run, clock.frames());
    assert_eq!((sequence.chunks.len(), sequence.header.temporal_model.as_str()), (clock.frames(), "keyframe-delta"));
    assert!((sequence.header.duration_sec - clock.duration()).abs() < 1e-12);
    assert!(said.contains("error bound") && said.contains(" dB against `mvfusion render`"), "{said}");
    let steps = sequence.quantization.steps();
    let static_ = run.static_();
    let border = static_.means.dims()[0] as i64;
    let places = |gaussians: &mvfusion_model::model::gaussians::RawGaussians| numbers(gaussians.means.clone());
    let still = places(&static_);
    for chunk in &sequence.chunks {
        // In the middle of a sample, a Gaussian is where the model has it, but for the grids of places and velocities.
        let half = 0.5 * (chunk.t1 - chunk.t0);
        let middle = chunk.t0 + half;
        let found = reconstruct_at(&sequence, &chunk.state, middle);
        let moved = places(&run.moved(&run.model(), clock.time(middle)));
        let bound = 0.5 * steps.pos + 0.5 * steps.motion * half + ROUNDING;
        assert!(!found.ids.is_empty());
        for (row, id) in found.ids.iter().enumerate() {
            let (wanted, place) = if *id < border { (&still, *id) } else { (&moved, *id - border) };
            for axis in 0..3 {
                let off = (found.centers[3 * row + axis] - wanted[3 * place as usize + axis]).abs();
                assert!(off <= bound, "{off} beyond {bound}");
            }
        }
    }
}

#[test]
fn gaussians_move_on_straight_lines_during_a_sample_of_a_moving_file() {
    let run = Run::new(config());
    let (sequence, _) = film(&run, 2);
    let first = &sequence.chunks[0];
    let at = |share: f64| reconstruct_at(&sequence, &first.state, share * first.t1);
    let (begin, middle, end) = (at(0.0), at(0.5), at(0.999_999));
    assert_eq!((first.t0, begin.ids.len()), (0.0, end.ids.len()));
    let pairs = begin.centers.iter().zip(&end.centers).zip(&middle.centers);
    assert!(pairs.clone().all(|((begin, end), middle)| (0.5 * (begin + end) - middle).abs() < ROUNDING));
    // Not by much, after so few steps.
    assert!(begin.centers.iter().zip(&end.centers).any(|(a, b)| a != b), "something moves");
}

#[test]
fn a_damaged_moving_file_is_refused() {
    let run = Run::new(config());
    film(&run, 3);
    let path = run.place.path().join("film/scene.4dgs");
    let mut whole = MovingFile::open(&path).expect("opened");
    assert!(!whole.cloud_at(0.0).expect("Gaussians").is_empty());
    let bytes = fs::read(&path).expect("read");
    fs::write(&path, &bytes[..bytes.len() - 7]).expect("written");
    let error = MovingFile::open(&path).err().expect("refused");
    assert!(format!("{error:#}").contains("scene.4dgs"), "{error:#}");
}
