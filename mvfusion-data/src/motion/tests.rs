//! Moving pixels and the motion hull of built-in scenes.

use std::sync::Arc;

use glam::DVec2;
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::*;
use crate::builtin::{BuiltinKind, BuiltinOptions, builtin};
use crate::scene::{Mask, Picture, Scene, View};

/// The ground-truth motion mask of a view.
fn truth(view: &View) -> GrayImage {
    view.truth.dynamic_mask.as_ref().expect("a built-in scene").mask().expect("in memory")
}

fn is_white(mask: &GrayImage, position: DVec2) -> bool {
    mask.get_pixel(position.x as u32, position.y as u32).0[0] == 255
}

/// The pixel position of a seed in a view, if it is in the image.
fn position(view: &View, point: glam::Vec3) -> Option<DVec2> {
    let camera = &view.camera;
    let position = camera.project(point.as_dvec3())?;
    let inside = position.cmpge(DVec2::ZERO).all()
        && position.cmplt(DVec2::new(camera.width as f64, camera.height as f64)).all();
    inside.then_some(position)
}

/// Fraction of the seeds that are in the ground-truth mask of every training camera that sees them, at their moment.
fn precision(scene: &Scene, seeds: &MotionSeeds) -> f64 {
    let masks: Vec<GrayImage> = scene.train.iter().map(truth).collect();
    let right = seeds.points.positions.iter().zip(&seeds.times).filter(|&(&point, &time)| {
        let shots = scene.train.iter().zip(&masks).filter(|(view, _)| view.time == time);
        shots.filter_map(|(view, mask)| Some((mask, position(view, point)?))).all(|(mask, at)| is_white(mask, at))
    });
    right.count() as f64 / seeds.times.len() as f64
}

/// Fraction of the ground-truth masks' pixels with a seed of their moment within this many pixels.
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

fn film(scene: &Scene, options: &MovingPixelsOptions) -> MotionFilm {
    MotionFilm::of(scene, options).expect("in memory").expect("cameras stand still")
}

#[test]
fn seeds_lie_where_something_moves_and_are_the_same_for_any_number_of_threads() {
    let scene = builtin(&BuiltinOptions::default());
    let film = film(&scene, &MovingPixelsOptions::default());
    let seeds = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| motion_hull(&scene, &film, &MotionHullOptions::default(), 0))
    };
    let [one, three] = [1, 3].map(seeds);
    assert_eq!(one, three);
    let summary = one.summary;
    assert_eq!((summary.cameras, summary.moments, summary.seeded_moments, summary.reduction), (7, 24, 24, 1));
    assert_eq!((one.points.len(), one.times.len()), (summary.seeds, summary.seeds));
    assert_eq!(summary.seeds, MotionHullOptions::default().points);
    let (precision, recall) = (precision(&scene, &one), recall(&scene, &one, 2));
    eprintln!("precision {precision:.3}, recall {recall:.3}; {summary}");

    assert!(precision > 0.94, "{precision}");
    // The rest is the inside of the lamp, which changes by two levels.
    assert!(recall > 0.53, "{recall}");
}

#[test]
fn the_place_behind_a_moving_pixel_is_as_far_away_as_what_it_shows() {
    let scene = builtin(&BuiltinOptions::default());
    let finder = MotionFinder::new(&scene, film(&scene, &MovingPixelsOptions::default()), MotionHullOptions::default());
    let (mut found, mut right, mut asked) = (0, 0, 0);
    for number in (0..scene.train.len()).step_by(5) {
        let view = &scene.train[number];
        let mask = view.truth.movers_mask.as_ref().expect("a built-in scene").mask().expect("in memory");
        let depth = view.truth.depth.as_ref().expect("a built-in scene");
        let pixels: Vec<(u32, u32)> = mask
            .enumerate_pixels()
            .filter(|(x, y, pixel)| pixel.0[0] == 255 && (x + y) % 5 == 0)
            .map(|(x, y, _)| (x, y))
            .collect();
        let positions: Vec<DVec2> =
            pixels.iter().map(|&(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).collect();
        asked += positions.len();
        for (&(x, y), place) in pixels.iter().zip(finder.locate(number, &positions, 1)) {
            let Some(place) = place else { continue };
            let truth = f64::from(depth[y as usize * view.camera.width + x as usize]);
            found += 1;
            right += usize::from((view.camera.to_camera(place).z / truth - 1.0).abs() < 0.1);
        }
    }
    eprintln!("{found} of {asked} found, {right} right");
    assert!(found > asked / 2 && right as f64 > 0.9 * found as f64, "{found} of {asked} found, {right} right");
    let nowhere = [DVec2::splat(-1.0)];
    assert_eq!((finder.locate(0, &nowhere, 1), finder.locate(usize::MAX, &nowhere, 1)), (vec![None], vec![None]));
}

#[test]
fn reduced_pictures_are_asked_at_full_size() {
    let scene = builtin(&BuiltinOptions { frames: 6, ..BuiltinOptions::default() });
    let views = scene.train.len() as u64;
    // A third of the sides, rounded up, and not a byte more.
    let options = MovingPixelsOptions { memory: 4 * 54 * 40 * views, ..MovingPixelsOptions::default() };
    let reduced = film(&scene, &options);
    let whole = MovingPixels::of(&scene, &MovingPixelsOptions::default()).expect("in memory").expect("still");
    assert_eq!((reduced.factor(), reduced.bytes()), (3, options.memory));
    let (small, full) = (reduced.moving().mask(2).expect("known"), whole.mask(2).expect("known"));
    assert_eq!(small.dimensions(), (160, 120));
    let unlike = small.pixels().zip(full.pixels()).filter(|(a, b)| a != b).count();
    assert!((unlike as f64) < 0.04 * 160.0 * 120.0, "{unlike}");
    for (x, y, pixel) in small.enumerate_pixels() {
        let position = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        assert_eq!(reduced.moving().is_moving(2, position), pixel.0[0] == 255);
    }
    for outside in [DVec2::new(-0.1, 5.0), DVec2::new(5.0, 120.0), DVec2::splat(f64::NAN)] {
        assert!(!reduced.moving().is_moving(2, outside));
    }
    let seeds = motion_hull(&scene, &reduced, &MotionHullOptions { points: 300, ..MotionHullOptions::default() }, 5);
    assert!(seeds.points.len() > 200 && precision(&scene, &seeds) > 0.7);
}

#[test]
fn what_masks_take_out_neither_moves_nor_votes() {
    let mut scene = builtin(&BuiltinOptions { frames: 8, ..BuiltinOptions::default() });
    let camera = scene.train[0].camera;
    // The first camera's right half is invalid and flickers.
    for (index, view) in scene.train.iter_mut().enumerate().filter(|(_, view)| view.camera == camera) {
        let mut picture = view.image.rgb().expect("in memory").as_ref().clone();
        let flicker = Rgb([if index % 2 == 0 { 255 } else { 0 }; 3]);
        let (width, height) = picture.dimensions();
        (0..height).flat_map(|y| (80..width).map(move |x| (x, y))).for_each(|(x, y)| picture.put_pixel(x, y, flicker));
        view.image = Picture::Memory(Arc::new(picture));
        let mask = RgbImage::from_fn(width, height, |x, _| Rgb([if x < 80 { 255 } else { 0 }; 3]));
        view.mask = Some(Mask { picture: Picture::Memory(Arc::new(mask)), inverted: false });
    }
    let film = film(&scene, &MovingPixelsOptions::default());
    let map = film.moving().map(3).expect("known");
    let at = |x: f64| map.at(DVec2::new(x, 60.0)).expect("in the picture");
    assert!(at(79.5).counts() && !at(80.5).counts() && !at(80.5).moves());
    let seeds = motion_hull(&scene, &film, &MotionHullOptions { points: 500, ..MotionHullOptions::default() }, 0);
    let unseen =
        seeds.points.positions.iter().filter(|&&point| position(&scene.train[0], point).is_some_and(|p| p.x > 80.0));
    assert!(unseen.count() > 50, "the six other cameras find what the first does not count");
}

#[test]
fn still_pictures_have_an_empty_hull_and_photos_none() {
    let mut scene = builtin(&BuiltinOptions { width: 32, height: 24, frames: 3, ..BuiltinOptions::default() });
    for view in &mut scene.train {
        view.image = view.truth.background.clone().expect("built in");
    }
    let film = film(&scene, &MovingPixelsOptions::default());
    let seeds = motion_hull(&scene, &film, &MotionHullOptions::default(), 0);
    assert!(seeds.points.is_empty() && seeds.summary.candidates == 0 && seeds.summary.moving_share == 0.0);
    let photos = BuiltinOptions { photos: 6, width: 32, height: 24, ..BuiltinOptions::of_kind(BuiltinKind::Casual) };
    assert_eq!(MovingPixels::of(&builtin(&photos), &MovingPixelsOptions::default()).expect("in memory"), None);
    // Two cameras are too few.
    scene.train.truncate(6);
    assert!(MotionFilm::of(&scene, &MovingPixelsOptions::default()).expect("in memory").is_none());
}
