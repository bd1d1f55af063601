//! `--format npz`, read as NumPy describes its files.

use std::collections::BTreeMap;
use std::fs::File;
use std::num::NonZeroUsize;
use std::path::Path;

use mvfusion_cli::args::ExportFormat;
use mvfusion_model::config::Branches;
use mvfusion_model::model::gaussians::RawGaussians;
use mvfusion_tests::numbers;
use npyz::{NpyFile, Order};
use zip::ZipArchive;

use super::{Run, names};
use crate::training::config;

/// Values are activated in double precision and rounded to single.
const ROUNDING: f64 = 2e-7;

/// Shape and values of every array.
type Arrays = BTreeMap<String, (Vec<u64>, Vec<f64>)>;

fn read(path: &Path) -> Arrays {
    let mut archive = ZipArchive::new(File::open(path).expect("there")).expect("a zip archive");
    let mut arrays = Arrays::new();
    for index in 0..archive.len() {
        let entry = archive.by_index(index).expect("an entry");
        let name = entry.name().expect("a name").strip_suffix(".npy").expect("an array").to_owned();
        let file = NpyFile::new(entry).expect("NumPy's header");
        assert_eq!(file.order(), Order::C);
        let shape = file.shape().to_vec();
        let values = match name.as_str() {
            "time" => file.into_vec::<f64>().expect("float64"),
            _ => file.into_vec::<f32>().expect("float32").into_iter().map(f64::from).collect(),
        };
        arrays.insert(name, (shape, values));
    }
    arrays
}

fn sigmoid(logits: Vec<f64>) -> Vec<f64> {
    logits.into_iter().map(|logit| 1.0 / (1.0 + (-logit).exp())).collect()
}

/// The arrays are these Gaussians, activated.
fn assert_holds(arrays: &Arrays, gaussians: &RawGaussians) {
    let [count, coefficients, _] = gaussians.sh.dims().map(|length| length as u64);
    let scales = numbers(gaussians.log_scales.clone()).into_iter().map(f64::exp).collect();
    let unit = |rotation: &[f64]| {
        let length = rotation.iter().map(|part| part * part).sum::<f64>().sqrt();
        rotation.iter().map(|part| part / length).collect::<Vec<_>>()
    };
    let rotations = numbers(gaussians.quaternions.clone()).chunks_exact(4).flat_map(unit).collect();
    let sh = numbers(gaussians.sh.clone());
    let colours = sh.chunks_exact(3 * coefficients as usize).flat_map(|row| &row[..3]);
    let mut wanted: Vec<(&str, Vec<u64>, Vec<f64>)> = vec![
        ("means", vec![count, 3], numbers(gaussians.means.clone())),
        ("quaternions", vec![count, 4], rotations),
        ("scales", vec![count, 3], scales),
        ("opacities", vec![count], sigmoid(numbers(gaussians.opacity_logits.clone()))),
        ("colours", vec![count, 3], colours.map(|dc| 0.5 + 0.282_094_791_773_878_14 * dc).collect()),
        ("sh", vec![count, coefficients, 3], sh.clone()),
    ];
    if let Some(logits) = &gaussians.mask_logits {
        wanted.push(("masks", vec![count, 3], sigmoid(numbers(logits.clone()))));
    }
    assert_eq!(arrays.keys().filter(|name| *name != "time").count(), wanted.len(), "{:?}", arrays.keys());
    for (name, shape, values) in wanted {
        let (found_shape, found) = &arrays[name];
        assert_eq!(*found_shape, shape, "{name}");
        for (found, wanted) in found.iter().zip(&values) {
            assert!((found - wanted).abs() <= ROUNDING * (1.0 + wanted.abs()), "{name}: {found} and {wanted}");
        }
    }
}

#[test]
fn arrays_are_the_activated_gaussians_of_each_branch() {
    let run = Run::new(config());
    let out = run.export("arrays", |args| args.format = vec![ExportFormat::Npz]);
    assert_eq!(names(&out), ["cameras.json", "dynamic.npz", "static.npz"]);
    assert_holds(&read(&out.join("static.npz")), &run.static_());
    let dynamic = read(&out.join("dynamic.npz"));
    assert_holds(&dynamic, &run.model().dynamic.canonical());
    assert!(!dynamic.contains_key("time"), "canonical Gaussians belong to no time");
}

#[test]
fn arrays_of_a_sequence_are_the_deformed_gaussians_and_tell_their_time() {
    let run = Run::new(config());
    let both = vec![ExportFormat::Npz, ExportFormat::Ply];
    for (name, format, files) in [
        ("npz", vec![ExportFormat::Npz], vec!["frame0001.npz", "frame0002.npz"]),
        ("both", both, vec!["frame0001.npz", "frame0001.ply", "frame0002.npz", "frame0002.ply"]),
    ] {
        let out = run.export(name, |args| (args.frames, args.format) = (NonZeroUsize::new(2), format));
        assert_eq!(names(&out.join("frames")), files);
        let last = *run.trainer.render_context().timeline.times().last().expect("a time");
        for (file, time) in [("frame0001.npz", 0.0), ("frame0002.npz", last)] {
            let arrays = read(&out.join("frames").join(file));
            assert_eq!(arrays["time"], (vec![], vec![time]));
            assert_holds(&arrays, &run.moved(&run.model(), time));
        }
    }
}

#[test]
fn a_model_of_one_branch_has_arrays_without_masks() {
    let mut config = config();
    config.model.branches = Branches::Dynamic;
    config.loss.composed_dssim = 0.0;
    let run = Run::new(config);
    let out = run.export("one", |args| (args.format, args.time) = (vec![ExportFormat::Npz], Some(0.4)));
    assert_eq!(names(&out), ["cameras.json", "dynamic.npz"]);
    let arrays = read(&out.join("dynamic.npz"));
    assert_eq!(arrays["time"].1, [0.4]);
    assert_holds(&arrays, &run.moved(&run.model(), 0.4));
}
