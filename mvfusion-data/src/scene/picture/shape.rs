//! The check of an image file's aspect ratio.

use std::path::Path;

use crate::error::DataError;

/// What an image file is used as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PictureUse {
    /// The image of a camera.
    Photo,
    /// A mask of such an image.
    Mask,
}

impl PictureUse {
    /// Advice for a file of another shape.
    fn advice(self) -> &'static str {
        match self {
            Self::Photo => "Use the image that its camera is for, or a copy scaled by one factor along both sides",
            Self::Mask => "Make the mask again in the shape of its image, or remove the mask",
        }
    }
}

/// Checks that a file of `found` pixels has the aspect ratio of `wanted`, to which it is to be resized. Each side may
/// be off by a pixel of rounding.
///
/// # Errors
/// [`DataError::Content`] if the aspect ratios differ. A stretched mask would cover the wrong pixels, and a picture of
/// one long row would be resized through a picture as wide and as high as needed.
pub(crate) fn check_shape(
    path: &Path,
    found: (u32, u32),
    wanted: (u32, u32),
    used_as: PictureUse,
) -> Result<(), DataError> {
    let [w, h, width, height] = [found.0, found.1, wanted.0, wanted.1].map(u64::from);
    if (w * height).abs_diff(h * width) <= w + h + width + height {
        return Ok(());
    }
    let reason = format!("it has {w} x {h} pixels, another shape than the {width} x {height} that it is used for");
    Err(DataError::Content { path: path.to_owned(), reason, advice: used_as.advice() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn photos_and_masks_of_another_shape_are_refused_each_with_its_own_advice() {
        let said = |used_as| {
            let error = check_shape(Path::new("a.png"), (48, 64), (64, 48), used_as).expect_err("turned");
            assert!(matches!(error, DataError::Content { .. }), "{error}");
            error.to_string()
        };
        let (photo, mask) = (said(PictureUse::Photo), said(PictureUse::Mask));
        assert!(photo.contains("its camera is for") && !photo.contains("mask"), "{photo}");
        assert!(mask.contains("Make the mask again"), "{mask}");
        for used_as in [PictureUse::Photo, PictureUse::Mask] {
            check_shape(Path::new("a.png"), (251, 167), (125, 83), used_as).expect("rounded");
        }
    }
}
