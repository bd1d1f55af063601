//! What `mvfusion export` writes, read by parsers of the test's own that know the formats' descriptions alone; and what
//! becomes of it when training starts from it.

mod arrays;
mod crop;
mod files;
mod formats;
mod import;
mod page;

use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};

use clap::Parser;
use mvfusion_cli::args::{Command, ExportArgs};
use mvfusion_cli::progress::Verbosity;
use mvfusion_cli::{Cli, command, config as configs};
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
        let scene = config.open_scene().expect("the scene is there");
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
        self.export_saying(name, change);
        out
    }

    /// The same; returns what was said.
    fn export_saying(&self, name: &str, change: impl FnOnce(&mut ExportArgs)) -> String {
        self.try_export(name, change).expect("exported")
    }

    /// The same, where it may be refused.
    fn try_export(&self, name: &str, change: impl FnOnce(&mut ExportArgs)) -> anyhow::Result<String> {
        let (run, out) = (self.folder(), self.place.path().join(name));
        let text = |path: &Path| path.to_str().expect("UTF-8").to_owned();
        let line = ["mvfusion", "export", &text(&run), "--out", &text(&out), "--device", backends()[0].name];
        let Command::Export(mut args) = Cli::try_parse_from(line).expect("a command line").command else {
            panic!("another command")
        };
        change(&mut args);
        let mut said = Vec::new();
        command::export(&args, Verbosity::SILENT, &mut said)?;
        Ok(String::from_utf8(said)?)
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

/// Every `width`-th of the values.
fn column(values: &[f64], width: usize, index: usize) -> Vec<f64> {
    values.iter().skip(index).step_by(width).copied().collect()
}

/// Values of a property in some rows.
fn found(ply: &Ply, name: &str, rows: &Range<usize>) -> Vec<f64> {
    ply.column(name)[rows.clone()].iter().map(|&value| f64::from(value)).collect()
}

/// The property of a colour coefficient: channel by channel, coefficient k of 1 .. K stands at channel (K - 1) + k - 1.
fn colour_name(channel: usize, k: usize, coefficients: usize) -> String {
    match k {
        0 => format!("f_dc_{channel}"),
        _ => format!("f_rest_{}", channel * (coefficients - 1) + k - 1),
    }
}

/// Compares every property of some rows of a file, but for the opacity, with Gaussians.
fn assert_holds(ply: &Ply, rows: Range<usize>, gaussians: &RawGaussians) {
    assert_shapes(ply, &rows, gaussians);
    let [_, coefficients, _] = gaussians.sh.dims();
    let sh = numbers(gaussians.sh.clone());
    for (channel, k) in (0..3).flat_map(|channel| (0..coefficients).map(move |k| (channel, k))) {
        let name = colour_name(channel, k, coefficients);
        assert_eq!(found(ply, &name, &rows), column(&sh, 3 * coefficients, 3 * k + channel), "{name}");
    }
}

/// Compares places, sizes and rotations.
fn assert_shapes(ply: &Ply, rows: &Range<usize>, gaussians: &RawGaussians) {
    let check = |name: String, wanted: Vec<f64>| assert_eq!(found(ply, &name, rows), wanted, "{name}");
    let count = gaussians.means.dims()[0];
    assert_eq!(count, rows.len());
    let (means, scales) = (numbers(gaussians.means.clone()), numbers(gaussians.log_scales.clone()));
    let rotations = numbers(gaussians.quaternions.clone());
    for (index, axis) in ["x", "y", "z"].into_iter().enumerate() {
        check(axis.to_owned(), column(&means, 3, index));
        check(format!("n{axis}"), vec![0.0; count]);
        check(format!("scale_{index}"), column(&scales, 3, index));
    }
    for index in 0..4 {
        check(format!("rot_{index}"), column(&rotations, 4, index));
    }
}

fn assert_opacities(ply: &Ply, rows: Range<usize>, gaussians: &RawGaussians) {
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
        assert_without_masks(&frame, border..frame.rows.len(), &dynamic);
    }
}

#[test]
fn a_sequence_may_share_its_static_gaussians_and_says_its_size_first() {
    let run = Run::new(config());
    let said = run.export_saying("shared", |args| {
        args.frames = std::num::NonZeroUsize::new(2);
        args.shared_static = true;
        args.format = Vec::new();
    });
    let out = run.place.path().join("shared");
    assert_eq!(names(&out), ["cameras.json", "frames", "static.ply"]);
    let static_ = parse(&out.join("static.ply"));
    assert_holds(&static_, 0..static_.rows.len(), &run.static_());
    let frame = parse(&out.join("frames/frame0001.ply"));
    assert_without_masks(&frame, 0..frame.rows.len(), &run.moved(&run.model(), 0.0));
    let bytes = fs::metadata(out.join("frames/frame0002.ply")).expect("there").len();
    let kilobytes = |bytes: u64| format!("{:.1} kB", bytes as f64 / 1000.0);
    let words = format!("frames          2 files of {}, {} in all", kilobytes(bytes), kilobytes(2 * bytes));
    assert!(said.contains(&words) && said.contains(" dB against `mvfusion render`"), "{said}");
}

/// Rows whose masks are folded into opacities and colours: alone and opaque, a Gaussian hides as much of the static
/// branch as the blend of the branches does, and adds as much of its own colour.
fn assert_without_masks(ply: &Ply, rows: Range<usize>, gaussians: &RawGaussians) {
    assert_shapes(ply, &rows, gaussians);
    let sigmoid = |logit: f64| 1.0 / (1.0 + (-logit).exp());
    let logits = numbers(gaussians.opacity_logits.clone());
    let masks = numbers(gaussians.mask_logits.clone().expect("masks"));
    let mask = |index: usize, channel: MaskChannel| sigmoid(masks[3 * index + channel as usize]);
    let share = |index: usize| {
        let [static_, dynamic] = [MaskChannel::Static, MaskChannel::Dynamic].map(|channel| mask(index, channel));
        dynamic / (dynamic + static_)
    };
    let hidden = |index: usize| {
        let control = mask(index, MaskChannel::Brightness);
        let brightness = 0.5 + control + 36.0 * (control - 0.75).max(0.0);
        1.0 - (1.0 - share(index)) * brightness.min(1.0)
    };
    let opacities = found(ply, "opacity", &rows);
    for (index, (&found, &own)) in opacities.iter().zip(&logits).enumerate() {
        let wanted = sigmoid(own) * hidden(index);
        assert!((sigmoid(found) - wanted).abs() < 3e-6, "Gaussian {index}: {found}, not {wanted}");
    }
    assert!(opacities.iter().zip(&logits).any(|(found, own)| found < own));
    let [_, coefficients, _] = gaussians.sh.dims();
    let sh = numbers(gaussians.sh.clone());
    for (channel, k) in (0..3).flat_map(|channel| (0..coefficients).map(move |k| (channel, k))) {
        let name = colour_name(channel, k, coefficients);
        let offset = if k == 0 { 0.5 / 0.282_094_791_773_878_14 } else { 0.0 };
        let own = column(&sh, 3 * coefficients, 3 * k + channel);
        for (index, (found, own)) in found(ply, &name, &rows).into_iter().zip(own).enumerate() {
            let wanted = (own + offset) * share(index) / hidden(index) - offset;
            assert!((found - wanted).abs() < 2e-5, "{name} of {index}: {found}, not {wanted}");
        }
    }
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
