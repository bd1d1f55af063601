//! What `mvfusion export` writes, read by parsers of the test's own that know the formats' descriptions alone; and what
//! becomes of it when training starts from it.

mod files;
mod import;

use std::fs;
use std::path::{Path, PathBuf};

use mvfusion_cli::args::{ComputeArgs, ExportArgs, ExportFormat};
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::{command, config as configs, scene as scenes};
use mvfusion_data::{Layout, Scene, write};
use mvfusion_model::config::{Branches, Config, Interval};
use mvfusion_model::model::gaussians::RawGaussians;
use mvfusion_model::model::mask::MaskChannel;
use mvfusion_model::model::{DeformationLevel, Model};
use mvfusion_model::train::Trainer;
use mvfusion_tests::{Ply, backends, numbers};
use tempfile::TempDir;

use crate::training::{config, scene, train};

/// A finished run in a folder.
struct Run {
    place: TempDir,
    config: Config,
    scene: Scene,
    trainer: Trainer,
}

impl Run {
    /// Trains on a small video in files.
    fn new(mut config: Config) -> Self {
        let place = tempfile::tempdir().expect("folder");
        let data = place.path().join("scene");
        write(&scene(), Layout::Neu3d, &data).expect("written");
        config.scene.data = Some(data);
        let scene = scenes::open(&config).expect("the scene is there");
        let device = (backends()[0].device)();
        let mut trainer = Trainer::new(config.clone(), &scene, &device).expect("the run can start");
        train(&mut trainer);
        let run = Self { place, config, scene, trainer };
        fs::create_dir_all(run.folder().join("checkpoints")).expect("made");
        run.trainer.state().save(&run.checkpoint()).expect("saved");
        fs::write(run.folder().join("config.toml"), configs::to_toml(&run.config).expect("TOML")).expect("written");
        run
    }

    fn folder(&self) -> PathBuf {
        self.place.path().join("run")
    }

    fn checkpoint(&self) -> PathBuf {
        self.folder().join("checkpoints/final.safetensors")
    }

    /// Exports into a folder of this name, with further arguments.
    fn export(&self, name: &str, change: impl FnOnce(&mut ExportArgs)) -> PathBuf {
        let out = self.place.path().join(name);
        let mut args = ExportArgs {
            run: self.folder(),
            out: out.clone(),
            format: vec![ExportFormat::Ply],
            time: None,
            frames: None,
            no_mfta: false,
            data: None,
            compute: ComputeArgs { device: backends()[0].name.to_owned(), threads: None },
            force: false,
        };
        change(&mut args);
        command::export(&args, Verbosity::Silent, &mut Vec::new()).expect("exported");
        out
    }

    fn model(&self) -> Model {
        self.trainer.state().model.plain()
    }

    fn moved(&self, model: &Model, time: f64) -> RawGaussians {
        model.dynamic_at(time, DeformationLevel::Refined, self.trainer.render_context())
    }

    fn static_(&self) -> RawGaussians {
        self.model().static_.expect("a static branch").canonical()
    }
}

/// The Gaussians in a file.
fn parse(path: &Path) -> Ply {
    Ply::read(path).expect("a file of Gaussians")
}

/// The standard properties in their order.
fn standard(rest: usize) -> Vec<String> {
    let own = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
    let before = own(&["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"]);
    let after = own(&["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"]);
    [before, (0..rest).map(|index| format!("f_rest_{index}")).collect(), after].concat()
}

/// Compares every property of some rows of a file, but for the opacity, with Gaussians.
fn assert_holds(ply: &Ply, rows: std::ops::Range<usize>, gaussians: &RawGaussians) {
    let check = |name: String, wanted: Vec<f64>| {
        let found: Vec<f64> = ply.column(&name)[rows.clone()].iter().map(|&value| f64::from(value)).collect();
        assert_eq!(found, wanted, "{name}");
    };
    let column = |values: &[f64], width: usize, index: usize| -> Vec<f64> {
        values.iter().skip(index).step_by(width).copied().collect()
    };
    let [count, coefficients, _] = gaussians.sh.dims();
    assert_eq!(count, rows.len());
    let (means, scales) = (numbers(gaussians.means.clone()), numbers(gaussians.log_scales.clone()));
    let (rotations, sh) = (numbers(gaussians.quaternions.clone()), numbers(gaussians.sh.clone()));
    for (index, axis) in ["x", "y", "z"].into_iter().enumerate() {
        check(axis.to_owned(), column(&means, 3, index));
        check(format!("n{axis}"), vec![0.0; count]);
        check(format!("scale_{index}"), column(&scales, 3, index));
        check(format!("f_dc_{index}"), column(&sh, 3 * coefficients, index));
        // Channel by channel: coefficient k of 1 .. K stands at channel (K - 1) + k - 1.
        for k in 1..coefficients {
            let name = format!("f_rest_{}", index * (coefficients - 1) + k - 1);
            check(name, column(&sh, 3 * coefficients, 3 * k + index));
        }
    }
    for index in 0..4 {
        check(format!("rot_{index}"), column(&rotations, 4, index));
    }
}

fn assert_opacities(ply: &Ply, rows: std::ops::Range<usize>, gaussians: &RawGaussians) {
    let found: Vec<f64> = ply.column("opacity")[rows].iter().map(|&value| f64::from(value)).collect();
    assert_eq!(found, numbers(gaussians.opacity_logits.clone()));
}

#[test]
fn every_exported_number_is_the_models_own() {
    let run = Run::new(config());
    let out = run.export("plain", |_| {});
    let static_ = parse(&out.join("static.ply"));
    // Degree 2: eight higher coefficients of three colours.
    assert_eq!(static_.names, standard(24));
    assert_holds(&static_, 0..static_.rows.len(), &run.static_());
    assert_opacities(&static_, 0..static_.rows.len(), &run.static_());

    let dynamic = parse(&out.join("dynamic.ply"));
    let canonical = run.model().dynamic.canonical();
    let masks = ["mask_static", "mask_brightness", "mask_dynamic"];
    assert_eq!(dynamic.names, [standard(24), masks.map(str::to_owned).to_vec()].concat());
    assert_holds(&dynamic, 0..dynamic.rows.len(), &canonical);
    assert_opacities(&dynamic, 0..dynamic.rows.len(), &canonical);
    let logits = numbers(canonical.mask_logits.expect("masks"));
    let found = dynamic.rows.iter().flat_map(|row| row[row.len() - 3..].to_vec()).map(f64::from);
    assert_eq!(found.collect::<Vec<_>>(), logits);
}

#[test]
fn a_moment_is_the_deformed_model_with_or_without_attention() {
    let run = Run::new(config());
    let with = run.model();
    let mut without = with.clone();
    without.refinement.temporal = None;
    for (name, no_mfta, model) in [("with", false, &with), ("without", true, &without)] {
        let out = run.export(name, |args| (args.time, args.no_mfta) = (Some(0.4), no_mfta));
        let found = parse(&out.join("dynamic.ply"));
        let wanted = run.moved(model, 0.4);
        assert_holds(&found, 0..found.rows.len(), &wanted);
        assert_opacities(&found, 0..found.rows.len(), &wanted);
        assert_ne!(numbers(wanted.means), numbers(run.model().dynamic.means.val()));
    }
    let means = |model| numbers(run.moved(model, 0.4).means);
    assert_ne!(means(&with), means(&without));
}

#[test]
fn a_sequence_has_the_frames_that_were_asked_for_and_begins_at_time_zero() {
    let run = Run::new(config());
    let out = run.export("sequence", |args| args.frames = std::num::NonZeroUsize::new(3));
    assert_eq!(names(&out.join("frames")), ["frame0001.ply", "frame0002.ply", "frame0003.ply"]);
    let context = run.trainer.render_context();
    let last = *context.timeline.times().last().expect("a time");
    for (name, time) in [("frame0001.ply", 0.0), ("frame0002.ply", last / 2.0), ("frame0003.ply", last)] {
        let frame = parse(&out.join("frames").join(name));
        assert_eq!(frame.names, standard(24), "a viewer knows no masks");
        let (static_, dynamic) = (run.static_(), run.moved(&run.model(), time));
        let border = static_.means.dims()[0];
        assert_holds(&frame, 0..border, &static_);
        assert_opacities(&frame, 0..border, &static_);
        assert_holds(&frame, border..frame.rows.len(), &dynamic);
        assert_masked_opacities(&frame.column("opacity")[border..], &dynamic);
    }
}

/// An opacity of a Gaussian is its own times the share of the foreground in its mask.
fn assert_masked_opacities(found: &[f32], gaussians: &RawGaussians) {
    let sigmoid = |logit: f64| 1.0 / (1.0 + (-logit).exp());
    let logits = numbers(gaussians.opacity_logits.clone());
    let masks = numbers(gaussians.mask_logits.clone().expect("masks"));
    let mut lowered = 0;
    for (index, (&found, &own)) in found.iter().zip(&logits).enumerate() {
        let [static_, dynamic] =
            [MaskChannel::Static, MaskChannel::Dynamic].map(|channel| sigmoid(masks[3 * index + channel as usize]));
        let wanted = sigmoid(own) * dynamic / (dynamic + static_);
        assert!((sigmoid(f64::from(found)) - wanted).abs() < 3e-6, "Gaussian {index}: {found}, not {wanted}");
        lowered += usize::from(f64::from(found) < own);
    }
    assert_eq!(lowered, logits.len());
}

#[test]
fn a_model_of_one_branch_is_exported_as_it_is() {
    let mut config = config();
    config.model.branches = Branches::Dynamic;
    config.loss.composed_dssim = 0.0;
    let run = Run::new(config);
    let out = run.export("one", |args| args.frames = std::num::NonZeroUsize::new(1));
    assert_eq!(names(&out), ["cameras.json", "dynamic.ply", "frames"]);
    let frame = parse(&out.join("frames/frame0001.ply"));
    let dynamic = run.moved(&run.model(), 0.0);
    assert_eq!(frame.names, standard(24));
    assert_holds(&frame, 0..frame.rows.len(), &dynamic);
    assert_opacities(&frame, 0..frame.rows.len(), &dynamic);
}

#[test]
fn colours_above_the_degree_in_use_are_zero_as_they_are_not_drawn() {
    let mut config = config();
    (config.train.dynamic_sh_interval, config.train.static_sh_interval) = (Interval(1000), Interval(1000));
    let run = Run::new(config);
    assert_eq!(run.model().dynamic.sh_degree, 0);
    let moved = numbers(run.moved(&run.model(), 0.4).sh.narrow(1, 1, 8));
    assert!(moved.iter().any(|&value| value != 0.0), "the deformation offers colours that are not drawn yet");
    let out = run.export("low", |args| args.time = Some(0.4));
    let found = parse(&out.join("dynamic.ply"));
    assert!((0..24).all(|index| found.column(&format!("f_rest_{index}")).iter().all(|&value| value == 0.0)));
}

/// Names in a folder, sorted.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).expect("listed").map(|entry| entry.expect("entry").file_name());
    let mut names: Vec<String> = entries.map(|name| name.into_string().expect("UTF-8")).collect();
    names.sort();
    names
}
