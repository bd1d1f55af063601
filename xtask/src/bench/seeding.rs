//! Motion-hull seeding: a film of many still cameras, read from JPEG files, with balls that fly through a patterned
//! room.

use std::fmt::{self, Display};
use std::path::Path;
use std::str::FromStr;
use std::time::Instant;

use anyhow::{Context, Error, Result};
use clap::Args;
use glam::{DMat3, DVec3};
use image::{Rgb, RgbImage};
use mvfusion_cli::memory;
use mvfusion_data::motion::{MotionFilm, MotionHullOptions, MovingPixelsOptions, motion_hull};
use mvfusion_data::{Camera, Capture, Picture, PointCloud, Scene, Truth, View};
use rayon::prelude::*;

use super::{Row, Seconds};

/// Balls that fly, and their radius in the room's units.
const BALLS: usize = 6;
const RADIUS: f64 = 0.25;
/// Distance of the cameras from the middle of the room.
const DISTANCE: f64 = 4.0;

/// What to measure.
#[derive(Debug, Args)]
pub struct SeedingArguments {
    /// The film, as CAMERASxFRAMES@WIDTHxHEIGHT.
    #[arg(long, default_value = "31x150@640x360")]
    film: FilmSize,
}

/// How large a film is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FilmSize {
    cameras: usize,
    frames: usize,
    width: usize,
    height: usize,
}

impl FromStr for FilmSize {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let pair = |text: &str| {
            let (first, second) = text.split_once('x')?;
            Some((first.parse().ok()?, second.parse().ok()?))
        };
        let read = || {
            let (film, size) = text.split_once('@')?;
            let ((cameras, frames), (width, height)) = (pair(film)?, pair(size)?);
            Some(Self { cameras, frames, width, height })
        };
        read().with_context(|| format!("`{text}` is no film; write CAMERASxFRAMES@WIDTHxHEIGHT, as 31x150@640x360"))
    }
}

impl Display for FilmSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} cameras x {} frames of {}x{}", self.cameras, self.frames, self.width, self.height)
    }
}

/// Measures the reading of the film and the hull, once: each picture is decoded, as in the first minute of a training.
pub fn measure(arguments: &SeedingArguments, note: &mut impl FnMut(Row)) -> Result<()> {
    let folder = tempfile::tempdir().context("cannot make a folder for the film")?;
    let scene = film(&arguments.film, folder.path())?;
    forget_peak();
    let mut row = |part: String, seconds: f64| {
        note(Row {
            scene: format!("{part}, {}", arguments.film),
            device: "the CPU".into(),
            threads: rayon::current_num_threads(),
            seconds: Seconds::Whole(seconds),
            pairs: None,
            peak_bytes: memory::peak(),
        });
    };
    let started = Instant::now();
    let film =
        MotionFilm::of(&scene, &MovingPixelsOptions::default())?.context("the film has too few cameras or frames")?;
    row(format!("moving pixels (reduced {} times)", film.factor()), started.elapsed().as_secs_f64());
    let started = Instant::now();
    let seeds = motion_hull(&scene, &film, &MotionHullOptions::default(), 0);
    let seconds = started.elapsed().as_secs_f64();
    row(format!("motion hull ({})", seeds.summary), seconds);
    Ok(())
}

/// Starts a new measurement of the largest memory. Where the system does not let it, that of the film's making counts
/// too.
fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// Writes the film and makes a scene of it.
fn film(size: &FilmSize, folder: &Path) -> Result<Scene> {
    let views = (0..size.cameras).into_par_iter().map(|number| shots(size, number, folder));
    let train = views.collect::<Result<Vec<_>>>()?.into_iter().flatten().collect();
    let name = "flying balls".into();
    Ok(Scene { name, capture: Capture::Video, train, test: Vec::new(), points: PointCloud::default(), near: None })
}

/// What one camera films.
fn shots(size: &FilmSize, number: usize, folder: &Path) -> Result<Vec<View>> {
    let camera = camera(size, number);
    let still = room(size, number);
    let shot = |frame: usize| {
        let time = frame as f64 / size.frames as f64;
        let mut picture = still.clone();
        (0..BALLS).for_each(|ball| draw(&mut picture, &camera, ball, time));
        let name = format!("cam{number:02}-{frame:04}");
        let path = folder.join(format!("{name}.jpg"));
        picture.save(&path).with_context(|| format!("cannot write {}", path.display()))?;
        let image = Picture::file(path, picture.dimensions());
        Ok(View { name, camera, time, image, mask: None, truth: Truth::default() })
    };
    (0..size.frames).map(shot).collect()
}

/// A camera on two rows of an arc, looking at the middle of the room.
fn camera(size: &FilmSize, number: usize) -> Camera {
    let angle = 1.5 * (number as f64 / size.cameras as f64 - 0.5);
    let height = if number.is_multiple_of(2) { 0.3 } else { 1.0 };
    let centre = DISTANCE * DVec3::new(angle.sin(), 0.0, -angle.cos()) - height * DVec3::Y;
    let forward = -centre / centre.length();
    let right = DVec3::Y.cross(forward) / DVec3::Y.cross(forward).length();
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    Camera::centred(size.width, size.height, 0.8 * size.width as f64, axes, centre)
}

/// What a camera sees without balls: a pattern of its own, which a hull does not look at.
fn room(size: &FilmSize, number: usize) -> RgbImage {
    RgbImage::from_fn(size.width as u32, size.height as u32, |x, y| {
        let wave = |period: f64, phase: f64| 30.0 * ((f64::from(x) + 2.0 * f64::from(y)) / period + phase).sin();
        Rgb([0.0, 1.0, 2.0].map(|channel| (110.0 + wave(9.0 + 4.0 * channel, number as f64)) as u8))
    })
}

/// Draws a ball where it is at a time: a disc, which is nearly what a sphere looks like.
fn draw(picture: &mut RgbImage, camera: &Camera, ball: usize, time: f64) {
    let phase = std::f64::consts::TAU * (time + ball as f64 / BALLS as f64);
    let middle = DVec3::new(1.2 * phase.cos(), 0.4 * (3.0 * phase).sin(), 1.2 * phase.sin());
    let Some(at) = camera.project(middle) else { return };
    let radius = camera.fx * RADIUS / camera.to_camera(middle).z;
    let colour = Rgb([220, 40 * ball as u8, 30]);
    let range = |middle: f64, side: usize| {
        let clamp = |edge: f64| edge.clamp(0.0, side as f64) as u32;
        clamp(middle - radius)..clamp(middle + radius + 1.0)
    };
    for y in range(at.y, camera.height) {
        for x in range(at.x, camera.width) {
            if (f64::from(x) + 0.5 - at.x).hypot(f64::from(y) + 0.5 - at.y) <= radius {
                picture.put_pixel(x, y, colour);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_film_is_read_and_nonsense_refused() {
        let film = FilmSize { cameras: 31, frames: 150, width: 640, height: 360 };
        assert_eq!("31x150@640x360".parse::<FilmSize>().expect("a film"), film);
        for text in ["", "31x150", "31@640x360", "31x150@640"] {
            assert!(text.parse::<FilmSize>().is_err(), "{text}");
        }
    }
}
