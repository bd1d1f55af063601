//! Built-in scenes: a furnished room, rendered by ray casting, with full ground truth.
//!
//! They need no files, and equal options give equal scenes. The ground truth consists of the background without moving
//! objects, masks of moving pixels, masks of the movers, depths and trajectories. [`BuiltinKind::Video`] is a small
//! multi-camera video, [`BuiltinKind::Motion`] one that is harder to follow, and [`BuiltinKind::Casual`] a set of photos
//! with passers-by.

mod choreography;
mod motion_scene;
mod movers;
mod options;
mod rig;
mod shot;
mod solid;
mod sparse_points;
mod stage;
#[cfg(test)]
mod tests;
mod texture;

use std::sync::Arc;

use image::{DynamicImage, GrayImage, RgbImage};
use rayon::prelude::*;

pub use choreography::MovingObject;
pub use options::{BuiltinKind, BuiltinOptions};
pub use solid::Pose;

use crate::scene::{Camera, Capture, Picture, Scene, Truth, View};
use movers::Movers;
use shot::{Backdrop, Shot};
use solid::Solid;

/// Creates a built-in scene. Options below their minimum are raised to it.
pub fn builtin(options: &BuiltinOptions) -> Scene {
    let options = options.at_least();
    let still = stage::still_solids(options.pattern_seed());
    match options.kind {
        BuiltinKind::Video | BuiltinKind::Motion => video(&options, &still),
        BuiltinKind::Casual => casual(&options, &still),
    }
}

/// The objects that are present and move at a time in `[0, 1]`, with their poses.
///
/// For the casual scene, these are the distractors of the training photo with the nearest time.
pub fn moving_objects(options: &BuiltinOptions, time: f64) -> Vec<MovingObject> {
    let options = options.at_least();
    match options.kind {
        BuiltinKind::Video => choreography::in_video(time),
        BuiltinKind::Motion => motion_scene::in_motion(time),
        BuiltinKind::Casual => {
            let last = (options.photos - 1) as f64;
            let index = (time * last).round().clamp(0.0, last) as usize;
            choreography::in_photo(index, options.photos, options.seed)
        }
    }
}

fn video(options: &BuiltinOptions, still: &[Solid]) -> Scene {
    let cameras = rig::video_cameras(options.width, options.height);
    let times: Vec<f64> = (0..options.frames).map(|index| index as f64 / options.frames as f64).collect();
    let movers = Movers::of(times.iter().map(|&time| moving_objects(options, time)));
    let filmed: Vec<Vec<View>> = cameras
        .par_iter()
        .enumerate()
        .map(|(number, &camera)| {
            let backdrop = Backdrop::new(camera, still);
            let background = in_memory(backdrop.image());
            let frame = |(index, &time): (usize, &f64)| {
                let shot = backdrop.shot(&solids_at(options, time, &movers));
                view(format!("cam{number:02}/{index:04}"), camera, time, shot, background.clone())
            };
            times.par_iter().enumerate().map(frame).collect()
        })
        .collect();
    let mut filmed = filmed.into_iter();
    Scene {
        name: if options.kind == BuiltinKind::Motion { "built-in motion" } else { "built-in video" }.into(),
        capture: Capture::Video,
        test: filmed.next().unwrap_or_default(),
        train: filmed.flatten().collect(),
        points: sparse_points::sample(&cameras[1..], still, options.seed),
        near: None,
    }
}

fn casual(options: &BuiltinOptions, still: &[Solid]) -> Scene {
    let cameras = rig::photo_cameras(options.width, options.height, options.photos, options.seed);
    let time_of = |index: usize| index as f64 / (options.photos - 1) as f64;
    let movers = Movers::of((0..options.photos).map(|index| moving_objects(options, time_of(index))));
    let photo = |(index, &camera): (usize, &Camera)| {
        let backdrop = Backdrop::new(camera, still);
        let time = time_of(index);
        let shot = backdrop.shot(&solids_at(options, time, &movers));
        view(format!("clutter{index:03}"), camera, time, shot, in_memory(backdrop.image()))
    };
    let empty = |index: usize| {
        let time = (index as f64 + 0.5) / options.test_photos as f64;
        let camera = rig::held_out_camera(options.width, options.height, time);
        let shot = Backdrop::new(camera, still).shot(&[]);
        let background = in_memory(shot.image.clone());
        let mut view = view(format!("extra{index:03}"), camera, time, shot, background);
        view.truth = Truth { dynamic_mask: None, is_mask_exact: false, movers_mask: None, ..view.truth };
        view
    };
    Scene {
        name: "built-in casual".into(),
        capture: Capture::Photos,
        near: None,
        train: cameras.par_iter().enumerate().map(photo).collect(),
        test: (0..options.test_photos).into_par_iter().map(empty).collect(),
        points: sparse_points::sample(&cameras, still, options.seed),
    }
}

fn solids_at(options: &BuiltinOptions, time: f64, movers: &Movers) -> Vec<Solid> {
    moving_objects(options, time).into_iter().flat_map(|object| movers.marked(object).solids).collect()
}

fn view(name: String, camera: Camera, time: f64, shot: Shot, background: Picture) -> View {
    let truth = Truth {
        background: Some(background),
        dynamic_mask: Some(in_memory(as_rgb(shot.mask))),
        is_mask_exact: true,
        movers_mask: Some(in_memory(as_rgb(shot.movers))),
        depth: Some(Arc::new(shot.depth)),
    };
    View { name, camera, time, image: in_memory(shot.image), mask: None, truth }
}

fn in_memory(image: RgbImage) -> Picture {
    Picture::Memory(Arc::new(image))
}

fn as_rgb(mask: GrayImage) -> RgbImage {
    DynamicImage::from(mask).into_rgb8()
}
