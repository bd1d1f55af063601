//! `mvfusion render`: its layers, views and files, and what it refuses.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use image::RgbImage;

use super::{FAILED, USAGE, mvfusion, text, train_tiny};

/// What `train` names the run.
const RUN: &str = "runs/quickstart-0";
/// A small picture, for speed; not square, lest width and height be taken for each other.
const SIZE: (u32, u32) = (48, 36);
/// Rounding to 8 bits, and a little for the sum of two layers.
const HALF_A_LEVEL: f32 = 0.5 / 255.0 + 1e-5;

/// All layers, with their channels.
const LAYERS: [(&str, &str); 12] = [
    ("composed", "RGB"),
    ("static", "RGB"),
    ("dynamic", "RGB"),
    ("mask", "Y"),
    ("masked_static", "RGB"),
    ("masked_dynamic", "RGB"),
    ("depth", "Z"),
    ("alpha", "A"),
    ("motion", "Y"),
    ("position_variance", "Y"),
    ("rotation_variance", "Y"),
    ("scale_variance", "Y"),
];

fn render(folder: &Path, arguments: &[&str]) -> Output {
    mvfusion(folder, &[&["render", RUN, "--quiet"], arguments].concat())
}

/// Renders, and returns what stands on stdout.
fn rendered(folder: &Path, arguments: &[&str]) -> String {
    let output = render(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", text(&output.stderr));
    text(&output.stdout)
}

/// A rendering that must fail with this code and these words, and write nothing.
fn refused(folder: &Path, arguments: &[&str], code: i32, words: &[&str]) {
    let output = render(folder, arguments);
    let said = text(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
    assert!(said.starts_with("error: ") && !said.contains("panicked"), "{said}");
    for word in words {
        assert!(said.contains(word), "`{word}` is missing: {said}");
    }
    for views in ["spiral", "fly"] {
        assert!(!folder.join(RUN).join("films").join(views).exists(), "{arguments:?} left something behind");
    }
}

fn trained(more: &[&str]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("folder");
    let output = train_tiny(folder.path(), &[&["--quiet", "--set", "eval.pictures=false"], more].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    folder
}

/// The planes of an EXR picture by their names, by the crate that writes them.
fn planes(path: &Path) -> BTreeMap<String, Vec<f32>> {
    let image = exr::prelude::read_first_flat_layer_from_file(path).expect("an EXR picture");
    assert_eq!(image.layer_data.size, (SIZE.0 as usize, SIZE.1 as usize).into());
    let channels = image.layer_data.channel_data.list;
    channels.iter().map(|channel| (channel.name.to_string(), channel.sample_data.values_as_f32().collect())).collect()
}

/// All files of a folder and its subfolders.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let entries = fs::read_dir(folder).expect("listed").map(|entry| entry.expect("entry").path());
    let within = |path: PathBuf| match path.is_dir() {
        true => files(&path),
        false => BTreeMap::from([(path.clone(), fs::read(&path).expect("read"))]),
    };
    entries.flat_map(within).collect()
}

fn png(path: &Path) -> RgbImage {
    image::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display())).into_rgb8()
}

#[test]
fn a_run_is_rendered_in_every_layer_as_pictures_floats_and_animations() {
    let folder = trained(&[]);
    // MP4 needs ffmpeg, and so has a test among those of other programs' readers (tests/tests/oracles/foreign.rs).
    let format = "png,exr,gif";
    let said = rendered(folder.path(), &["--frames", "3", "--size", "48x36", "--layers", "all", "--format", format]);
    assert!(said.contains("3 at 48x36") && said.contains("masked_static") && said.contains("spiral"), "{said}");
    let views = folder.path().join(RUN).join("films/spiral");

    for (layer, _) in LAYERS {
        for frame in ["00000", "00002"] {
            assert_eq!(png(&views.join(layer).join(format!("{frame}.png"))).dimensions(), SIZE);
        }
        assert_eq!(gif_frames(&views.join(format!("{layer}.gif"))), 3, "{layer}");
    }
    let pictures = planes(&views.join("exr/00001.exr"));
    let names = LAYERS.iter().flat_map(|(layer, channels)| channels.chars().map(move |c| format!("{layer}.{c}")));
    let expected: BTreeSet<String> = names.chain(["R", "G", "B"].map(str::to_owned)).collect();
    assert_eq!(pictures.keys().cloned().collect::<BTreeSet<_>>(), expected);
    floats_are_those_of_the_pictures(&views, &pictures);
    masked_layers_add_up(&pictures);
    motion_is_the_weighted_sum(&pictures);
    let left: Vec<_> = fs::read_dir(&views).expect("listed").map(|entry| entry.expect("entry").file_name()).collect();
    assert!(left.iter().all(|name| !name.to_string_lossy().starts_with('.')), "{left:?}");
}

fn gif_frames(path: &Path) -> usize {
    let file = fs::File::open(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut decoder = gif::DecodeOptions::new().read_info(file).expect("a gif");
    assert_eq!((u32::from(decoder.width()), u32::from(decoder.height())), SIZE);
    std::iter::from_fn(|| decoder.read_next_frame().expect("a frame").map(|_| ())).count()
}

/// Colours, masks and alpha are in the pictures what they are in floats, rounded.
fn floats_are_those_of_the_pictures(views: &Path, planes: &BTreeMap<String, Vec<f32>>) {
    let as_they_are = |(layer, channels): &&(&str, &str)| ["RGB", "A"].contains(channels) || *layer == "mask";
    for (layer, channels) in LAYERS.iter().filter(as_they_are) {
        let picture = png(&views.join(layer).join("00001.png"));
        for (place, channel) in channels.chars().enumerate() {
            let plane = &planes[&format!("{layer}.{channel}")];
            let off = plane
                .iter()
                .zip(picture.pixels())
                .map(|(value, pixel)| (value.clamp(0.0, 1.0) - f32::from(pixel.0[place]) / 255.0).abs());
            let worst = off.fold(0.0, f32::max);
            assert!(worst <= HALF_A_LEVEL, "{layer}.{channel}: {worst}");
        }
    }
    for (plain, named) in [("R", "composed.R"), ("G", "composed.G"), ("B", "composed.B")] {
        assert!(planes[plain] == planes[named], "{plain}");
    }
    assert!(planes["depth.Z"].iter().any(|&depth| depth > 0.2), "something is in front of the camera");
    assert!(planes["alpha.A"].iter().all(|alpha| (0.0..=1.0).contains(alpha)));
    assert!(planes["mask.Y"].iter().all(|share| (0.0..=1.0).contains(share)));
}

fn masked_layers_add_up(planes: &BTreeMap<String, Vec<f32>>) {
    for channel in ["R", "G", "B"] {
        let plane = |layer: &str| &planes[&format!("{layer}.{channel}")];
        let parts = plane("masked_static").iter().zip(plane("masked_dynamic"));
        let off = parts.zip(plane("composed")).map(|((a, b), whole)| (a + b - whole).abs());
        assert!(off.fold(0.0, f32::max) < 1e-6, "{channel}");
        assert!(plane("masked_dynamic").iter().zip(plane("dynamic")).all(|(part, all)| *part <= all + 1e-6));
    }
}

/// The default weights are 0.7, 0.2 and 0.1.
fn motion_is_the_weighted_sum(planes: &BTreeMap<String, Vec<f32>>) {
    let (position, scale) = (&planes["position_variance.Y"], &planes["scale_variance.Y"]);
    let rotation = &planes["rotation_variance.Y"];
    let largest = planes["motion.Y"].iter().copied().fold(0.0, f32::max);
    assert!(largest > 0.0, "nothing moves");
    for (pixel, motion) in planes["motion.Y"].iter().enumerate() {
        let sum = 0.7 * position[pixel] + 0.2 * scale[pixel] + 0.1 * rotation[pixel];
        assert!((sum - motion).abs() < 1e-4 * largest, "{sum} {motion}");
    }
}

#[test]
fn views_times_weights_and_modules_are_as_asked_for() {
    let folder = trained(&["--set", "eval.pictures=true"]);
    let films = folder.path().join(RUN).join("films");
    let small = ["--size", "48x36", "--layers", "composed,motion", "--format", "exr"];
    let picture = |views: &str, frame: usize| planes(&films.join(views).join(format!("exr/{frame:05}.exr")));

    rendered(folder.path(), &[&["--views", "still", "--frames", "2"][..], &small].concat());
    let (first, last) = (picture("still", 0), picture("still", 1));
    // Not by `assert_eq!`, which would print thousands of numbers.
    assert!(first["composed.R"] != last["composed.R"], "the time stands");
    let stopped = ["--views", "still", "--frames", "2", "--time", "0", "--force"];
    rendered(folder.path(), &[&stopped[..], &small].concat());
    let whole = picture("still", 1);
    assert!(whole["composed.R"] == first["composed.R"], "the time runs");

    rendered(folder.path(), &[&stopped[..], &["--no-mfta"], &small].concat());
    assert!(picture("still", 1)["composed.R"] != whole["composed.R"], "the attention has no effect");
    rendered(folder.path(), &[&stopped[..], &["--motion-weights", "0,1,0"], &small].concat());
    let weighted = picture("still", 1);
    assert!(weighted["composed.R"] == whole["composed.R"] && weighted["motion.Y"] != whole["motion.Y"]);

    // The held-out views were rendered by the evaluation already, whose pictures stay as they are.
    let evaluated = folder.path().join(RUN).join("renders/test");
    let before = files(&evaluated);
    assert!(before.keys().any(|path| path.ends_with("composed/00001.png")), "the training writes pictures");
    let test = ["--views", "test", "--frames", "2", "--layers", "composed", "--format", "png"];
    rendered(folder.path(), &test);
    rendered(folder.path(), &[&test[..], &["--force"]].concat());
    assert!(files(&evaluated) == before, "the evaluation's pictures are others");

    // What each branch adds is the evaluation's as well.
    let masked = ["--views", "test", "--frames", "1", "--layers", "masked_static,masked_dynamic", "--format", "png"];
    rendered(folder.path(), &[&masked[..], &["--out", "masked"]].concat());
    for layer in ["masked_static", "masked_dynamic"] {
        let name = format!("{layer}/00000.png");
        let [shown, scored] = [folder.path().join("masked"), evaluated.clone()].map(|place| png(&place.join(&name)));
        let pairs = shown.as_raw().iter().zip(scored.as_raw());
        // Rounding may tip a level over.
        assert!(pairs.map(|(a, b)| a.abs_diff(*b)).max() <= Some(1), "{layer}");
        assert_eq!(shown.dimensions(), scored.dimensions());
    }
    let scored = |layer: &str| png(&evaluated.join(layer).join("00000.png"));
    assert!(scored("masked_static") != scored("masked_dynamic"), "both branches add the same");

    // A view of the scene, and its camera standing still at its moment: the pictures are the same.
    let held_out = png(&films.join("test/composed/00000.png"));
    let all = fs::read_dir(films.join("test/composed")).expect("listed").count();
    assert_eq!((held_out.dimensions(), all), ((160, 120), 2));
    let still = ["--views", "still", "--camera", "0", "--time", "0", "--frames", "1", "--out", "elsewhere"];
    rendered(folder.path(), &[&still[..], &["--layers", "composed"]].concat());
    assert_eq!(png(&folder.path().join("elsewhere/composed/00000.png")), held_out);
    assert!(!folder.path().join("elsewhere/composed.gif").exists(), "a single frame is no animation");
}

#[test]
fn what_cannot_be_rendered_is_refused_before_anything_is_written() {
    let folder = trained(&[]);
    let path = folder.path();
    let parse = |arguments: &[&str], words: &[&str]| {
        let output = render(path, arguments);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(USAGE), "{said}");
        assert!(words.iter().all(|word| said.contains(word)), "{said}");
    };
    parse(&["--layers", "gt"], &["gt", "masked_static"]);
    parse(&["--views", "circle"], &["circle", "FILE.json"]);
    parse(&["--motion-weights", "1,2"], &["0.7,0.2,0.1"]);
    parse(&["--time", "2"], &["from 0 to 1"]);
    parse(&["--size", "20000x100"], &["--size", "16 to 16384 pixels"]);
    parse(&["--frames", "108001"], &["--frames", "from 1 to 108000"]);
    parse(&["--fps", "1e300"], &["--fps", "between 0.1 and 240"]);
    refused(path, &["--views", "still", "--camera", "cam99"], USAGE, &["cam99", "cam00", "cam01/"]);
    refused(path, &["--views", "fly.json"], FAILED, &["fly.json does not exist"]);
    fs::write(path.join("fly.json"), "[{\"position\": [0, 0").expect("written");
    refused(path, &["--views", "fly.json"], FAILED, &["fly.json", "line 1"]);
    fs::write(path.join("fly.json"), "[{\"position\": [0, 0, 0]}]").expect("written");
    refused(path, &["--views", "fly.json"], FAILED, &["fly.json", "camera 0", "rotation"]);
    refused(path, &["--downscale", "100"], FAILED, &["--downscale"]);

    let one = ["--views", "still", "--frames", "1", "--layers", "mask"];
    rendered(path, &one);
    let file = path.join(RUN).join("films/still/mask/00000.png");
    let before = fs::read(&file).expect("read");
    let output = render(path, &one);
    assert_eq!(output.status.code(), Some(FAILED));
    assert!(text(&output.stderr).contains("--force"), "{}", text(&output.stderr));
    assert_eq!(fs::read(&file).expect("still there"), before);
    rendered(path, &[&one[..], &["--force"]].concat());
}

#[test]
fn a_model_of_one_branch_has_no_mask_and_one_that_stands_still_no_motion() {
    let one_branch = [
        "model.branches=dynamic",
        "model.grid.bounds=cloud",
        "init.motion_points=0",
        "init.photo_points=0",
        "densify.births_interval=0",
    ];
    let folder = trained(&one_branch.map(|setting| ["--set", setting]).concat());
    for layer in ["static", "mask", "masked_static", "masked-dynamic"] {
        refused(folder.path(), &["--layers", layer], USAGE, &[&layer.replace('-', "_"), "no static branch"]);
    }
    let said = rendered(folder.path(), &["--frames", "2", "--size", "48x36", "--format", "png"]);
    assert!(said.contains("composed, depth, motion"), "{said}");

    let folder = trained(&["--set", "model.deformation=false"]);
    refused(folder.path(), &["--layers", "composed,motion"], USAGE, &["motion", "nothing moves"]);
}
