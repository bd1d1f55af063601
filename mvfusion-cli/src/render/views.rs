//! The cameras and times of a rendering.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::bail;
use mvfusion_data::camera_path::{find_view, orbit, read_camera_path, running_times, spiral};
use mvfusion_data::{Camera, Capture, Scene, View};
use mvfusion_model::timeline::spread;

use crate::failure::UsageError;

/// Default number of frames of a path.
const PATH_FRAMES: usize = 120;
/// Default maximum number of frames of a still camera.
const MOST_MOMENTS: usize = 300;
/// Default frame rate.
const FPS: f64 = 30.0;
/// Smallest side of an image in pixels.
pub const LEAST_SIDE: usize = 16;

/// A kind of views.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Views {
    /// The training views.
    Train,
    /// The held-out views.
    Test,
    /// A spiral around the centre of the training cameras.
    Spiral,
    /// An orbit around the point that they look at.
    Orbit,
    /// One camera.
    Still,
    /// The cameras of a file.
    File(PathBuf),
}

impl FromStr for Views {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Ok(match text {
            "train" => Self::Train,
            "test" => Self::Test,
            "spiral" => Self::Spiral,
            "orbit" => Self::Orbit,
            "still" => Self::Still,
            _ if Path::new(text).extension().is_some_and(|extension| extension.eq_ignore_ascii_case("json")) => {
                Self::File(text.into())
            }
            _ => return Err("expected train, test, spiral, orbit, still, or a camera path FILE.json".to_owned()),
        })
    }
}

/// The selected views, and their size.
#[derive(Clone, Debug, Default)]
pub struct Selection {
    /// Number of frames; evenly spaced if there is a list of views.
    pub frames: Option<NonZeroUsize>,
    /// A common time for all of them.
    pub time: Option<f64>,
    /// The still camera.
    pub camera: Option<String>,
    /// The size.
    pub reframing: Reframing,
}

/// The size of the images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Reframing {
    /// That of the camera.
    #[default]
    AsItIs,
    /// Width and height.
    Size(usize, usize),
    /// Width and height divided by a number.
    Downscale(NonZeroUsize),
}

/// A frame to render.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Number of its files.
    pub number: usize,
    /// The camera.
    pub camera: Camera,
    /// The time.
    pub time: f64,
}

/// Frames of one size. There is at least one.
#[derive(Clone, Debug, PartialEq)]
pub struct Film {
    /// The frames.
    pub frames: Vec<Frame>,
    /// Frame rate.
    pub fps: f64,
    /// Whether they are held-out photos, whose times were not trained. A model with two branches then shows only the
    /// static branch.
    pub is_clean: bool,
}

impl Film {
    /// The time of a frame by its index; `None` if only the static branch is shown.
    pub fn moment(&self, index: usize) -> Option<f64> {
        (!self.is_clean).then_some(self.frames[index].time)
    }
}

impl Views {
    /// Name of their folder.
    pub fn name(&self) -> String {
        match self {
            Self::Train => "train".into(),
            Self::Test => "test".into(),
            Self::Spiral => "spiral".into(),
            Self::Orbit => "orbit".into(),
            Self::Still => "still".into(),
            Self::File(path) => path.file_stem().map_or("path".into(), |stem| stem.to_string_lossy().into_owned()),
        }
    }

    /// The frames to render of a scene.
    ///
    /// # Errors
    /// If a file cannot be used, the camera does not exist, or the images would be too small or differ in size.
    pub fn film(&self, scene: &Scene, selection: &Selection) -> anyhow::Result<Film> {
        if selection.camera.is_some() && *self != Self::Still {
            bail!(UsageError::new("--camera works only with --views still; the other views have their own cameras."));
        }
        let path_frames = selection.frames.map_or(PATH_FRAMES, usize::from);
        let is_clean = *self == Self::Test && scene.capture == Capture::Photos && selection.time.is_none();
        let mut film = Film { frames: Vec::new(), fps: FPS, is_clean };
        film.frames = match self {
            Self::Train => listed(&scene.train, selection),
            Self::Test if scene.test.is_empty() => bail!("the scene has no held-out views. Use --views train."),
            Self::Test => listed(&scene.test, selection),
            Self::Spiral => running(scene, spiral(scene, path_frames)),
            Self::Orbit => running(scene, orbit(scene, path_frames)),
            Self::Still => running(scene, still(scene, selection)?),
            Self::File(path) => {
                let (frames, fps) = from_file(path, scene, selection)?;
                film.fps = fps.unwrap_or(FPS);
                frames
            }
        };
        for frame in &mut film.frames {
            frame.camera = selection.reframing.apply(&frame.camera);
            frame.time = selection.time.unwrap_or(frame.time);
        }
        check_sizes(&film.frames)?;
        Ok(film)
    }
}

/// Views of the scene, evenly spaced, with their indices in the scene.
fn listed(views: &[View], selection: &Selection) -> Vec<Frame> {
    let chosen = spread(views.len(), selection.frames.map_or(usize::MAX, usize::from));
    chosen.into_iter().map(|number| Frame { number, camera: views[number].camera, time: views[number].time }).collect()
}

/// A sequence of cameras while time runs through once.
fn running(scene: &Scene, cameras: Vec<Camera>) -> Vec<Frame> {
    let times = running_times(scene, cameras.len());
    let moments = cameras.into_iter().zip(times).enumerate();
    moments.map(|(number, (camera, time))| Frame { number, camera, time }).collect()
}

/// One camera, repeated.
fn still(scene: &Scene, selection: &Selection) -> anyhow::Result<Vec<Camera>> {
    let wanted = selection.camera.as_deref().unwrap_or("0");
    let Some(view) = find_view(scene, wanted) else { bail!(no_such_camera(scene, wanted)) };
    let moments = scene.training_times().len().min(MOST_MOMENTS);
    Ok(vec![view.camera; selection.frames.map_or(moments, usize::from)])
}

/// The error for a camera that the scene does not have, with those that it has.
fn no_such_camera(scene: &Scene, wanted: &str) -> UsageError {
    let views = || scene.test.iter().chain(&scene.train);
    let cameras: BTreeSet<&str> = views().filter_map(|view| Some(view.name.rsplit_once('/')?.0)).collect();
    let (first, last) = (&scene.train[0].name, &scene.train[scene.train.len() - 1].name);
    let names = if cameras.is_empty() {
        format!("Give the name of a view, such as {first} or {last}")
    } else {
        let cameras = cameras.into_iter().collect::<Vec<_>>().join(", ");
        format!("Its cameras are {cameras}. Give one of them, the name of a view, such as {first}")
    };
    let (count, kind) = match scene.test.len() {
        0 => (scene.train.len(), "training"),
        held_out => (held_out, "held-out"),
    };
    UsageError::new(format!(
        "the scene has no view or camera `{wanted}`. {names}, or the index of one of the {count} {kind} views, from 0."
    ))
}

/// The frames of a camera path, evenly spaced, and its frame rate.
fn from_file(path: &Path, scene: &Scene, selection: &Selection) -> anyhow::Result<(Vec<Frame>, Option<f64>)> {
    if let Ok(false) = path.try_exists() {
        bail!(
            "the camera path {} does not exist. Give --views the path of a JSON file, or train, test, spiral, orbit or \
             still.",
            path.display()
        );
    }
    let read = read_camera_path(path)?;
    let chosen = spread(read.entries.len(), selection.frames.map_or(usize::MAX, usize::from));
    let entries: Vec<_> = chosen.into_iter().map(|index| read.entries[index]).collect();
    let mut frames = running(scene, entries.iter().map(|entry| entry.camera).collect());
    for (frame, entry) in frames.iter_mut().zip(&entries) {
        frame.time = entry.time.unwrap_or(frame.time);
    }
    Ok((frames, read.fps))
}

/// Checks that all frames have one size, as a video needs.
fn check_sizes(frames: &[Frame]) -> anyhow::Result<()> {
    let size = |frame: &Frame| (frame.camera.width, frame.camera.height);
    let Some(first) = frames.first() else { return Ok(()) };
    let (width, height) = size(first);
    if width.min(height) < LEAST_SIDE {
        bail!("the images would have only {width} x {height} pixels. Use a smaller --downscale or a larger --size.");
    }
    match frames.iter().find(|frame| size(frame) != (width, height)) {
        Some(other) => {
            let (w, h) = size(other);
            bail!(
                "frame {} has {width} x {height} pixels, but frame {} has {w} x {h}. Set a common --size.",
                first.number,
                other.number
            )
        }
        None => Ok(()),
    }
}

impl Reframing {
    fn apply(self, camera: &Camera) -> Camera {
        match self {
            Self::AsItIs => *camera,
            Self::Size(width, height) => camera.reframed(width, height),
            Self::Downscale(times) => {
                let smaller = |side: usize| (side as f64 / times.get() as f64).round() as usize;
                camera.resized(smaller(camera.width).max(1), smaller(camera.height).max(1))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use mvfusion_data::{BuiltinKind, BuiltinOptions, builtin};

    use super::*;

    fn scene() -> Scene {
        builtin::builtin(&BuiltinOptions { width: 48, height: 36, ..BuiltinOptions::of_kind(BuiltinKind::Video) })
    }

    fn frames(count: usize) -> Selection {
        Selection { frames: NonZeroUsize::new(count), ..Selection::default() }
    }

    #[test]
    fn views_are_told_by_their_words_and_files_by_their_ending() {
        assert_eq!("orbit".parse(), Ok(Views::Orbit));
        assert_eq!("a/Path.JSON".parse(), Ok(Views::File("a/Path.JSON".into())));
        assert!("circle".parse::<Views>().is_err_and(|error| error.contains("FILE.json")));
        assert_eq!(Views::File("a/fly.json".into()).name(), "fly");
    }

    #[test]
    fn views_of_the_scene_keep_their_numbers_and_times() {
        let scene = scene();
        let film = Views::Test.film(&scene, &frames(3)).expect("frames");
        let last = scene.test.len() - 1;
        assert_eq!(film.frames.iter().map(|frame| frame.number).collect::<Vec<_>>(), [0, last / 2 + last % 2, last]);
        assert!(film.frames.iter().all(|frame| frame.time == scene.test[frame.number].time));
        assert_eq!(Views::Train.film(&scene, &Selection::default()).expect("frames").frames.len(), scene.train.len());
    }

    #[test]
    fn held_out_photos_are_clean_unless_a_time_is_asked_for() {
        let casual =
            BuiltinOptions { width: 16, height: 16, photos: 3, ..BuiltinOptions::of_kind(BuiltinKind::Casual) };
        let photos = builtin::builtin(&casual);
        let stopped = Selection { time: Some(0.3), ..Selection::default() };
        for (views, scene, selection, is_clean) in [
            (Views::Test, &photos, Selection::default(), true),
            (Views::Test, &photos, stopped, false),
            (Views::Train, &photos, Selection::default(), false),
            (Views::Spiral, &photos, frames(2), false),
            (Views::Test, &scene(), Selection::default(), false),
        ] {
            assert_eq!(views.film(scene, &selection).expect("frames").is_clean, is_clean, "{views:?} {selection:?}");
        }
    }

    #[test]
    fn time_runs_on_paths_and_stands_when_told_to() {
        let scene = scene();
        for views in [Views::Spiral, Views::Orbit, Views::Still] {
            let film = views.film(&scene, &frames(5)).expect("frames");
            assert_eq!(film.frames.len(), 5);
            assert!(film.frames.is_sorted_by(|a, b| a.time < b.time), "{views:?}");
            let stopped = Views::film(&views, &scene, &Selection { time: Some(0.3), ..frames(5) }).expect("frames");
            assert!(stopped.frames.iter().all(|frame| frame.time == 0.3));
        }
        let still = Views::Still.film(&scene, &Selection::default()).expect("frames");
        assert_eq!(still.frames.len(), scene.training_times().len());
        assert!(still.frames.iter().all(|frame| frame.camera == scene.test[0].camera));
    }

    #[test]
    fn pictures_become_smaller_or_of_the_size_that_is_asked_for() {
        let scene = scene();
        let size = |reframing| {
            let film = Views::Orbit.film(&scene, &Selection { reframing, ..frames(2) })?;
            anyhow::Ok((film.frames[0].camera.width, film.frames[0].camera.height))
        };
        assert_eq!(size(Reframing::Size(64, 20)).expect("frames"), (64, 20));
        assert_eq!(size(Reframing::Downscale(NonZeroUsize::MIN.saturating_add(1))).expect("frames"), (24, 18));
        let error = size(Reframing::Downscale(NonZeroUsize::MIN.saturating_add(8))).expect_err("refused");
        assert!(error.to_string().contains("--downscale"), "{error}");
    }

    #[test]
    fn a_camera_is_found_or_the_names_are_told() {
        let scene = scene();
        let with = |camera: &str| Selection { camera: Some(camera.into()), ..frames(1) };
        let name = scene.train[0].name.clone();
        assert_eq!(Views::Still.film(&scene, &with(&name)).expect("frames").frames[0].camera, scene.train[0].camera);
        let error = Views::Still.film(&scene, &with("cam77")).expect_err("refused").to_string();
        assert!(error.contains("`cam77`") && error.contains(&name), "{error}");
        assert!(error.contains("Its cameras are cam00, cam01, "), "the held-out camera is among them: {error}");
        assert!(Views::Orbit.film(&scene, &with("0")).expect_err("refused").to_string().contains("--views still"));
    }

    #[test]
    fn a_camera_path_has_its_own_times_and_rate_and_one_size() {
        let folder = tempfile::tempdir().expect("folder");
        let path = folder.path().join("fly.json");
        let entry = |width: usize, more: &str| {
            format!(
                r#"{{"width":{width},"height":48,"position":[0,0,0],"rotation":[[1,0,0],[0,1,0],[0,0,1]],
                    "fx":60,"fy":60{more}}}"#
            )
        };
        let (scene, views) = (scene(), Views::File(path.clone()));
        let error = views.film(&scene, &Selection::default()).expect_err("no file").to_string();
        assert!(error.contains("fly.json does not exist"), "{error}");
        std::fs::write(&path, format!("[{}, {}]", entry(64, ""), entry(64, ",\"time\":0.125"))).expect("written");
        let film = views.film(&scene, &Selection::default()).expect("frames");
        assert_eq!((film.frames[0].time, film.frames[1].time, film.fps), (scene.training_times()[0], 0.125, FPS));
        std::fs::write(&path, format!("[{}, {}]", entry(64, ""), entry(32, ""))).expect("written");
        let error = views.film(&scene, &Selection::default()).expect_err("refused").to_string();
        assert!(error.contains("frame 1 has 32 x 48") && error.contains("--size"), "{error}");
        let one = Selection { reframing: Reframing::Size(40, 30), ..Selection::default() };
        assert_eq!(views.film(&scene, &one).expect("frames").frames.len(), 2);
    }
}
