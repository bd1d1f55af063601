//! Photos, or the frames of a hand-held video: `images/` and a COLMAP model in `sparse/0`.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use super::colmap::{Colmap, Effort, Images, Kind, Log, chosen};
use super::draft::Draft;
use super::error::PrepareError;
use super::event::{Listener, Tell};
use super::frames;
use super::masks::{Masks, given, none_given};
use super::options::PrepareOptions;
use super::placed::{Placed, unplaced};
use super::record::Footage;
use crate::error::DataError;
use crate::scene::PictureHeader;

/// Where the images come from.
pub(super) enum Source<'a> {
    Photos(&'a [PathBuf]),
    Video(&'a Path),
}

/// Makes the scene in the draft.
///
/// # Errors
/// If the footage cannot be used, or COLMAP places none of it.
pub(super) fn prepare(
    source: &Source<'_>,
    draft: &Draft,
    (colmap, log): (&Colmap<'_>, &mut Log),
    options: &PrepareOptions,
    listen: &mut Listener<'_>,
) -> Result<(Footage, Placed), PrepareError> {
    let images = draft.scene().join("images");
    fs::create_dir(&images).map_err(|error| PrepareError::unwritable(&images, error))?;
    let (names, footage, kind) = match source {
        Source::Photos(photos) => {
            distinct_names(photos)?;
            same_size(photos)?;
            let names = frames::copy(photos, &images, listen)?;
            (names, Footage::Photos { photos: photos.len() }, Kind::Photos)
        }
        Source::Video(video) => {
            let frames = frames::choose(video, options.fps, &images, listen)?;
            let names = frames.iter().map(|&index| format!("{}.png", frames::name(index))).collect();
            (names, Footage::Video { frames }, Kind::Frames)
        }
    };
    let masks = masks(&names, &images, draft, options, listen)?;
    let wanted = Images { folder: &images, count: names.len(), masks: masks.as_ref().and_then(Masks::folder), kind };
    let models = colmap.models(wanted, Effort::Usual, &draft.work(), log, listen)?;
    let what = if kind == Kind::Photos { "photos" } else { "frames" };
    let help = help(kind, masks.is_some());
    let Some(place) = chosen(&models, options.colmap.model)? else {
        return Err(unplaced(&names, &[], what, help, log.shown()));
    };
    models[place].copy_to(&draft.scene().join("sparse").join("0"))?;
    let placed = Placed::of(&names, &models, place);
    placed.tell(what, help, listen)?;
    Ok((footage, placed))
}

/// Checks that all photos differ in more than their extensions. COLMAP would place them, and no reader could then tell
/// their views apart.
fn distinct_names(photos: &[PathBuf]) -> Result<(), PrepareError> {
    let mut known: BTreeMap<&OsStr, &Path> = BTreeMap::new();
    for photo in photos {
        if let Some(twin) = known.insert(photo.file_stem().unwrap_or_default(), photo) {
            let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Err(PrepareError::Input {
                input: photo.parent().unwrap_or(photo).to_owned(),
                reason: format!(
                    "the photos {} and {} differ in nothing but their extensions, and views are named without: rename \
                     one of the two, or take it out",
                    name(twin),
                    name(photo)
                ),
            });
        }
    }
    Ok(())
}

/// Checks that all photos have one size, as training needs.
fn same_size(photos: &[PathBuf]) -> Result<(), PrepareError> {
    let mut first = None;
    for photo in photos {
        let size = PictureHeader::read(photo)?.size;
        let (known, (width, height)) = *first.get_or_insert((photo, size));
        if size != (width, height) {
            let name = |path: &Path| path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            return Err(PrepareError::Data(DataError::Disagreement {
                folder: photo.parent().unwrap_or(photo).to_owned(),
                first: format!("{} has {width} x {height} pixels", name(known)),
                second: format!("{} has {} x {}", name(photo), size.0, size.1),
                advice: "Training needs photos of one size: take out those of another camera, and turn none".into(),
            }));
        }
    }
    Ok(())
}

/// The given masks, for COLMAP.
fn masks(
    names: &[String],
    images: &Path,
    draft: &Draft,
    options: &PrepareOptions,
    listen: &mut Listener<'_>,
) -> Result<Option<Masks>, PrepareError> {
    let Some(folder) = &options.masks else { return Ok(None) };
    let mut masks = Masks::create(draft.work().join("masks"))?;
    let stem = |name: &str| Path::new(name).with_extension("").to_string_lossy().into_owned();
    for name in names {
        let size = PictureHeader::read(&images.join(name))?.size;
        if let Some(mask) = given(folder, &[stem(name), name.clone()], size)? {
            masks.add(name, mask)?;
        }
    }
    if masks.count == 0 {
        return Err(none_given(folder, &names.first().map(|name| stem(name)).unwrap_or_default()));
    }
    listen.note(format!(
        "{} of {} images have masks: COLMAP ignores what is white in them",
        masks.count,
        names.len()
    ))?;
    Ok(Some(masks))
}

/// What helps if images were not placed.
fn help(kind: Kind, is_masked: bool) -> &'static str {
    match (kind, is_masked) {
        (Kind::Frames, false) => {
            "Neighbouring frames must show the same still things: more of them (--fps), a slower and sharper film \
             that moves sideways rather than turns on the spot, and masks of what moves (--masks) help."
        }
        (Kind::Frames, true) => {
            "Neighbouring frames must show the same still things: more of them (--fps) and a slower and sharper film \
             that moves sideways rather than turns on the spot help."
        }
        (_, false) => {
            "Photos must overlap by two thirds, be sharp and from different places, and show more still things than \
             moving ones: more photos, or masks of what moves (--masks), help."
        }
        (_, true) => {
            "Photos must overlap by two thirds, be sharp and from different places: more photos between those that \
             were placed and those that were not help."
        }
    }
}
