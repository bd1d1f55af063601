//! Tests of the cache. Each image has one grey level: its index.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat3, DVec3};
use image::{GrayImage, Luma, Rgb, RgbImage};

use super::*;
use crate::scene::camera::Camera;
use crate::scene::mask::Mask;
use crate::scene::picture::Picture;
use crate::scene::view::Truth;

const SIDE: u32 = 32;
const BYTES: u64 = 3 * (SIDE as u64) * (SIDE as u64);

fn view(image: Picture) -> View {
    let camera = Camera::centred(SIDE as usize, SIDE as usize, 30.0, DMat3::IDENTITY, DVec3::ZERO);
    View { name: String::new(), camera, time: 0.0, image, mask: None, truth: Truth::default() }
}

fn views(folder: &Path, count: u8) -> Vec<View> {
    let written = |i: u8| {
        let path = folder.join(format!("{i}.png"));
        RgbImage::from_pixel(SIDE, SIDE, Rgb([i; 3])).save(&path).expect("written");
        view(Picture::file(path, (SIDE, SIDE)))
    };
    (0..count).map(written).collect()
}

/// The grey level of an image.
fn level(cache: &PictureCache, index: usize) -> u8 {
    cache.get(index).expect("decoded").rgb.get_pixel(3, 3).0[0]
}

#[test]
fn pictures_come_as_asked_for_and_within_the_budget() {
    let folder = tempfile::tempdir().expect("folder");
    let cache = PictureCache::new(&views(folder.path(), 20), 4 * BYTES, 2);
    for round in 0..3 {
        let order: Vec<usize> = (0..20).map(|i| (7 * i + round) % 20).collect();
        for (at, &index) in order.iter().enumerate() {
            cache.announce(&order[at..(at + 6).min(20)]);
            assert_eq!(level(&cache, index), index as u8);
            assert!(cache.held() <= 4 * BYTES, "{} bytes", cache.held());
        }
    }
}

/// A cache whose system starts only so many threads.
fn with_limit(views: &[View], most: usize) -> PictureCache {
    let started = AtomicUsize::new(0);
    PictureCache::with_threads(views, 4 * BYTES, 3, |shared| match started.fetch_add(1, Ordering::Relaxed) {
        count if count < most => std::thread::Builder::new().spawn(move || shared.decode_in_turn()),
        _ => Err(io::Error::from(io::ErrorKind::WouldBlock)),
    })
}

#[test]
fn pictures_come_from_as_many_threads_as_the_system_starts() {
    let folder = tempfile::tempdir().expect("folder");
    for most in [0, 1, 2] {
        let cache = with_limit(&views(folder.path(), 6), most);
        assert_eq!(cache.workers.len(), most);
        cache.fill().expect("decoded");
        for index in [3, 5, 0, 3, 1, 4, 2] {
            cache.announce(&[index, 2]);
            assert_eq!(level(&cache, index), index as u8, "{most} threads");
        }
    }
}

#[test]
fn a_budget_for_less_than_a_picture_still_gives_pictures() {
    let folder = tempfile::tempdir().expect("folder");
    let cache = PictureCache::new(&views(folder.path(), 3), 1, 2);
    for index in [2, 0, 1, 1, 2] {
        assert_eq!(level(&cache, index), index as u8);
        assert!(cache.held() <= BYTES);
    }
}

#[test]
fn a_changed_budget_holds_from_the_next_decoding_on() {
    let folder = tempfile::tempdir().expect("folder");
    let cache = PictureCache::new(&views(folder.path(), 6), 6 * BYTES, 1);
    cache.fill().expect("decoded");
    assert_eq!(cache.held(), 6 * BYTES);
    // The images that are held stay until there is something to decode.
    cache.set_budget(2 * BYTES);
    assert_eq!((level(&cache, 4), cache.held()), (4, 6 * BYTES));
    let small = PictureCache::new(&views(folder.path(), 6), BYTES, 1);
    level(&small, 0);
    small.set_budget(3 * BYTES);
    for index in [1, 2, 3, 0] {
        assert_eq!(level(&small, index), index as u8);
        assert!(small.held() <= 3 * BYTES);
    }
    small.set_budget(BYTES);
    assert_eq!((level(&small, 5), small.held()), (5, BYTES));
}

#[test]
fn a_share_of_the_pictures_stays_from_round_to_round() {
    let folder = tempfile::tempdir().expect("folder");
    let cache = PictureCache::new(&views(folder.path(), 12), 6 * BYTES, 1);
    let mut decoded = 0;
    for round in 0..4 {
        for i in 0..12 {
            let index = (5 * i + round) % 12;
            decoded += usize::from(round > 0 && !matches!(cache.shared.lock().entries[index], Entry::Ready { .. }));
            cache.get(index).expect("decoded");
        }
    }
    // Half of the images fit, and the current one needs room: no round decodes more than seven.
    assert!(decoded <= 3 * 7, "{decoded} decoded again in three rounds");
}

#[test]
fn what_was_announced_in_vain_gives_way_to_what_is_wanted() {
    let folder = tempfile::tempdir().expect("folder");
    let cache = PictureCache::new(&views(folder.path(), 8), 2 * BYTES, 2);
    cache.announce(&[0, 1, 2]);
    for index in [7, 6, 5, 0] {
        assert_eq!(level(&cache, index), index as u8);
    }
}

#[test]
fn a_picture_that_cannot_be_read_is_an_error_each_time_and_harms_no_other() {
    let folder = tempfile::tempdir().expect("folder");
    let views = views(folder.path(), 3);
    std::fs::write(folder.path().join("1.png"), b"broken").expect("written");
    let cache = PictureCache::new(&views, 10 * BYTES, 2);
    cache.announce(&[0, 1, 2]);
    for _ in 0..2 {
        assert!(matches!(cache.get(1), Err(DataError::Image { .. })));
        assert_eq!(level(&cache, 2), 2);
    }
    level(&cache, 0);
    assert_eq!(cache.held(), 2 * BYTES, "what is held of a picture that failed");
    assert!(matches!(cache.fill(), Err(DataError::Image { .. })));
}

#[test]
fn a_mask_comes_with_its_picture_and_counts_in_the_budget() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("mask.png");
    GrayImage::from_fn(SIDE, SIDE, |x, _| Luma([if x < 10 { 200 } else { 3 }])).save(&path).expect("written");
    let mask = Mask { picture: Picture::file(path, (SIDE, SIDE)), inverted: true };
    let in_memory = Picture::Memory(Arc::new(RgbImage::new(SIDE, SIDE)));
    let masked = [View { mask: Some(mask), ..view(in_memory.clone()) }, view(in_memory)];
    let cache = PictureCache::new(&masked, BYTES, 1);
    cache.fill().expect("decoded");
    let valid = cache.get(0).expect("decoded").valid.expect("a mask");
    assert_eq!([9, 10].map(|x| valid.get_pixel(x, 5).0[0]), [0, 255]);
    assert!(cache.get(1).expect("decoded").valid.is_none());
    assert_eq!(cache.held(), BYTES / 3);
}

#[test]
fn many_callers_with_room_for_one_picture_all_get_theirs() {
    let folder = tempfile::tempdir().expect("folder");
    let views = views(folder.path(), 9);
    std::fs::write(folder.path().join("4.png"), b"broken").expect("written");
    for budget in [0, BYTES, 3 * BYTES] {
        let cache = PictureCache::new(&views, budget, 3);
        std::thread::scope(|scope| {
            for caller in 0..6 {
                let cache = &cache;
                scope.spawn(move || {
                    for step in 0..40 {
                        let index = (5 * step + 2 * caller) % 9;
                        cache.announce(&[index, (index + 3) % 9, index, 4]);
                        match cache.get(index) {
                            Ok(image) => assert_eq!(image.rgb.get_pixel(0, 0).0[0], index as u8),
                            Err(error) => assert!(index == 4, "{error}"),
                        }
                        assert!(cache.held() <= budget.max(BYTES));
                    }
                });
            }
        });
        let state = cache.shared.lock();
        assert!(state.wanted.is_empty(), "{:?}", state.wanted);
    }
}
