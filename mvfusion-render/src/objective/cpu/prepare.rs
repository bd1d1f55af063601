//! The first pass: the pictures that are compared, the cotangents of the comparisons' maps, and the photo's edges.
#![allow(clippy::needless_range_loop, reason = "loops over channels of several arrays are unrolled as they are")]

use mvfusion_kernels::splat::COLOUR_CHANNELS;
use pulp::{Simd, WithSimd};

use super::super::pixel::{Blend, COMPARISONS};
use super::{AXES, PICTURES, PREPARED, Pass};
use crate::simd::{Lanes, Wide};

/// The work for one row.
pub(super) struct Prepare<'a, T> {
    pub pass: &'a Pass<'a, T>,
    pub row: usize,
    pub out: [&'a mut [T]; PREPARED],
}

impl<T: Lanes> WithSimd for Prepare<'_, T> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        for start in (0..self.pass.arguments.size[1]).step_by(Wide::<S, T>::LANES) {
            self.blend(simd, start);
        }
        if self.pass.terms.depth_smooth > 0.0 {
            self.find_edges(simd);
        }
    }
}

impl<'a, T: Lanes> Prepare<'a, T> {
    /// Writes the pictures and the cotangents of a vector of pixels.
    #[inline(always)]
    fn blend<S: Simd>(&mut self, simd: S, start: usize) {
        let Pass { arguments, terms, scales } = self.pass;
        let layers = arguments.exposed(simd, &arguments.layers(simd, self.row, start));
        let masks = arguments.masks(simd, self.row, start);
        let blend = Blend::of(&layers, masks.valid, terms.normalisation);
        for c in 0..COLOUR_CHANNELS {
            blend.dynamic[c].store_up_to_end(self.out[c], start);
            blend.lit[c].store_up_to_end(self.out[COLOUR_CHANNELS + c], start);
            blend.composed[c].store_up_to_end(self.out[2 * COLOUR_CHANNELS + c], start);
        }
        let v_maps = blend.map_cotangents(&masks, terms, scales);
        for comparison in 0..COMPARISONS {
            v_maps[comparison].store_up_to_end(self.out[PICTURES + comparison], start);
        }
    }

    /// Writes the weights of the depth's differences to the right and down: `exp` of minus the photo's mean absolute
    /// difference, times the weight of the term, divided by the extent and the number of differences. Beyond the picture,
    /// they stay zero.
    #[inline(always)]
    fn find_edges<S: Simd>(&mut self, simd: S) {
        let Pass { arguments, terms, .. } = self.pass;
        let [height, width] = arguments.size;
        let weight = terms.depth_smooth / terms.extent;
        let own = self.photo(self.row);
        let [right, down] = [PREPARED - AXES, PREPARED - AXES + 1];
        if width > 1 {
            let scale = T::of(weight / (height * (width - 1)) as f64);
            let next = [&own[0][1..], &own[1][1..], &own[2][1..]];
            weigh_edges(simd, &mut self.out[right][..width - 1], own.map(|row| &row[..width - 1]), next, scale);
        }
        if self.row + 1 < height {
            let scale = T::of(weight / ((height - 1) * width) as f64);
            weigh_edges(simd, self.out[down], own, self.photo(self.row + 1), scale);
        }
    }

    /// A row of the photo.
    #[inline(always)]
    fn photo(&self, row: usize) -> [&'a [T]; COLOUR_CHANNELS] {
        let arguments = self.pass.arguments;
        [0, 1, 2].map(|c| arguments.row(arguments.photo, c, row))
    }
}

/// `scale` times `exp` of minus the mean absolute difference of two rows of pixels.
#[inline(always)]
fn weigh_edges<S: Simd, T: Lanes>(
    simd: S,
    weights: &mut [T],
    a: [&[T]; COLOUR_CHANNELS],
    b: [&[T]; COLOUR_CHANNELS],
    scale: T,
) {
    let (scale, zero) = (Wide::splat(simd, scale), Wide::splat(simd, T::zero()));
    let share = zero.value(1.0 / COLOUR_CHANNELS as f64);
    for start in (0..weights.len()).step_by(Wide::<S, T>::LANES) {
        let mut difference = zero;
        for c in 0..COLOUR_CHANNELS {
            let signed = Wide::load_up_to_end(simd, b[c], start) - Wide::load_up_to_end(simd, a[c], start);
            difference = difference + signed.max(zero - signed);
        }
        (scale * (zero - difference * share).exp()).store_up_to_end(weights, start);
    }
}
