//! Downscaled copies of images: `images_4` next to `images`, as in LLFF, nerfstudio, On-the-go and RobustNeRF.
//!
//! Assumptions:
//! * `images_N` contains the images of `images` with the same names, possibly with other extensions. Both sides of each
//!   are N times shorter.
//! * If `downscale` is N, they replace images that would otherwise be downscaled. If there is no `images`, the only
//!   folder `images_N` replaces it.

use std::path::{Path, PathBuf};

use tracing::{info, warn};

use super::shot::Shot;
use super::views::views;
use crate::error::DataError;
use crate::files::picture_named;
use crate::readers::options::ReadOptions;
use crate::scene::{PictureHeader, PictureSource, View};

/// Folder of the full-size images.
pub(crate) const IMAGES: &str = "images";

/// Whether a scene has a folder of images, full-size or smaller.
pub(crate) fn has_pictures(scene: &Path) -> bool {
    scene.join(IMAGES).is_dir() || !factors(scene).is_empty()
}

/// The folder that lists the images of a scene.
///
/// # Errors
/// [`DataError::Missing`] if there is no `images`, but several smaller copies of it.
pub(crate) fn listing_folder(scene: &Path, options: &ReadOptions) -> Result<PathBuf, DataError> {
    let images = scene.join(IMAGES);
    if images.is_dir() {
        return Ok(images);
    }
    Ok(stand_in(scene, options)?.map_or(images, |factor| folder_of(scene, factor)))
}

/// The views of shots (see [`views`]). Their images may be in a smaller copy of the folder `images`.
///
/// # Errors
/// Same as [`views`], and those of [`listing_folder`].
pub(crate) fn views_of_pictures(
    scene: &Path,
    mut shots: Vec<Shot>,
    options: &ReadOptions,
) -> Result<Vec<View>, DataError> {
    let downscale = redirect(scene, &mut shots, options)?;
    views(scene, shots, &ReadOptions { downscale, ..options.clone() })
}

/// Redirects shots to smaller copies of their images if appropriate. Returns the factor of `downscale` that remains.
fn redirect(scene: &Path, shots: &mut [Shot], options: &ReadOptions) -> Result<f64, DataError> {
    let downscale = options.downscale;
    let images = scene.join(IMAGES);
    let inside = |shot: &Shot| shot.source.path().strip_prefix(&images).map(Path::to_owned).ok();
    let Some(names) = shots.iter().map(inside).collect::<Option<Vec<_>>>() else { return Ok(downscale) };
    // An invalid factor is rejected where images are resized.
    let Some(factor) = chosen(scene, options)?.filter(|_| downscale >= 1.0) else { return Ok(downscale) };
    let folder = folder_of(scene, factor);
    let copies: Vec<PathBuf> = names.iter().map(|name| copy_of(&folder, name)).collect();
    let absent = copies.iter().filter(|copy| !copy.is_file()).count();
    if absent > 0 && images.is_dir() {
        warn!(
            folder = %folder.display(),
            "{absent} of {} images are not in {IMAGES}_{factor}: those in {IMAGES} are read and made smaller",
            names.len()
        );
        return Ok(downscale);
    }
    if let (Some(name), Some(copy)) = (names.first(), copies.first()) {
        warn_of_size(&images.join(name), copy, factor);
    }
    for (shot, copy) in shots.iter_mut().zip(copies) {
        shot.source = PictureSource::Image(copy);
    }
    let left = (downscale / f64::from(factor)).max(1.0);
    let further = if left > 1.0 { format!("made smaller by {left}") } else { "as they are".into() };
    info!("the images in {IMAGES}_{factor}, {factor} times smaller than those in {IMAGES}, are read {further}");
    Ok(left)
}

/// Warns of a smaller copy that has not the size that its folder's name says. Without the image, nothing is known.
fn warn_of_size(image: &Path, copy: &Path, factor: u32) {
    let width = |path: &Path| PictureHeader::read(path).ok().map(|header| f64::from(header.size.0));
    let (Some(full), Some(small)) = (width(image), width(copy)) else { return };
    let expected = full / f64::from(factor);
    // Sides are rounded, up or down.
    if (small - expected).abs() > 1.0 {
        warn!(
            "{} is {small} pixels wide and not {expected:.0}, {factor} times less than {}: it is read as it is",
            copy.display(),
            image.display()
        );
    }
}

/// The N of the folder `images_N` to read instead of `images`.
fn chosen(scene: &Path, options: &ReadOptions) -> Result<Option<u32>, DataError> {
    if scene.join(IMAGES).is_dir() {
        return Ok(factors(scene).into_iter().find(|&factor| f64::from(factor) == options.downscale));
    }
    stand_in(scene, options)
}

/// The N of the folder `images_N` that replaces a missing `images`.
fn stand_in(scene: &Path, options: &ReadOptions) -> Result<Option<u32>, DataError> {
    let factors = factors(scene);
    let wanted = factors.iter().copied().find(|&factor| f64::from(factor) == options.downscale);
    match factors[..] {
        [] => Ok(None),
        [only] => Ok(Some(only)),
        _ if wanted.is_some() => Ok(wanted),
        _ => {
            let names: Vec<String> = factors.iter().map(|factor| format!("{IMAGES}_{factor}")).collect();
            let names = names.join(", ");
            Err(DataError::Missing {
                what: format!("folder {IMAGES}"),
                folder: scene.to_owned(),
                advice: format!("There are {names}: read one of them with `--set scene.downscale={}`", factors[0]),
            })
        }
    }
}

/// The N of all folders `images_N`, above one, sorted.
fn factors(scene: &Path) -> Vec<u32> {
    let Ok(entries) = std::fs::read_dir(scene) else { return Vec::new() };
    let factor = |entry: std::io::Result<std::fs::DirEntry>| {
        let path = entry.ok()?.path();
        let number = path.file_name()?.to_str()?.strip_prefix(IMAGES)?.strip_prefix('_')?;
        // Only canonical numbers count, so that the name can be restored from the number.
        let factor = number.parse::<u32>().ok().filter(|factor| *factor > 1 && factor.to_string() == number)?;
        path.is_dir().then_some(factor)
    };
    let mut factors: Vec<u32> = entries.filter_map(factor).collect();
    factors.sort_unstable();
    factors
}

fn folder_of(scene: &Path, factor: u32) -> PathBuf {
    scene.join(format!("{IMAGES}_{factor}"))
}

/// The file with this name in `folder`, or one that differs only in its extension. Some tools always write PNG.
fn copy_of(folder: &Path, name: &Path) -> PathBuf {
    let exact = folder.join(name);
    if exact.is_file() {
        return exact;
    }
    let stem = name.with_extension("");
    stem.to_str().and_then(|stem| picture_named(folder, stem)).unwrap_or(exact)
}
