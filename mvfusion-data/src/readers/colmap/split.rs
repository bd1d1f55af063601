//! The split into training and held-out photos, and the time of each photo (METHOD §5.2).

use std::path::Path;

use super::lists::{LISTS, Lists};
use super::model::Photo;
use super::purpose::{Purpose, number, purpose};
use crate::error::DataError;
use crate::readers::options::every_so_many;
use crate::readers::shared::frame_numbers::places_in_time;

/// Photos by purpose. Each part keeps the order of the names.
#[derive(Debug)]
pub(super) struct Split {
    /// Never empty.
    pub(super) train: Vec<Moment>,
    pub(super) test: Vec<Moment>,
    /// Number of photos in neither part.
    pub(super) unused: usize,
    /// The rule that was applied, in words.
    pub(super) rule: String,
}

/// A photo and its time in `[0, 1]`.
#[derive(Debug)]
pub(super) struct Moment {
    pub(super) photo: Photo,
    pub(super) time: f64,
}

/// Splits photos that are sorted by name: by the lists if there are any, otherwise by the words in the names, otherwise
/// by LLFF's rule. `images` is their folder, for messages.
///
/// # Errors
/// [`DataError::Setting`] if `test_every` is 1. [`DataError::Content`] if a name has a word but no number, or a list is
/// invalid. [`DataError::Missing`] if no photo trains.
pub(super) fn split(
    photos: Vec<Photo>,
    lists: Option<&Lists>,
    test_every: usize,
    images: &Path,
) -> Result<Split, DataError> {
    let count = photos.len();
    let named = photos.iter().any(|photo| purpose(&photo.name).is_some_and(|(_, purpose)| purpose != Purpose::Neither));
    let split = match lists {
        Some(lists) => by_list(lists.purposes(&photos)?, photos),
        None if named => by_name(photos, images)?,
        None => by_position(photos, test_every)?,
    };
    if split.train.is_empty() {
        let rule = match lists {
            Some(_) => format!("Those in {} train", LISTS[0].0),
            None => "Those with `clutter` in their names train and those with `extra` are held out; where there are no such \
                     names, every photo trains that is not held out"
                .into(),
        };
        let advice = format!("The model lists {count} photos. {rule}");
        return Err(DataError::Missing { what: "photo to train on".into(), folder: images.to_owned(), advice });
    }
    Ok(split)
}

/// Splits by the lists. If all names have numbers, times are as in [`by_name`]. Otherwise a photo's time is its place
/// among all photos in temporal order.
fn by_list(purposes: Vec<Purpose>, photos: Vec<Photo>) -> Split {
    let count = photos.len() as f64;
    let largest = photos.iter().filter_map(|photo| number(&photo.name)).max().unwrap_or(0).max(1);
    let listed = || photos.iter().zip(&purposes).filter(|(_, purpose)| **purpose != Purpose::Neither);
    let numbered = listed().all(|(photo, _)| number(&photo.name).is_some());
    let rule = format!("by {} and {}", LISTS[0].0, LISTS[1].0);
    let mut split = Split { train: Vec::new(), test: Vec::new(), unused: 0, rule };
    let places = places(&photos);
    for ((photo, purpose), place) in photos.into_iter().zip(purposes).zip(places) {
        let time = match number(&photo.name).filter(|_| numbered) {
            Some(number) => f64::from(number) / f64::from(largest),
            None => place as f64 / count,
        };
        match purpose {
            Purpose::Train => split.train.push(Moment { photo, time }),
            Purpose::Test => split.test.push(Moment { photo, time }),
            Purpose::Neither => split.unused += 1,
        }
    }
    split
}

/// Splits by the words in the names. A photo's time is the number after the word, divided by the largest such number.
fn by_name(photos: Vec<Photo>, images: &Path) -> Result<Split, DataError> {
    let largest = photos.iter().filter_map(|photo| number(&photo.name)).max().unwrap_or(0).max(1);
    let rule = "by name: clutter trains, extra is held out".to_owned();
    let mut split = Split { train: Vec::new(), test: Vec::new(), unused: 0, rule };
    for photo in photos {
        let part = match purpose(&photo.name) {
            Some((_, Purpose::Train)) => &mut split.train,
            Some((_, Purpose::Test)) => &mut split.test,
            Some((_, Purpose::Neither)) | None => {
                split.unused += 1;
                continue;
            }
        };
        let number = number(&photo.name).ok_or_else(|| DataError::Content {
            path: images.join(&photo.name),
            reason: "its name has no number of use right after `clutter` or `extra`, so its time is not known".into(),
            advice: "Name photos like 2clutter008.jpg and 1extra000.jpg, in the model and on disk",
        })?;
        part.push(Moment { photo, time: f64::from(number) / f64::from(largest) });
    }
    Ok(split)
}

/// LLFF's rule: every n-th photo by name is held out. A photo's time is its place in temporal order, divided by the
/// number of photos.
fn by_position(photos: Vec<Photo>, test_every: usize) -> Result<Split, DataError> {
    let is_test = every_so_many(test_every)?;
    let count = photos.len() as f64;
    let places = places(&photos);
    let moments = photos.into_iter().zip(places).map(|(photo, place)| Moment { photo, time: place as f64 / count });
    let (test, train): (Vec<_>, Vec<_>) = moments.enumerate().partition(|(index, _)| is_test(*index));
    let moments = |part: Vec<(usize, Moment)>| part.into_iter().map(|(_, moment)| moment).collect();
    let rule = match test_every {
        0 => "scene.test_every = 0".to_owned(),
        _ => format!("one in {test_every}, as no name contains clutter or extra"),
    };
    Ok(Split { train: moments(train), test: moments(test), unused: 0, rule })
}

/// The place of each photo in temporal order.
fn places(photos: &[Photo]) -> Vec<usize> {
    places_in_time(photos.iter().map(|photo| photo.name.as_str()))
}

#[cfg(test)]
mod tests {
    use glam::{DMat3, DVec2, DVec3};

    use super::*;
    use crate::scene::{Distortion, Lens};

    fn photos(names: &[&str]) -> Vec<Photo> {
        let size = DVec2::new(48.0, 32.0);
        let lens = Lens { focal: DVec2::splat(40.0), principal: 0.5 * size, distortion: Distortion::NONE };
        let photo = |name: &&str| Photo {
            name: (*name).to_owned(),
            lens,
            size,
            rotation: DMat3::IDENTITY,
            translation: DVec3::ZERO,
        };
        names.iter().map(photo).collect()
    }

    fn parted(names: &[&str], test_every: usize) -> Result<Split, DataError> {
        split(photos(names), None, test_every, Path::new("images"))
    }

    fn shown(part: &[Moment]) -> Vec<(&str, f64)> {
        part.iter().map(|moment| (moment.photo.name.as_str(), moment.time)).collect()
    }

    #[test]
    fn names_part_the_photos_and_the_largest_number_of_all_is_time_one() {
        let names = ["0clean010.JPG", "1extra004.JPG", "2clutter000.JPG", "2clutter5_b.JPG", "notes7.JPG"];
        let split = parted(&names, 8).expect("parted");
        assert_eq!(shown(&split.train), [("2clutter000.JPG", 0.0), ("2clutter5_b.JPG", 0.5)]);
        assert_eq!(shown(&split.test), [("1extra004.JPG", 0.4)]);
        assert_eq!(split.unused, 2);
    }

    #[test]
    fn extra_wins_over_clutter_and_folders_do_not_count() {
        let split = parted(&["clutter1.png", "cluttered_extra2.png", "extra/clutter3.png"], 8).expect("parted");
        assert_eq!(split.test.len(), 1);
        assert_eq!(shown(&split.train), [("clutter1.png", 1.0 / 3.0), ("extra/clutter3.png", 1.0)]);
    }

    #[test]
    fn a_single_number_zero_is_time_zero() {
        assert_eq!(shown(&parted(&["clutter0.png"], 8).expect("parted").train), [("clutter0.png", 0.0)]);
    }

    #[test]
    fn without_such_names_every_eighth_is_held_out() {
        let names: Vec<String> = (0..17).map(|i| format!("IMG_{i:02}_clean.png")).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let split = parted(&names, 8).expect("parted");
        assert_eq!(shown(&split.test).iter().map(|m| m.1).collect::<Vec<_>>(), [0.0, 8.0 / 17.0, 16.0 / 17.0]);
        assert_eq!((split.train.len(), split.train[0].time), (14, 1.0 / 17.0));
        let split = parted(&names, 0).expect("parted");
        assert_eq!((split.train.len(), split.test.len()), (17, 0));
    }

    #[test]
    fn times_follow_the_numbers_in_names_and_the_split_their_text() {
        let split = parted(&["f_1.png", "f_10.png", "f_2.png", "f_3.png"], 2).expect("parted");
        assert_eq!(shown(&split.test), [("f_1.png", 0.0), ("f_2.png", 0.25)]);
        assert_eq!(shown(&split.train), [("f_10.png", 0.75), ("f_3.png", 0.5)]);
    }

    #[test]
    fn words_that_contain_extra_or_clutter_do_not_part_the_photos() {
        let split = parted(&["cluttered_1.png", "extracted_2.png"], 2).expect("parted by position");
        assert_eq!((split.train.len(), split.test.len(), split.unused), (1, 1, 0));
        let split = parted(&["1clutter1.png", "1extra2.png", "extracted_3.png"], 2).expect("parted by name");
        assert_eq!((split.train.len(), split.test.len(), split.unused), (1, 1, 1));
    }

    #[test]
    fn a_split_without_training_photos_is_refused() {
        for (names, part) in
            [(&["1extra000.JPG", "0clean001.JPG"][..], "2 photos"), (&["a.png"], "1 photos"), (&[], "0")]
        {
            let error = parted(names, 8).expect_err("nothing to train on").to_string();
            assert!(error.contains("no photo to train on") && error.contains(part), "{error}");
        }
        assert!(matches!(parted(&["a.png", "b.png"], 1), Err(DataError::Setting { option: "test_every", .. })));
    }

    #[test]
    fn a_photo_without_a_number_is_named() {
        for name in ["clutter.png", "clutter_3.png", "extra99999999999.png"] {
            let error = parted(&["clutter1.png", name], 8).expect_err("no number").to_string();
            assert!(error.contains(name) && error.contains("number"), "{error}");
        }
    }
}
