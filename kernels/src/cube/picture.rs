//! Images of bytes as planes of numbers. CPU twin: `picture/mod.rs`.

use cubecl::prelude::*;

/// Bytes of a word.
const BYTES: usize = size_of::<u32>();

/// The largest byte, which becomes 1.
const WHITE: f32 = u8::MAX as f32;

/// Writes `planes` `[channels, pixels]` in `[0, 1]` from the bytes `[pixels, channels]`, four to a word, the first one
/// lowest. A unit is a pixel.
#[cube(launch)]
pub fn unpack(words: &[u32], planes: &mut [f32], pixels: u32, #[comptime] channels: usize) {
    let pixel = ABSOLUTE_POS;
    let plane = pixels as usize;
    if pixel < plane {
        #[unroll]
        for channel in 0..channels {
            let at = pixel * channels + channel;
            let byte = (words[at / BYTES] >> (8u32 * (at % BYTES) as u32)) & 255u32;
            // A shader may divide inexactly, and masks compare with 1.
            planes[channel * plane + pixel] = select(byte == 255u32, 1.0f32, f32::cast_from(byte) / WHITE);
        }
    }
}
