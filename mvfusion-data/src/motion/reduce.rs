//! Images reduced by an integer factor. Each block is the mean of its valid pixels.

use image::{GrayImage, RgbImage};

use crate::error::DataError;
use crate::scene::View;

/// An image of blocks.
#[derive(Clone, Debug)]
pub(super) struct Reduced {
    /// RGB in 8-bit levels, block by block.
    pub colours: Vec<u8>,
    /// Whether each block is valid; `None` if all are.
    pub valid: Option<Vec<bool>>,
}

/// Decodes and reduces a view's image and mask.
///
/// # Errors
/// [`DataError::Image`] if one of them cannot be read.
pub(super) fn reduced(view: &View, factor: usize) -> Result<Reduced, DataError> {
    let picture = view.image.rgb()?;
    let mask = view.mask.as_ref().map(|mask| mask.read()).transpose()?;
    if factor == 1 {
        let valid = mask.map(|mask| mask.as_raw().iter().map(|&level| level > 0).collect());
        return Ok(Reduced { colours: picture.as_raw().clone(), valid });
    }
    Ok(match mask {
        None => Reduced { colours: averaged(&picture, None, factor).0, valid: None },
        Some(mask) => {
            let (colours, valid) = averaged(&picture, Some(&mask), factor);
            Reduced { colours, valid: Some(valid) }
        }
    })
}

/// Mean colours of blocks over their valid pixels, and whether at least half of a block's pixels are valid.
pub(super) fn averaged(picture: &RgbImage, mask: Option<&GrayImage>, factor: usize) -> (Vec<u8>, Vec<bool>) {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let (columns, rows) = (width.div_ceil(factor), height.div_ceil(factor));
    let (mut colours, mut valid) = (Vec::with_capacity(3 * columns * rows), Vec::with_capacity(columns * rows));
    // For each block in a row: sums of the colours, number of valid pixels, number of all pixels.
    let mut sums = vec![[0u32; 5]; columns];
    for top in (0..height).step_by(factor) {
        sums.fill([0; 5]);
        for y in top..height.min(top + factor) {
            let pixels = picture.as_raw()[3 * width * y..3 * width * (y + 1)].chunks_exact(3);
            for (x, pixel) in pixels.enumerate() {
                let weight = mask.is_none_or(|mask| mask.as_raw()[y * width + x] > 0) as u32;
                let sum = &mut sums[x / factor];
                for channel in 0..3 {
                    sum[channel] += weight * u32::from(pixel[channel]);
                }
                sum[3] += weight;
                sum[4] += 1;
            }
        }
        for &[red, green, blue, count, all] in &sums {
            // Rounded. The mean of bytes is a byte.
            colours.extend([red, green, blue].map(|sum| ((sum + count / 2) / count.max(1)) as u8));
            valid.push(2 * count >= all);
        }
    }
    (colours, valid)
}
