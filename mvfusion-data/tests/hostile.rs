//! Damaged files: scenes of every layout with one damaged file, and damaged files of Gaussians.
//!
//! Whatever the bytes are, a reader returns a scene or an error. It does not panic, hang, or take more memory than the
//! files warrant. Training can compute with any scene that it returns.
//!
//! Each file of [`targets`] is damaged `PROPTEST_CASES` times, by default [`CASES`]. proptest draws the damage and
//! shrinks what it finds.

mod damage;
mod small;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use mvfusion_data::{DataError, GaussianCloud, Layout, ReadOptions, Scene, View, open, read_gaussians, rest_width};
use peak_alloc::PeakAlloc;
use proptest::collection::vec;
use proptest::test_runner::{Config, TestCaseError, TestRunner};

use damage::{Damage, any_damage};
use small::write_small;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Default number of cases of each file.
const CASES: u32 = 800;

/// Number of Gaussians in a file. Their rows take more memory than [`FIXED`].
const GAUSSIANS: usize = 600;

/// Most changes to a file.
const MOST_CHANGES: usize = 4;

/// Memory that reading may hold at once, in bytes of the scene's files.
const MOST_TIMES: usize = 10;

/// Memory that reading holds for any file, in bytes: buffers, messages, tables of decoders.
const FIXED: usize = 1 << 20;

/// Time after which a reader counts as hanging. Reading a scene of this size takes milliseconds.
const PATIENCE: Duration = Duration::from_secs(60);

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

/// The files that are damaged, by layout.
fn targets() -> Vec<(Layout, &'static [&'static str])> {
    vec![
        (Layout::Neu3d, &["poses_bounds.npy", "points3D.ply", "cam00/images/0000.png"]),
        (Layout::Panoptic, &["train_meta.json", "test_meta.json", "init_pt_cld.npz"]),
        (Layout::Nerfstudio, &["transforms.json"]),
        (Layout::MultipleView, &["sparse_/images.bin", "points3D_multipleview.ply"]),
        (Layout::DNerf, &["transforms_train.json", "transforms_test.json"]),
        (Layout::HyperNerf, &["dataset.json", "metadata.json", "scene.json", "camera/000000.json", "points.npy"]),
        (Layout::Colmap, &["sparse/0/cameras.bin", "sparse/0/images.bin", "sparse/0/points3D.bin"]),
        (Layout::OnTheGo, &["transforms.json", "split.json"]),
        (Layout::OnTheGoColmap, &["train_list.txt", "test_list.txt"]),
        (Layout::RobustNerf, &["0/sparse/0/cameras.txt", "0/sparse/0/images.txt", "0/sparse/0/points3D.txt"]),
    ]
}

/// A small sound scene of a layout.
fn written(layout: Layout, folder: &Path) {
    write_small(layout, folder);
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
        _ => {}
    }
    open(folder, &ReadOptions::default()).unwrap_or_else(|error| panic!("{}: {error}", layout.key()));
}

/// Reads a file. The inner error is a fault of its content that the reader should have refused.
type Reading<'a> = dyn Fn() -> Result<Result<(), String>, DataError> + 'a;

/// Bytes of all files below a folder.
fn bytes_below(folder: &Path) -> usize {
    let entries = fs::read_dir(folder).expect("listed").map(|entry| entry.expect("listed").path());
    let size = |path: PathBuf| match path.is_dir() {
        true => bytes_below(&path),
        false => fs::metadata(&path).expect("there").len() as usize,
    };
    entries.map(size).sum()
}

/// Reads with the damaged file in the folder. proptest catches panics.
fn read(folder: &Path, file: &Path, content: &[u8], reading: &Reading<'_>) -> Result<(), TestCaseError> {
    fs::write(file, content).expect("written");
    let files = bytes_below(folder);
    let before = ALLOCATOR.current_usage();
    ALLOCATOR.reset_peak_usage();
    let outcome = reading();
    let taken = ALLOCATOR.peak_usage().saturating_sub(before);
    if taken > MOST_TIMES * files + FIXED {
        return Err(TestCaseError::fail(format!("{taken} bytes were taken for files of {files}")));
    }
    match outcome {
        Ok(soundness) => soundness.map_err(TestCaseError::fail),
        // A message repeats names and numbers of the file, never the file itself.
        Err(error) => match error.to_string() {
            message if message.trim().is_empty() || message.len() > 20_000 => {
                Err(TestCaseError::fail(format!("a message of {} bytes", message.len())))
            }
            _ => Ok(()),
        },
    }
}

/// Whether single precision can hold all numbers of a scene, times are in `[0, 1]`, and something trains.
fn sound(scene: &Scene) -> Result<(), String> {
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

/// Whether all lists of a cloud have an entry for each Gaussian, and all numbers and sizes are finite.
fn whole(cloud: &GaussianCloud) -> Result<(), String> {
    let count = cloud.len();
    let lengths = [cloud.sh_dc.len(), cloud.opacity_logits.len(), cloud.log_scales.len(), cloud.quaternions.len()];
    let masks = cloud.mask_logits.as_ref().map_or(count, Vec::len);
    if lengths != [count; 4] || masks != count || cloud.sh_rest.len() != count * rest_width(cloud.sh_degree) {
        return Err(format!("{count} Gaussians with {lengths:?}, {masks}, {}", cloud.sh_rest.len()));
    }
    if let Some(sizes) = cloud.log_scales.iter().find(|sizes| !sizes.iter().all(|size| size.exp().is_finite())) {
        return Err(format!("a Gaussian has the sizes {sizes:?}"));
    }
    let threes = [&cloud.means, &cloud.sh_dc, &cloud.log_scales].into_iter().chain(&cloud.mask_logits);
    let numbers = threes.flat_map(|rows| rows.as_flattened()).chain(&cloud.sh_rest).chain(&cloud.opacity_logits);
    match numbers.chain(cloud.quaternions.as_flattened()).find(|value| !value.is_finite()) {
        Some(value) => Err(format!("a Gaussian holds {value}")),
        None => Ok(()),
    }
}

/// Ends the process after too long a silence, because a hanging test cannot fail.
fn watched(body: impl FnOnce(&mpsc::Sender<String>)) {
    let (alive, watch) = mpsc::channel::<String>();
    let watchdog = std::thread::spawn(move || {
        let mut last = String::new();
        loop {
            match watch.recv_timeout(PATIENCE) {
                Ok(next) => last = next,
                Err(RecvTimeoutError::Disconnected) => return,
                Err(RecvTimeoutError::Timeout) => {
                    eprintln!("reading hangs: {last}");
                    std::process::abort();
                }
            }
        }
    });
    body(&alive);
    drop(alive);
    watchdog.join().expect("the watchdog ends");
}

/// Gaussians as 3DGS writes them, in binary and as text; the second file has masks, which only our program writes.
fn gaussians() -> [Vec<u8>; 2] {
    let header = |format: &str, names: &[String]| {
        let fields: String = names.iter().map(|name| format!("property float {name}\n")).collect();
        format!("ply\nformat {format} 1.0\nelement vertex {GAUSSIANS}\n{fields}end_header\n")
    };
    let names = |before: &[&str], rest: usize, after: &[&str]| -> Vec<String> {
        let own = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<Vec<_>>();
        [own(before), (0..rest).map(|index| format!("f_rest_{index}")).collect(), own(after)].concat()
    };
    let before = ["x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2"];
    let after = ["opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];
    let masks = ["mask_static", "mask_brightness", "mask_dynamic"];
    let value = |place: usize| (place % 97) as f32 / 10.0 - 4.0;

    let standard = names(&before, 45, &after);
    let mut binary = header("binary_little_endian", &standard).into_bytes();
    binary.extend((0..GAUSSIANS * standard.len()).flat_map(|place| value(place).to_le_bytes()));
    let masked = names(&before, 9, &[after.as_slice(), &masks].concat());
    let mut text = header("ascii", &masked);
    for row in 0..GAUSSIANS {
        let words: Vec<String> = (0..masked.len()).map(|column| value(row + column).to_string()).collect();
        text.push_str(&words.join(" "));
        text.push('\n');
    }
    [binary, text.into_bytes()]
}

/// Damages a file `cases` times. The reader must answer each time.
fn damaged(folder: &Path, name: &str, cases: &Config, alive: &mpsc::Sender<String>, reading: &Reading<'_>) {
    let (file, shown) = (folder.join(name), folder.display());
    let sound = fs::read(&file).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    let mut runner = TestRunner::new(cases.clone());
    let outcome = runner.run(&vec(any_damage(), 1..=MOST_CHANGES), |changes: Vec<Damage>| {
        let _ = alive.send(format!("{name} in {shown}: {changes:?}"));
        let mut content = sound.clone();
        changes.iter().for_each(|change| change.apply(&mut content));
        read(folder, &file, &content, reading)
    });
    outcome.unwrap_or_else(|failure| panic!("{name} in {shown}: {failure}"));
    fs::write(&file, &sound).expect("restored");
}

// One test, one thread: memory is counted for the whole process.
#[test]
fn damaged_files_are_answered_whatever_they_hold() {
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(CASES);
    let config = Config { cases, failure_persistence: None, ..Config::default() };
    let place = tempfile::tempdir().expect("folder");
    watched(|alive| {
        for (layout, files) in targets() {
            let folder = place.path().join(layout.key());
            written(layout, &folder);
            for name in files {
                damaged(&folder, name, &config, alive, &|| {
                    open(&folder, &ReadOptions::default()).map(|scene| sound(&scene))
                });
            }
        }
        for (kind, content) in ["binary", "text"].into_iter().zip(gaussians()) {
            let folder = place.path().join(kind);
            let file = folder.join("gaussians.ply");
            fs::create_dir(&folder).expect("made");
            fs::write(&file, content).expect("written");
            assert_eq!(read_gaussians(&file).expect("a sound file").len(), GAUSSIANS);
            damaged(&folder, "gaussians.ply", &config, alive, &|| read_gaussians(&file).map(|cloud| whole(&cloud)));
        }
    });
}
