//! The last pass: the terms of every pixel, and the gradients of both renders.

use mvfusion_kernels::splat::COLOUR_CHANNELS;
use pulp::{Simd, WithSimd};

use super::super::error::{DYNAMIC_PLANES, STATIC_PLANES};
use super::super::pixel::{Blend, COMPARISONS, Layers, PixelTerms, comparison};
use super::{AXES, Compared, DYNAMIC_DEPTH, PICTURES, PREPARED, Pass, STATIC_DEPTH, Sums};
use crate::simd::{Lanes, Wide};

/// A row of the gradients of both renders, each with its two copies.
pub(super) struct GradientRow<'a, T> {
    pub dynamic: [&'a mut [T]; 2 * DYNAMIC_PLANES],
    pub static_: [&'a mut [T]; 2 * STATIC_PLANES],
}

/// The work for one row.
pub(super) struct Finish<'a, T> {
    pub pass: &'a Pass<'a, T>,
    pub prepared: &'a [T],
    pub comparisons: &'a [Compared<T>],
    pub row: usize,
    pub out: Option<GradientRow<'a, T>>,
}

impl<T: Lanes> WithSimd for Finish<'_, T> {
    type Output = Sums;

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) -> Sums {
        let mut sums = Sums::default();
        if self.pass.terms.depth_smooth > 0.0 {
            sums.cost += self.vary_depth();
        }
        for start in (0..self.pass.arguments.size[1]).step_by(Wide::<S, T>::LANES) {
            self.add_pixels(simd, start, &mut sums);
        }
        sums
    }
}

/// The derivative of the absolute value, 0 at 0.
#[inline(always)]
fn sign<T: Lanes>(value: T) -> T {
    let one = |holds: bool| if holds { T::one() } else { T::zero() };
    one(value > T::zero()) - one(value < T::zero())
}

/// The sum of the first `count` lanes, in their order.
#[inline(always)]
fn sum_of<S: Simd, T: Lanes>(values: Wide<S, T>, count: usize) -> f64 {
    let lanes = values.to_lanes();
    let mut sum = 0.0;
    for value in &lanes[..count] {
        sum += value.wide();
    }
    sum
}

impl<'a, T: Lanes> Finish<'a, T> {
    /// The variation of the static depth (METHOD §4.4, term 3). Its gradient is the first part of the row's.
    #[inline(always)]
    fn vary_depth(&mut self) -> f64 {
        let arguments = self.pass.arguments;
        let [height, width] = arguments.size;
        let depth = |row: usize| arguments.row(arguments.static_, STATIC_DEPTH, row);
        let edges = |axis: usize, row: usize| arguments.row(self.prepared, PREPARED - AXES + axis, row);
        let own = depth(self.row);
        let mut cost = 0.0;
        let mut none = Vec::new();
        let v_depth = match &mut self.out {
            Some(out) => &mut *out.static_[STATIC_DEPTH],
            None => {
                none.resize(width, T::zero());
                &mut none
            }
        };
        let right = edges(0, self.row);
        for x in 0..width - 1 {
            let difference = own[x + 1] - own[x];
            let v = right[x] * sign(difference);
            cost += (v * difference).wide();
            v_depth[x] -= v;
            v_depth[x + 1] += v;
        }
        if self.row + 1 < height {
            let (below, down) = (depth(self.row + 1), edges(1, self.row));
            for x in 0..width {
                let difference = below[x] - own[x];
                let v = down[x] * sign(difference);
                cost += (v * difference).wide();
                v_depth[x] -= v;
            }
        }
        if self.row > 0 {
            let (above, down) = (depth(self.row - 1), edges(1, self.row - 1));
            for x in 0..width {
                v_depth[x] += down[x] * sign(own[x] - above[x]);
            }
        }
        cost
    }

    /// The terms of a vector of pixels.
    #[inline(always)]
    fn add_pixels<S: Simd>(&mut self, simd: S, start: usize, sums: &mut Sums) {
        let Pass { arguments, terms, scales } = self.pass;
        let count = (arguments.size[1] - start).min(Wide::<S, T>::LANES);
        let rendered = arguments.layers(simd, self.row, start);
        let layers = arguments.exposed(simd, &rendered);
        let masks = arguments.masks(simd, self.row, start);
        let photo = arguments.colour(simd, arguments.photo, 0, self.row, start);
        let blend = Blend::of(&layers, masks.valid, terms.normalisation);
        let mut found = PixelTerms::of(&blend, &layers, &photo, &masks, terms, scales);
        self.add_comparisons(simd, start, &mut found);
        sums.cost += sum_of(found.cost, count);
        for c in 0..COLOUR_CHANNELS {
            let error = blend.composed[c] - photo[c];
            sums.squared_error += sum_of(error * error, count);
        }
        if self.out.is_none() {
            return;
        }
        let learns = masks.static_region(terms);
        let (control, valid) = (layers.mask[1], masks.valid);
        let mut main = blend.backward(&found.main, control, valid, learns, terms.normalisation);
        let light = blend.backward(&found.light, control, valid, learns, terms.normalisation);
        (main.dynamic_depth, main.static_depth) = (found.dynamic_depth, found.static_depth);
        if arguments.exposure.is_some() {
            add_exposure(sums, &rendered, [&main, &light], count);
        }
        self.store(simd, 0, &main, start);
        self.store(simd, 1, &light, start);
    }

    /// Adds the comparisons: their cost, and the cotangents of their pictures.
    #[inline(always)]
    fn add_comparisons<S: Simd>(&self, simd: S, start: usize, found: &mut PixelTerms<Wide<S, T>>) {
        let arguments = self.pass.arguments;
        for index in 0..COMPARISONS {
            let Some((compared, plane)) = self.compared(index) else { continue };
            let v_map = arguments.plane(simd, self.prepared, PICTURES + index, self.row, start);
            let map = arguments.colour(simd, &compared.map, plane, self.row, start);
            // A difference is 1 - S, with a negative cotangent of S.
            let equal = v_map.value(if index == comparison::STRUCTURE { 0.0 } else { 1.0 });
            for c in 0..COLOUR_CHANNELS {
                found.cost = found.cost + v_map * (map[c] - equal);
            }
            if compared.v_pictures.is_empty() {
                continue;
            }
            let v_picture = arguments.colour(simd, &compared.v_pictures, plane, self.row, start);
            let picture = match index {
                comparison::DYNAMIC | comparison::STRUCTURE => &mut found.main.dynamic,
                comparison::LIT => &mut found.main.lit,
                _ => &mut found.light.composed,
            };
            for c in 0..COLOUR_CHANNELS {
                picture[c] = picture[c] + v_picture[c];
            }
        }
    }

    /// A comparison, if it was made, and its first plane.
    #[inline(always)]
    fn compared(&self, index: usize) -> Option<(&'a Compared<T>, usize)> {
        let pixels = self.pass.arguments.pixels();
        self.comparisons.iter().find_map(|compared| Some((compared, compared.plane(index, pixels)?)))
    }

    /// Writes the gradients of one copy of both renders.
    #[inline(always)]
    fn store<S: Simd>(&mut self, simd: S, copy: usize, layers: &Layers<Wide<S, T>>, start: usize) {
        let arguments = self.pass.arguments;
        let Some(GradientRow { dynamic, static_ }) = &mut self.out else { return };
        let (first, first_static) = (copy * DYNAMIC_PLANES, copy * STATIC_PLANES);
        let dynamic_colour = arguments.before_exposure(simd, &layers.dynamic);
        let static_colour = arguments.before_exposure(simd, &layers.static_);
        for c in 0..COLOUR_CHANNELS {
            dynamic_colour[c].store_up_to_end(dynamic[first + c], start);
            layers.mask[c].store_up_to_end(dynamic[first + COLOUR_CHANNELS + c], start);
            static_colour[c].store_up_to_end(static_[first_static + c], start);
        }
        layers.dynamic_depth.store_up_to_end(dynamic[first + DYNAMIC_DEPTH], start);
        // The variation of depth is already there.
        let depth = &mut *static_[first_static + STATIC_DEPTH];
        let varied = Wide::load_up_to_end(simd, depth, start);
        (varied + layers.static_depth).store_up_to_end(depth, start);
    }
}

/// Adds the gradient of the exposure: that of both branches and both copies.
#[inline(always)]
fn add_exposure<S: Simd, T: Lanes>(
    sums: &mut Sums,
    rendered: &Layers<Wide<S, T>>,
    [main, light]: [&Layers<Wide<S, T>>; 2],
    count: usize,
) {
    for c in 0..COLOUR_CHANNELS {
        let (v_dynamic, v_static) = (main.dynamic[c] + light.dynamic[c], main.static_[c] + light.static_[c]);
        for k in 0..COLOUR_CHANNELS {
            sums.exposure[c][k] += sum_of(v_dynamic * rendered.dynamic[k] + v_static * rendered.static_[k], count);
        }
        sums.exposure[c][COLOUR_CHANNELS] += sum_of(v_dynamic + v_static, count);
    }
}
