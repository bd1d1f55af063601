//! Conversion from a decoder's luma and chroma to RGB (ITU-T H.273, section 8.3).

use image::RgbImage;
use openh264::formats::YUVSource;

/// Fractional bits of the factors.
const SHIFT: u32 = 16;
const HALF: i32 = 1 << (SHIFT - 1);

/// The colour coding of a video, as factors with [`SHIFT`] fractional bits. Chroma factors are 16 times smaller,
/// because the interpolation leaves sums of sixteen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Colours {
    black: i32,
    luma: i32,
    red_v: i32,
    green_u: i32,
    green_v: i32,
    blue_u: i32,
}

impl Colours {
    /// `matrix` is the number of the matrix coefficients in H.273. Unknown and unspecified ones count as BT.601, as in
    /// ffmpeg.
    pub(super) fn new(matrix: u16, full_range: bool) -> Self {
        let (red, blue) = match matrix {
            1 => (0.2126, 0.0722),      // BT.709
            7 => (0.212, 0.087),        // SMPTE 240M
            9 | 10 => (0.2627, 0.0593), // BT.2020
            _ => (0.299, 0.114),        // BT.601
        };
        let green: f64 = 1.0 - red - blue;
        let (black, luma, chroma) = match full_range {
            true => (0, 1.0, 1.0),
            false => (16, 255.0 / 219.0, 255.0 / 224.0),
        };
        let fixed = |factor: f64| (factor * f64::from(1 << SHIFT)).round() as i32;
        let chroma = |factor: f64| fixed(factor * chroma / 16.0);
        Self {
            black,
            luma: fixed(luma),
            red_v: chroma(2.0 * (1.0 - red)),
            green_u: chroma(-2.0 * (1.0 - blue) * blue / green),
            green_v: chroma(-2.0 * (1.0 - red) * red / green),
            blue_u: chroma(2.0 * (1.0 - blue)),
        }
    }

    /// Converts a frame with one pair of chroma values for two by two pixels. Chroma is interpolated between the
    /// centres of these blocks.
    pub(super) fn convert(&self, frame: &impl YUVSource) -> RgbImage {
        let ((width, height), strides) = (frame.dimensions(), frame.strides());
        let (chroma_width, chroma_height) = (width.div_ceil(2), height.div_ceil(2));
        let mut pixels = vec![0; 3 * width * height];
        let mut chroma = [vec![0; width], vec![0; width]];
        for (y, pixels) in pixels.chunks_exact_mut(3 * width).enumerate() {
            // The nearer row of chroma has weight three, the farther one weight one.
            let (near, far) = (y / 2, neighbour(y, chroma_height));
            for (values, (plane, stride)) in chroma.iter_mut().zip([(frame.u(), strides.1), (frame.v(), strides.2)]) {
                let row = |y: usize| &plane[y * stride..][..chroma_width];
                interpolate(row(near), row(far), values);
            }
            let luma = &frame.y()[y * strides.0..][..width];
            for ((pixel, &luma), (&u, &v)) in pixels.chunks_exact_mut(3).zip(luma).zip(chroma[0].iter().zip(&chroma[1]))
            {
                pixel.copy_from_slice(&self.pixel(luma, u, v));
            }
        }
        RgbImage::from_raw(width as u32, height as u32, pixels).unwrap_or_default()
    }

    /// `u` and `v` are multiplied by 16 and have no offset.
    fn pixel(&self, luma: u8, u: i32, v: i32) -> [u8; 3] {
        let grey = (i32::from(luma) - self.black) * self.luma + HALF;
        let rounded = |sum: i32| (sum >> SHIFT).clamp(0, 255) as u8;
        let green = self.green_u * u + self.green_v * v;
        [rounded(grey + self.red_v * v), rounded(grey + green), rounded(grey + self.blue_u * u)]
    }
}

/// The neighbouring chroma sample of pixel `at`, on the pixel's side.
fn neighbour(at: usize, count: usize) -> usize {
    match at % 2 {
        0 => (at / 2).saturating_sub(1),
        _ => (at / 2 + 1).min(count - 1),
    }
}

/// Chroma of a row of pixels times 16, without the offset, from the nearer and the farther row of samples.
fn interpolate(near: &[u8], far: &[u8], values: &mut [i32]) {
    let column = |x: usize| 3 * i32::from(near[x]) + i32::from(far[x]) - 4 * 128;
    for (x, value) in values.iter_mut().enumerate() {
        *value = 3 * column(x / 2) + column(neighbour(x, near.len()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn black_white_and_the_primaries_come_out_right() {
        // Values of section 8.3 of H.273, rounded to integers.
        let cases: [(u16, bool, [u8; 3], [u8; 3]); 7] = [
            (6, false, [16, 128, 128], [0; 3]),
            (6, false, [235, 128, 128], [255; 3]),
            (1, true, [255, 128, 128], [255; 3]),
            (6, false, [81, 90, 240], [254, 0, 0]),
            (2, false, [81, 90, 240], [254, 0, 0]),
            (1, false, [63, 102, 240], [255, 1, 0]),
            (1, false, [173, 42, 26], [0, 255, 1]),
        ];
        for (matrix, full, [luma, u, v], rgb) in cases {
            let sixteenfold = |c: u8| 16 * (i32::from(c) - 128);
            let got = Colours::new(matrix, full).pixel(luma, sixteenfold(u), sixteenfold(v));
            assert!(got.iter().zip(rgb).all(|(a, b)| a.abs_diff(b) <= 1), "{matrix} {luma} {u} {v}: {got:?}");
        }
    }

    #[test]
    fn chroma_runs_evenly_between_its_samples_and_stays_level_at_the_rim() {
        let mut values = [0; 6];
        interpolate(&[128, 136, 144], &[128, 136, 144], &mut values);
        assert_eq!(values, [0, 32, 96, 160, 224, 256]);
    }
}
