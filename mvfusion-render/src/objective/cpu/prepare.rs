//! The first pass: the pictures that are compared, the cotangents of the comparisons' maps, and the photo's edges.

use mvfusion_kernels::splat::COLOUR_CHANNELS;
use pulp::{Simd, WithSimd};

use super::super::pixel::Blend;
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
            self.find_edges();
        }
    }
}

impl<T: Lanes> Prepare<'_, T> {
    /// Writes the pictures and the cotangents of a vector of pixels.
    #[inline(always)]
    fn blend<S: Simd>(&mut self, simd: S, start: usize) {
        let Pass { arguments, terms, scales } = self.pass;
        let layers = arguments.exposed(simd, &arguments.layers(simd, self.row, start));
        let masks = arguments.masks(simd, self.row, start);
        let blend = Blend::of(&layers, masks.valid, terms.normalisation);
        for (picture, colour) in [blend.dynamic, blend.lit, blend.composed].into_iter().enumerate() {
            for (c, value) in colour.into_iter().enumerate() {
                value.store_up_to_end(self.out[picture * COLOUR_CHANNELS + c], start);
            }
        }
        for (comparison, v_map) in blend.map_cotangents(&masks, terms, scales).into_iter().enumerate() {
            v_map.store_up_to_end(self.out[PICTURES + comparison], start);
        }
    }

    /// Writes the weights of the depth's differences to the right and down: `exp` of minus the photo's mean absolute
    /// difference, times the weight of the term, divided by the extent and the number of differences. Beyond the picture,
    /// they stay zero.
    #[inline(always)]
    fn find_edges(&mut self) {
        let Pass { arguments, terms, .. } = self.pass;
        let [height, width] = arguments.size;
        let rows = |row: usize| [0, 1, 2].map(|c| arguments.row(arguments.photo, c, row));
        let scale = |differences: usize| T::of(terms.depth_smooth / terms.extent / differences as f64);
        let weight = |a: [T; COLOUR_CHANNELS], b: [T; COLOUR_CHANNELS]| {
            let difference = (b[0] - a[0]).abs() + (b[1] - a[1]).abs() + (b[2] - a[2]).abs();
            (-difference / T::of(COLOUR_CHANNELS as f64)).exp()
        };
        let own = rows(self.row);
        let at = |rows: [&[T]; COLOUR_CHANNELS], x: usize| rows.map(|row| row[x]);
        let [right, down] = [0, 1].map(|axis| PREPARED - AXES + axis);
        if width > 1 {
            let scale = scale(height * (width - 1));
            for x in 0..width - 1 {
                self.out[right][x] = scale * weight(at(own, x), at(own, x + 1));
            }
        }
        if self.row + 1 < height {
            let (scale, below) = (scale((height - 1) * width), rows(self.row + 1));
            for x in 0..width {
                self.out[down][x] = scale * weight(at(own, x), at(below, x));
            }
        }
    }
}
