//! MS-SSIM over five scales, as in the package pytorch-msssim 1.0.0.

use burn::tensor::Tensor;
use burn::tensor::module::avg_pool2d;
use burn::tensor::ops::AvgPoolOptions;
use mvfusion_render::window::{self, Window, blur};

use super::{PixelMap, SSIM_BORDER};
use crate::ModelError;

/// Exponents of the scales, finest first (Wang, Simoncelli, Bovik 2003).
const WEIGHTS: [f64; 5] = [0.0448, 0.2856, 0.3001, 0.2363, 0.1333];

/// Both sides must exceed this, so that the window fits into the coarsest scale.
pub const LEAST_SIDE: usize = 160;

/// Constant of SSIM's luminance term for values in `[0, 1]`.
const LUMINANCE: f64 = 0.01 * 0.01;

/// MS-SSIM of two images `[1, 3, H, W]` in `[0, 1]`; `None` unless both sides exceed 160 pixels.
///
/// Each scale uses an 11-pixel Gaussian window with sigma 1.5 at all positions fully inside. Between scales, blocks of
/// 2 by 2 pixels are averaged; an odd length gets a zero row or column on both sides that counts as pixels. A channel's
/// value is the product of the contrast terms of the first four scales and the SSIM of the fifth. Each factor is
/// clamped at 0 and raised to its weight. The result is the mean over channels.
///
/// # Errors
/// If the device fails to return values.
pub fn ms_ssim(picture: Tensor<4>, reference: Tensor<4>) -> Result<Option<f64>, ModelError> {
    let [_, channels, height, width] = picture.dims();
    if height.min(width) <= LEAST_SIDE {
        return Ok(None);
    }
    let mut products = vec![1.0; channels];
    let [mut a, mut b] = [picture, reference];
    for (scale, weight) in WEIGHTS.into_iter().enumerate() {
        let is_last = scale + 1 == WEIGHTS.len();
        let terms = PixelMap::read(similarity(&a, &b, if is_last { Term::Whole } else { Term::Contrast }))?;
        for (product, term) in products.iter_mut().zip(terms.channel_means()) {
            *product *= term.max(0.0).powf(weight);
        }
        if !is_last {
            [a, b] = [halved(a), halved(b)];
        }
    }
    Ok(Some(products.iter().sum::<f64>() / products.len() as f64))
}

/// D-SSIM as in papers on dynamic scenes: `(1 - MS-SSIM) / 2`.
pub fn dissimilarity(ms_ssim: f64) -> f64 {
    (1.0 - ms_ssim) / 2.0
}

/// The term of a scale.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Term {
    /// Contrast and structure.
    Contrast,
    /// Contrast, structure and luminance: SSIM.
    Whole,
}

/// A term at each pixel whose window is inside: `[1, C, H - 10, W - 10]`.
///
/// Contrast is SSIM divided by luminance. The op computes SSIM from central moments, whereas a difference of mean square
/// and squared mean loses the variances of bright, flat images in single precision.
fn similarity(a: &Tensor<4>, b: &Tensor<4>, term: Term) -> Tensor<4> {
    let bell = Window::gaussian(11, 1.5);
    let ssim = inside(window::ssim_map(a.clone(), b.clone(), &bell));
    match term {
        Term::Whole => ssim,
        Term::Contrast => {
            let [mean_a, mean_b] = [a, b].map(|image| inside(blur(image.clone(), &bell)));
            let squares = mean_a.clone().square() + mean_b.clone().square();
            ssim * (squares + LUMINANCE) / (mean_a * mean_b * 2.0 + LUMINANCE)
        }
    }
}

/// A blurred image without the pixels whose window extends beyond it.
fn inside(image: Tensor<4>) -> Tensor<4> {
    let [_, _, height, width] = image.dims();
    image.narrow(2, SSIM_BORDER, height - 2 * SSIM_BORDER).narrow(3, SSIM_BORDER, width - 2 * SSIM_BORDER)
}

/// Means of blocks of 2 by 2 pixels.
fn halved(image: Tensor<4>) -> Tensor<4> {
    let [_, _, height, width] = image.dims();
    let options = AvgPoolOptions::new([2, 2]).with_stride([2, 2]).with_padding([height % 2, width % 2]);
    avg_pool2d(image, options.with_count_include_pad(true))
}

#[cfg(test)]
mod tests {
    use burn::tensor::TensorData;

    use super::*;
    use crate::random::Stream;
    use crate::test_support::{for_each_device, picture, values};

    #[test]
    fn small_pictures_have_none() {
        for_each_device(|device| {
            let mut stream = Stream::new(1, 0);
            for (size, known) in [([160, 200], false), ([200, 160], false), ([161, 161], true)] {
                let image = picture(&mut stream, size, &device);
                assert_eq!(ms_ssim(image.clone(), image).expect("numbers").is_some(), known, "{size:?}");
            }
        });
    }

    #[test]
    fn a_picture_is_like_itself_and_less_like_another() {
        for_each_device(|device| {
            let mut stream = Stream::new(2, 0);
            let [a, b] = [0; 2].map(|_| picture(&mut stream, [163, 170], &device));
            let same = ms_ssim(a.clone(), a.clone()).expect("numbers").expect("large enough");
            assert!((same - 1.0).abs() < 1e-5, "{same}");
            let other = ms_ssim(a, b).expect("numbers").expect("large enough");
            assert!(other < 0.6 && dissimilarity(other) > 0.2, "{other}");
        });
    }

    const SIZE: [usize; 2] = [17, 23];

    #[test]
    fn a_scale_is_the_definition_for_dark_and_for_bright_flat_pictures() {
        for_each_device(|device| {
            let mut stream = Stream::new(3, 0);
            for (level, contrast) in [(0.0, 1.0), (0.0, 0.004), (0.95, 0.004), (0.996, 0.004)] {
                let [a, b] = [0; 2].map(|_| picture(&mut stream, SIZE, &device) * contrast + level);
                let pictures = [&a, &b].map(|image| values(image.clone()));
                for term in [Term::Contrast, Term::Whole] {
                    let found = values(similarity(&a, &b, term));
                    let wanted = definition(&pictures, term);
                    assert_eq!(found.len(), wanted.len());
                    let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                    assert!(worst < 2e-6, "{term:?} of {level} + {contrast}: {worst}");
                }
            }
        });
    }

    /// The term at each window that is inside, by its definition and in double precision.
    fn definition([a, b]: &[Vec<f64>; 2], term: Term) -> Vec<f64> {
        let [height, width] = SIZE;
        let weights: Vec<f64> = Window::gaussian(11, 1.5).weights().iter().map(|&w| f64::from(w)).collect();
        let mut terms = Vec::new();
        for (channel, y, x) in (0..3)
            .flat_map(|c| (0..height - 10).map(move |y| (c, y)))
            .flat_map(|(c, y)| (0..width - 10).map(move |x| (c, y, x)))
        {
            let mean = |value: &dyn Fn(usize) -> f64| -> f64 {
                let taps = (0..11).flat_map(|i| (0..11).map(move |j| (i, j)));
                taps.map(|(i, j)| weights[i] * weights[j] * value((channel * height + y + i) * width + x + j)).sum()
            };
            let (mean_a, mean_b) = (mean(&|at| a[at]), mean(&|at| b[at]));
            let spread = mean(&|at| (a[at] - mean_a).powi(2) + (b[at] - mean_b).powi(2));
            let common = mean(&|at| (a[at] - mean_a) * (b[at] - mean_b));
            let contrast = (2.0 * common + 9e-4) / (spread + 9e-4);
            terms.push(match term {
                Term::Contrast => contrast,
                Term::Whole => contrast * (2.0 * mean_a * mean_b + 1e-4) / (mean_a.powi(2) + mean_b.powi(2) + 1e-4),
            });
        }
        terms
    }

    #[test]
    fn an_odd_length_is_halved_with_zeros_on_both_sides() {
        for_each_device(|device| {
            let image = Tensor::<4>::from_data(TensorData::new(vec![4.0f32; 6], [1, 1, 2, 3]), &device);
            assert_eq!(values(halved(image)), [2.0, 4.0]);
        });
    }
}
