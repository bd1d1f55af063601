use glam::DVec2;
use image::{GrayImage, Luma};

use super::*;
use crate::builtin::builtin;
use crate::{BuiltinKind, BuiltinOptions, Scene, View};

/// The true mask of what moves in a view.
fn truth(view: &View) -> GrayImage {
    view.truth.dynamic_mask.as_ref().expect("a built-in scene").mask().expect("in memory")
}

fn is_white(mask: &GrayImage, position: DVec2) -> bool {
    mask.get_pixel(position.x as u32, position.y as u32).0[0] == 255
}

/// The pixel position of a seed in a view, if it is in the picture.
fn position(view: &View, point: glam::Vec3) -> Option<DVec2> {
    let camera = &view.camera;
    let position = camera.project(point.as_dvec3())?;
    let inside = position.cmpge(DVec2::ZERO).all()
        && position.cmplt(DVec2::new(camera.width as f64, camera.height as f64)).all();
    inside.then_some(position)
}

/// Share of the seeds that lie in the true mask of every training camera that sees them, at their moment.
fn precision(scene: &Scene, seeds: &MotionSeeds) -> f64 {
    let masks: Vec<GrayImage> = scene.train.iter().map(truth).collect();
    let right = seeds.points.positions.iter().zip(&seeds.times).filter(|&(&point, &time)| {
        let shots = scene.train.iter().zip(&masks).filter(|(view, _)| view.time == time);
        shots.filter_map(|(view, mask)| Some((mask, position(view, point)?))).all(|(mask, at)| is_white(mask, at))
    });
    right.count() as f64 / seeds.times.len() as f64
}

/// Share of the true masks' pixels that have a seed of their moment within so many pixels.
fn recall(scene: &Scene, seeds: &MotionSeeds, radius: i64) -> f64 {
    let (mut found, mut all) = (0usize, 0usize);
    for view in &scene.train {
        let mask = truth(view);
        let mut near = GrayImage::new(mask.width(), mask.height());
        let now = seeds.points.positions.iter().zip(&seeds.times).filter(|&(_, &time)| time == view.time);
        for at in now.filter_map(|(&point, _)| position(view, point)) {
            for (dy, dx) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dy, dx))) {
                let (x, y) = (at.x as i64 + dx, at.y as i64 + dy);
                if (0..mask.width() as i64).contains(&x) && (0..mask.height() as i64).contains(&y) {
                    near.put_pixel(x as u32, y as u32, Luma([255]));
                }
            }
        }
        all += mask.pixels().filter(|pixel| pixel.0[0] == 255).count();
        found += mask.pixels().zip(near.pixels()).filter(|(mask, near)| mask.0[0] == 255 && near.0[0] == 255).count();
    }
    found as f64 / all as f64
}

#[test]
fn seeds_lie_where_something_moves_and_are_the_same_for_any_number_of_threads() {
    let scene = builtin(&BuiltinOptions::default());
    let film = MotionFilm::of(&scene, &MovingPixelsOptions::default()).expect("in memory").expect("still cameras");
    let seeds = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| motion_hull(&scene, &film, &MotionHullOptions::default(), 0))
    };
    let [one, three] = [1, 3].map(seeds);
    assert_eq!(one, three);
    assert_eq!(one.points.len(), MotionHullOptions::default().points);
    assert!(precision(&scene, &one) > 0.9);
    assert!(recall(&scene, &one, 2) > 0.5);
}

#[test]
fn photos_have_no_moving_pixels() {
    let scene = builtin(&BuiltinOptions { photos: 6, ..BuiltinOptions::of_kind(BuiltinKind::Casual) });
    assert_eq!(MovingPixels::of(&scene, &MovingPixelsOptions::default()).expect("in memory"), None);
}
