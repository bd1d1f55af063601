//! An image with its mask, before and after decoding.

use std::sync::Arc;

use image::{GrayImage, RgbImage};

use crate::error::DataError;
use crate::scene::mask::Mask;
use crate::scene::picture::Picture;

/// An image with its mask, decoded.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// The image.
    pub rgb: Arc<RgbImage>,
    /// 255 at valid pixels, 0 at ignored pixels. Without a mask, all pixels are valid.
    pub valid: Option<Arc<GrayImage>>,
}

/// An image with its mask, before decoding.
#[derive(Debug)]
pub(super) struct Masked {
    pub(super) picture: Picture,
    pub(super) mask: Option<Mask>,
}

impl Masked {
    pub(super) fn decode(&self) -> Result<Decoded, DataError> {
        let valid = self.mask.as_ref().map(Mask::read).transpose()?;
        Ok(Decoded { rgb: self.picture.rgb()?, valid: valid.map(Arc::new) })
    }

    /// Whether there is nothing to decode.
    pub(super) fn is_ready(&self) -> bool {
        matches!(self.picture, Picture::Memory(_)) && self.mask.is_none()
    }

    /// Additional bytes when decoded.
    pub(super) fn bytes(&self) -> u64 {
        let (width, height) = self.picture.size();
        let planes = match self.picture {
            Picture::Memory(_) => 0,
            Picture::File(_) => 3,
        };
        (planes + u64::from(self.mask.is_some())) * u64::from(width) * u64::from(height)
    }
}
