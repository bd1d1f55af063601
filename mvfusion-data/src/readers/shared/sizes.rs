//! Sizes of images: the common size, the size of their cameras, and the downscaled size.

use std::path::Path;

use rayon::prelude::*;
use tracing::info;

use super::exif::{self, Used};
use super::shot::{FrameLens, Shot};
use crate::error::DataError;

/// Longest accepted side of an image in pixels, as in JPEG. A false header must not cause excessive work.
const LONGEST_SIDE: u32 = 65_535;

/// Most pixels of an image. Decoders take no more than 512 MiB.
const MOST_PIXELS: u64 = (512 << 20) / 3;

/// Minimum useful number of pixels along each side.
const LEAST_SIDE: u32 = 16;

/// How the images of all shots are used. The first error in the order of the shots, whichever thread found one first.
pub(super) fn images_as_used(shots: &[Shot]) -> Result<Vec<Used>, DataError> {
    shots.par_iter().map(exif::used).collect::<Vec<_>>().into_iter().collect()
}

/// The common size of all images. Batches are stacked, so sizes must agree.
pub(super) fn common_size(folder: &Path, shots: &[Shot], images: &[Used]) -> Result<(u32, u32), DataError> {
    let sizes: Vec<(u32, u32)> = images.iter().map(|image| image.size).collect();
    let is_huge = |&(width, height): &(u32, u32)| {
        width.max(height) > LONGEST_SIDE || u64::from(width) * u64::from(height) > MOST_PIXELS
    };
    if let Some(huge) = sizes.iter().position(is_huge) {
        let (width, height) = sizes[huge];
        let path = shots[huge].source.path().to_owned();
        let reason = format!(
            "its header tells of {width} x {height} pixels, and an image has at most {LONGEST_SIDE} along a side and \
             {MOST_PIXELS} in all"
        );
        return Err(DataError::Image { path, reason });
    }
    let Some(other) = sizes.iter().position(|size| *size != sizes[0]) else { return Ok(sizes[0]) };
    let shown = |i: usize| {
        let path = shots[i].source.path();
        let path = path.strip_prefix(folder).unwrap_or(path);
        format!("{} has {} x {} pixels", path.display(), sizes[i].0, sizes[i].1)
    };
    Err(DataError::Disagreement {
        folder: folder.to_owned(),
        first: shown(0),
        second: shown(other),
        advice: "All images of a scene must have one size: extract them again, or scale them alike".into(),
    })
}

/// Checks that images of `size` pixels have the aspect ratio of their lenses.
///
/// # Errors
/// [`DataError::Disagreement`] if no common factor scales one to the other.
pub(super) fn check_shapes(folder: &Path, (width, height): (u32, u32), shots: &[Shot]) -> Result<(), DataError> {
    let mut scaled = None;
    for shot in shots {
        let FrameLens::Known { size: full, .. } = shot.lens else { continue };
        if (full.x, full.y) == (f64::from(width), f64::from(height)) {
            continue;
        }
        if !is_scaled((full.x, full.y), (f64::from(width), f64::from(height))) {
            return Err(DataError::Disagreement {
                folder: folder.to_owned(),
                first: format!("the images have {width} x {height} pixels"),
                second: format!("the camera of {} is for {} x {}", shot.name, full.x, full.y),
                advice:
                    "Use the images that the cameras were made from, or copies scaled by one factor along both sides"
                        .into(),
            });
        }
        scaled = Some(full);
    }
    if let Some(full) = scaled {
        info!(
            "the images have {width}x{height} pixels, their cameras are for {}x{}: \
             focal lengths and principal points are scaled to the images",
            full.x, full.y
        );
    }
    Ok(())
}

/// Whether one factor scales both sides of the larger image to those of the smaller image. Sides may be rounded to the
/// nearest pixel or rounded down.
pub(crate) fn is_scaled(one: (f64, f64), other: (f64, f64)) -> bool {
    /// How far a side before rounding may be below and above the rounded one.
    const ROUNDING: [(f64, f64); 2] = [(0.5, 0.5), (0.0, 1.0)];
    let (full, scaled) = if one.0 < other.0 { (other, one) } else { (one, other) };
    // A fraction of a pixel is within the rounding of any aspect ratio.
    scaled.0.min(scaled.1) >= 1.0
        && ROUNDING.iter().any(|(below, above)| {
            let factors = |full: f64, scaled: f64| ((scaled - below) / full, (scaled + above) / full);
            let (x, y) = (factors(full.0, scaled.0), factors(full.1, scaled.1));
            x.0.max(y.0) < x.1.min(y.1)
        })
}

/// The size of images of `width` by `height` pixels, such as `first`, after downscaling by the option `downscale`.
///
/// # Errors
/// [`DataError::Setting`] if the factor is below 1, or so large that nothing useful remains. [`DataError::Content`] if
/// the images are too small as they are.
pub(super) fn reduced_size(first: &Path, (width, height): (u32, u32), downscale: f64) -> Result<(u32, u32), DataError> {
    let refuse =
        |reason, advice| DataError::Setting { option: "downscale", value: downscale.to_string(), reason, advice };
    if !downscale.is_finite() || downscale < 1.0 {
        let advice = "Read the images in their own size with `--set scene.downscale=1`".into();
        return Err(refuse("it must be 1 or more: images are made smaller, never larger".into(), advice));
    }
    let least = width.min(height);
    if least < LEAST_SIDE {
        let reason = format!("it has {width}x{height} pixels, and each side needs at least {LEAST_SIDE}");
        return Err(DataError::Content { path: first.to_owned(), reason, advice: "Use larger images" });
    }
    let smaller = |side: u32| (f64::from(side) / downscale).round() as u32;
    let (small_width, small_height) = (smaller(width), smaller(height));
    if small_width.min(small_height) < LEAST_SIDE {
        let reason = format!(
            "images of {width}x{height} would become {small_width}x{small_height}, and each side needs at least \
             {LEAST_SIDE} pixels"
        );
        // Rounded down to hundredths.
        let most = f64::from(100 * least / LEAST_SIDE) / 100.0;
        return Err(refuse(reason, format!("Make them less small, with `--set scene.downscale={most}` at most")));
    }
    Ok((small_width, small_height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_that_are_too_small_as_they_are_do_not_blame_the_factor() {
        for (size, downscale) in [((1, 1), 1.0), ((1, 1), 4.0), ((640, 15), 1.0)] {
            let said = reduced_size(Path::new("a.png"), size, downscale).expect_err("too small").to_string();
            assert!(said.contains("a.png") && said.contains(&format!("{}x{} pixels", size.0, size.1)), "{said}");
            assert!(said.contains("at least 16") && !said.contains("downscale"), "{said}");
        }
    }

    #[test]
    fn a_factor_that_is_too_large_is_refused_with_the_largest_that_fits() {
        let reduced = |downscale| reduced_size(Path::new("a.png"), (1352, 1014), downscale);
        let said = reduced(100.0).expect_err("too small").to_string();
        assert!(said.contains("scene.downscale = 100") && said.contains("--set scene.downscale=63.37"), "{said}");
        assert_eq!(reduced(63.37).expect("fits"), (21, 16));
    }

    #[test]
    fn scaled_copies_are_accepted_however_their_sides_were_rounded() {
        for (full, factor) in
            [((4032.0, 3024.0), 8.0), ((1003.0, 667.0), 8.0), ((1000.0, 671.0), 8.0), ((31.0, 17.0), 4.0)]
        {
            let (x, y) = (full.0 / factor, full.1 / factor);
            assert!(is_scaled(full, (f64::round(x), f64::round(y))), "{full:?} / {factor}, rounded");
            assert!(is_scaled(full, (f64::floor(x), f64::floor(y))), "{full:?} / {factor}, rounded down");
            assert!(is_scaled((x.round(), y.round()), full), "enlarged again");
        }
    }

    #[test]
    fn other_shapes_are_refused() {
        for (full, scaled) in [
            ((1000.0, 667.0), (125.0, 85.0)),
            ((48.0, 32.0), (32.0, 48.0)),
            ((1352.0, 1014.0), (1350.0, 1014.0)),
            ((48.0, 32.0), (0.3, 0.1)),
        ] {
            assert!(!is_scaled(full, scaled), "{full:?} -> {scaled:?}");
        }
    }
}
