//! Checks of images and masks: whether they can be decoded, and whether they have content.

use std::collections::BTreeMap;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::Path;

use image::RgbImage;
use image::imageops::{self, FilterType};
use rayon::prelude::*;

use super::problem::{Problem, Subject, count, few, percent};
use super::rig::all_views;
use crate::error::DataError;
use crate::scene::{ExifOrientation, Picture, Scene, View};

/// Number of broken files to list. The rest is counted.
const LISTED: usize = 20;
/// Largest difference between pixels of a one-colour image, in levels.
const NOISE: u8 = 2;
/// Largest side of the thumbnails for comparisons with points.
const THUMBNAIL: u32 = 480;
/// Minimum fraction of pixels that a mask must keep.
const NOTHING: f64 = 0.01;
/// Fraction of pixels, over all masks, below which the masks may be inverted.
const LITTLE: f64 = 0.5;

/// What must be removed together.
const TOGETHER: &str = "photos together with their poses, and frames of several cameras from every camera";

/// How closely the images are inspected.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pictures {
    /// Only headers, which the reader needs anyway.
    Headers,
    /// One image of each camera, for at most 24 cameras. This takes seconds. Comparing the points' colours with these
    /// images finds wrong poses that no other check finds.
    #[default]
    Sampled,
    /// Every image and mask is decoded. This takes as long as decoding for the first round of training. It finds
    /// broken, empty and repeated images.
    Decoded,
}

/// Results of decoding a view's image.
pub(super) struct Look {
    /// Equal for equal images.
    digest: u64,
    /// Whether it has only one colour.
    blank: bool,
    /// Fraction of the pixels that its mask keeps, if it has one.
    kept: Option<f64>,
    /// A small copy; only for the images of witnesses.
    pub(super) thumbnail: Option<RgbImage>,
}

/// A view and the outcome of decoding its image.
pub(super) struct Looked<'a> {
    view: &'a View,
    pub(super) look: Result<Look, Vec<DataError>>,
}

/// Decodes images and masks. The keys are indices of views. Thumbnails are kept only for `witnesses`.
pub(super) fn look<'a>(scene: &'a Scene, pictures: Pictures, witnesses: &[usize]) -> BTreeMap<usize, Looked<'a>> {
    let views: Vec<(usize, &View)> = match pictures {
        Pictures::Headers => Vec::new(),
        Pictures::Sampled => all_views(scene).enumerate().filter(|(number, _)| witnesses.contains(number)).collect(),
        Pictures::Decoded => all_views(scene).enumerate().collect(),
    };
    let look =
        |(number, view): (usize, &'a View)| (number, Looked { view, look: look_at(view, witnesses.contains(&number)) });
    views.into_par_iter().map(look).collect()
}

fn look_at(view: &View, is_witness: bool) -> Result<Look, Vec<DataError>> {
    let kept = view.mask.as_ref().map(|mask| mask.read()).transpose();
    let (picture, kept) = match (view.image.rgb(), kept) {
        (Ok(picture), Ok(kept)) => (picture, kept),
        (picture, kept) => return Err([picture.err(), kept.err()].into_iter().flatten().collect()),
    };
    let mut hasher = DefaultHasher::new();
    (picture.dimensions(), picture.as_raw()).hash(&mut hasher);
    let share = |mask: image::GrayImage| {
        mask.pixels().filter(|pixel| pixel.0[0] > 0).count() as f64 / f64::from(mask.width() * mask.height()).max(1.0)
    };
    Ok(Look {
        digest: hasher.finish(),
        blank: is_blank(&picture),
        kept: kept.map(share),
        thumbnail: is_witness.then(|| thumbnail(&picture)),
    })
}

fn is_blank(picture: &RgbImage) -> bool {
    let Some(first) = picture.pixels().next() else { return true };
    let mut ranges = first.0.map(|channel| (channel, channel));
    picture.pixels().all(|pixel| {
        ranges.iter_mut().zip(pixel.0).all(|((low, high), channel)| {
            (*low, *high) = ((*low).min(channel), (*high).max(channel));
            *high - *low <= NOISE
        })
    })
}

fn thumbnail(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    let scale = (f64::from(THUMBNAIL) / f64::from(width.max(height))).min(1.0);
    let side = |side: u32| ((f64::from(side) * scale).round() as u32).max(1);
    if scale == 1.0 {
        picture.clone()
    } else {
        imageops::resize(picture, side(width), side(height), FilterType::Triangle)
    }
}

/// Problems with the decoded images.
pub(super) fn problems(scene: &Scene, looks: &BTreeMap<usize, Looked<'_>>) -> Vec<Problem> {
    let seen: Vec<(&View, &Look)> =
        looks.values().filter_map(|looked| Some((looked.view, looked.look.as_ref().ok()?))).collect();
    let problems = [broken(looks), blank(&seen), twins(scene, looks), empty_masks(&seen), small_masks(scene, &seen)];
    problems.into_iter().flatten().chain(turned(scene)).collect()
}

/// Photos whose metadata (EXIF) ask to be turned, and what becomes of that.
fn turned(scene: &Scene) -> Vec<Problem> {
    let names = |exif: ExifOrientation| -> Vec<&str> {
        let is_so = |view: &&View| matches!(&view.image, Picture::File(file) if file.exif == exif);
        all_views(scene).filter(is_so).map(|view| view.name.as_str()).collect()
    };
    let note = |names: Vec<&str>, what: &str, remedy: &str| {
        let what = format!("{} an EXIF orientation, which is {what} ({})", having(names.len()), few(&names));
        (!names.is_empty()).then(|| Problem::note(Subject::Pictures, what, remedy))
    };
    let ignored = note(
        names(ExifOrientation::Ignored),
        "not applied: the pixels as they are stored fit the cameras",
        "That is right for cameras of COLMAP, which ignores it, too. If the photos lie on their side in the contact sheet \
         but not in the reconstruction, store them upright, and compute the cameras again.",
    );
    let applied = note(
        names(ExifOrientation::Applied),
        "applied: only the turned images fit the cameras",
        "Look at the contact sheet: the points must lie on the photos.",
    );
    [ignored, applied].into_iter().flatten().collect()
}

/// A number of images as a subject: `1 image has`.
fn having(number: usize) -> String {
    format!("{} {}", count(number, "image"), if number == 1 { "has" } else { "have" })
}

fn broken(looks: &BTreeMap<usize, Looked<'_>>) -> Option<Problem> {
    // A broken video breaks all its frames, but is named once.
    let mut reasons: BTreeMap<&Path, String> = BTreeMap::new();
    let mut remedy = format!("Copy them again from where they came from, or remove {TOGETHER}.");
    for error in looks.values().filter_map(|looked| looked.look.as_ref().err()).flatten() {
        match error {
            DataError::Image { path, reason } | DataError::Content { path, reason, .. } => {
                reasons.entry(path).or_insert_with(|| reason.clone());
            }
            DataError::Denied { path } => {
                reasons.entry(path).or_insert_with(|| "permission denied".into());
                remedy = "Make the files readable for the user who runs this program, and check again.".into();
            }
            error => {
                reasons.entry(Path::new("an image")).or_insert_with(|| error.to_string());
            }
        }
    }
    if reasons.is_empty() {
        return None;
    }
    let listed = reasons.iter().take(LISTED).map(|(path, reason)| format!("\n{}: {reason}", path.display()));
    let more = reasons.len().saturating_sub(LISTED);
    let more = if more > 0 { format!("\nand {more} more") } else { String::new() };
    let what = format!("cannot decode {}{}{more}", count(reasons.len(), "file"), listed.collect::<String>());
    Some(Problem::error(Subject::Pictures, what, remedy))
}

fn blank(seen: &[(&View, &Look)]) -> Option<Problem> {
    let names: Vec<&str> = seen.iter().filter(|(_, look)| look.blank).map(|(view, _)| view.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        let what = format!("found {} of one colour and nothing else ({})", count(names.len(), "image"), few(&names));
        Problem::warning(Subject::Pictures, what, format!("Extract them again, or remove {TOGETHER}."))
    })
}

/// Bit-identical images. No camera takes the same image twice.
fn twins(scene: &Scene, looks: &BTreeMap<usize, Looked<'_>>) -> Option<Problem> {
    let mut first: BTreeMap<u64, (&str, bool)> = BTreeMap::new();
    let (mut pairs, mut held_out) = (Vec::new(), 0);
    for (&number, Looked { view, look }) in looks {
        let Some(look) = look.as_ref().ok().filter(|look| !look.blank) else { continue };
        let is_test = number >= scene.train.len();
        match first.get(&look.digest) {
            // The check of the split reports views that are both trained on and held out.
            Some(&(twin, twin_is_test)) if !twin_is_test && twin != view.name => {
                pairs.push((twin, view.name.as_str()));
                held_out += usize::from(is_test);
            }
            Some(_) => {}
            None => {
                first.insert(look.digest, (view.name.as_str(), is_test));
            }
        }
    }
    let (one, other) = *pairs.first()?;
    let leaked = match held_out {
        0 => String::new(),
        leaked => format!("; held out are {leaked} of them, whose scores would be of what was trained on"),
    };
    let what = format!(
        "found {}, equal bit by bit (the first: {other}, equal to {one}){leaked}",
        count(pairs.len(), "repeated image")
    );
    let remedy = format!(
        "For a video, extract the frames at its own rate; otherwise remove {TOGETHER}. Where nothing changes in front of \
         a camera, it is as it should be."
    );
    Some(Problem::warning(Subject::Pictures, what, remedy))
}

fn empty_masks(seen: &[(&View, &Look)]) -> Option<Problem> {
    let empty = seen.iter().filter(|(_, look)| look.kept.is_some_and(|kept| kept < NOTHING));
    let names: Vec<&str> = empty.map(|(view, _)| view.name.as_str()).collect();
    (!names.is_empty()).then(|| {
        let what =
            format!("the masks of {} leave next to nothing of the image ({})", count(names.len(), "view"), few(&names));
        Problem::warning(
            Subject::Masks,
            what,
            "Remove these views; or invert all masks with `--set scene.invert_masks=true`.",
        )
    })
}

/// Masks that keep few pixels, over all masks.
fn small_masks(scene: &Scene, seen: &[(&View, &Look)]) -> Option<Problem> {
    let shares: Vec<f64> = seen.iter().filter_map(|(_, look)| look.kept).collect();
    let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
    if shares.is_empty() || mean >= LITTLE {
        return None;
    }
    let views = scene.train.len() + scene.test.len();
    let what = format!("the masks of {} of {views} views leave {} of the images", shares.len(), percent(mean));
    let remedy = "If they are meant the other way round, add `--set scene.invert_masks=true`.";
    Some(Problem::note(Subject::Masks, what, remedy))
}
