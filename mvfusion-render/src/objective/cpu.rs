//! CPU twin of the objective: prepare the pictures, compare them in windows, collect the terms and their gradients. Rows
//! are independent, and their sums are added in order, so that results do not depend on the number of threads. Within a
//! row, sums are formed vector by vector: their last bits depend on the width of a vector.
//!
//! Code on vectors has plain loops instead of closures, which the compiler would leave without the instruction set.
#![allow(clippy::needless_range_loop, reason = "loops over channels of several arrays are unrolled as they are")]

mod finish;
mod prepare;

use mvfusion_kernels::splat::{COLOUR_CHANNELS, alpha_plane, channel_count};
use pulp::{Arch, Simd};
use rayon::prelude::*;

use self::finish::{Finish, GradientRow};
use self::prepare::Prepare;
use super::ObjectiveTerms;
use super::error::{DYNAMIC_PLANES, STATIC_PLANES};
use super::pixel::{COMPARISONS, Colour, Layers, Masks, Scales, comparison};
use crate::simd::{Lanes, Wide};
use crate::window::Window;
use crate::window::cpu::{weighted_backward, weighted_similarity};
use crate::window::similarity::Similarity;

/// Minimum number of rows per task.
const MIN_ROWS: usize = 4;

/// Columns of an exposure: three factors and an offset.
const EXPOSURE_COLUMNS: usize = COLOUR_CHANNELS + 1;

/// Depth planes of the packed renders.
const DYNAMIC_DEPTH: usize = alpha_plane(channel_count(3)) + 1;
const STATIC_DEPTH: usize = alpha_plane(channel_count(0)) + 1;

/// Planes of the three pictures that are compared: dynamic, lit, composed.
const PICTURES: usize = 3 * COLOUR_CHANNELS;

/// Edge weights of the photo, to the right and down.
const AXES: usize = 2;

/// The planes that the first pass writes: the pictures, the cotangents of the comparisons' maps, the edge weights.
const PREPARED: usize = PICTURES + COMPARISONS + AXES;

/// The values of the arguments. A mask is absent if it selects every pixel (`valid`) or none.
pub(super) struct Arguments<'a, T> {
    pub dynamic: &'a [T],
    pub static_: &'a [T],
    pub exposure: Option<&'a [T]>,
    pub photo: &'a [T],
    pub valid: Option<&'a [T]>,
    pub moving: Option<&'a [T]>,
    pub around: Option<&'a [T]>,
    /// Height, width.
    pub size: [usize; 2],
}

/// The loss and the mean squared error, and the gradients of the loss if they are wanted.
pub(super) struct Outcome<T> {
    pub values: [T; 2],
    pub gradients: Option<Gradients<T>>,
}

/// The gradients with respect to both renders and to the exposure.
pub(super) struct Gradients<T> {
    pub dynamic: Vec<T>,
    pub static_: Vec<T>,
    pub exposure: Vec<T>,
}

/// Computes the objective.
pub(super) fn objective<T: Lanes>(arguments: &Arguments<'_, T>, terms: &ObjectiveTerms, wanted: bool) -> Outcome<T> {
    let pixels = arguments.pixels();
    let pass = Pass { arguments, terms, scales: Scales::new(terms, pixels) };
    let prepared = pass.prepare();
    let comparisons = pass.compare(&prepared, wanted);
    let zeros = |planes: usize| vec![T::zero(); 2 * planes * pixels];
    let mut renders = wanted.then(|| [zeros(DYNAMIC_PLANES), zeros(STATIC_PLANES)]);
    let sums = pass.finish(&prepared, &comparisons, renders.as_mut());
    let gradients = renders.map(|[dynamic, static_]| {
        let exposure = sums.exposure.into_iter().flatten().map(T::of).collect();
        Gradients { dynamic, static_, exposure }
    });
    let squared_error = sums.squared_error / (COLOUR_CHANNELS * pixels) as f64;
    Outcome { values: [sums.cost, squared_error].map(T::of), gradients }
}

impl<T: Lanes> Arguments<'_, T> {
    fn pixels(&self) -> usize {
        self.size[0] * self.size[1]
    }

    /// A row of a plane.
    #[inline(always)]
    fn row<'a>(&self, planes: &'a [T], plane: usize, row: usize) -> &'a [T] {
        let [height, width] = self.size;
        &planes[(plane * height + row) * width..][..width]
    }

    /// Pixels of a row of three planes.
    #[inline(always)]
    fn colour<S: Simd>(&self, simd: S, planes: &[T], first: usize, row: usize, start: usize) -> Colour<Wide<S, T>> {
        let mut colour = [Wide::splat(simd, T::zero()); COLOUR_CHANNELS];
        for c in 0..COLOUR_CHANNELS {
            colour[c] = self.plane(simd, planes, first + c, row, start);
        }
        colour
    }

    /// Pixels of a row of a plane.
    #[inline(always)]
    fn plane<S: Simd>(&self, simd: S, planes: &[T], plane: usize, row: usize, start: usize) -> Wide<S, T> {
        Wide::load_up_to_end(simd, self.row(planes, plane, row), start)
    }

    #[inline(always)]
    fn masks<S: Simd>(&self, simd: S, row: usize, start: usize) -> Masks<Wide<S, T>> {
        let (everywhere, nowhere) = (Wide::splat(simd, T::one()), Wide::splat(simd, T::zero()));
        let mut masks = Masks { valid: everywhere, moving: nowhere, around: nowhere };
        if let Some(valid) = self.valid {
            masks.valid = self.plane(simd, valid, 0, row, start);
        }
        if let Some(moving) = self.moving {
            masks.moving = self.plane(simd, moving, 0, row, start);
        }
        if let Some(around) = self.around {
            masks.around = self.plane(simd, around, 0, row, start);
        }
        masks
    }

    /// The layers of pixels, before the exposure.
    #[inline(always)]
    fn layers<S: Simd>(&self, simd: S, row: usize, start: usize) -> Layers<Wide<S, T>> {
        Layers {
            dynamic: self.colour(simd, self.dynamic, 0, row, start),
            mask: self.colour(simd, self.dynamic, COLOUR_CHANNELS, row, start),
            dynamic_depth: self.plane(simd, self.dynamic, DYNAMIC_DEPTH, row, start),
            static_: self.colour(simd, self.static_, 0, row, start),
            static_depth: self.plane(simd, self.static_, STATIC_DEPTH, row, start),
        }
    }

    /// The layers as the camera of the view shows them.
    #[inline(always)]
    fn exposed<S: Simd>(&self, simd: S, layers: &Layers<Wide<S, T>>) -> Layers<Wide<S, T>> {
        let Some(exposure) = self.exposure else { return *layers };
        let mut exposed = *layers;
        for c in 0..COLOUR_CHANNELS {
            let offset = Wide::splat(simd, exposure[c * EXPOSURE_COLUMNS + COLOUR_CHANNELS]);
            (exposed.dynamic[c], exposed.static_[c]) = (offset, offset);
            for k in 0..COLOUR_CHANNELS {
                let factor = Wide::splat(simd, exposure[c * EXPOSURE_COLUMNS + k]);
                exposed.dynamic[c] = exposed.dynamic[c] + factor * layers.dynamic[k];
                exposed.static_[c] = exposed.static_[c] + factor * layers.static_[k];
            }
        }
        exposed
    }

    /// The cotangent of a colour before the exposure.
    #[inline(always)]
    fn before_exposure<S: Simd>(&self, simd: S, v_exposed: &Colour<Wide<S, T>>) -> Colour<Wide<S, T>> {
        let Some(exposure) = self.exposure else { return *v_exposed };
        let mut colour = [Wide::splat(simd, T::zero()); COLOUR_CHANNELS];
        for c in 0..COLOUR_CHANNELS {
            for k in 0..COLOUR_CHANNELS {
                colour[k] = colour[k] + Wide::splat(simd, exposure[c * EXPOSURE_COLUMNS + k]) * v_exposed[c];
            }
        }
        colour
    }
}

/// What all rows share.
struct Pass<'a, T> {
    arguments: &'a Arguments<'a, T>,
    terms: &'a ObjectiveTerms,
    scales: Scales<T>,
}

/// The maps of neighbouring comparisons, and the cotangents of their pictures. Both have three planes per comparison.
struct Compared<T> {
    first: usize,
    map: Vec<T>,
    /// Empty if gradients are not wanted.
    v_pictures: Vec<T>,
}

impl<T> Compared<T> {
    /// The first plane of a comparison; `None` if it is another's.
    fn plane(&self, comparison: usize, pixels: usize) -> Option<usize> {
        let plane = comparison.checked_sub(self.first)? * COLOUR_CHANNELS;
        (plane * pixels < self.map.len()).then_some(plane)
    }
}

/// Sums over pixels.
#[derive(Clone, Copy, Default)]
struct Sums {
    cost: f64,
    squared_error: f64,
    exposure: [[f64; EXPOSURE_COLUMNS]; COLOUR_CHANNELS],
}

impl Sums {
    fn add(&mut self, other: &Self) {
        self.cost += other.cost;
        self.squared_error += other.squared_error;
        for (own, other) in self.exposure.iter_mut().flatten().zip(other.exposure.iter().flatten()) {
            *own += other;
        }
    }
}

impl<T: Lanes> Pass<'_, T> {
    /// The planes of [`PREPARED`].
    fn prepare(&self) -> Vec<T> {
        let mut prepared = vec![T::zero(); PREPARED * self.arguments.pixels()];
        let arch = Arch::new();
        let rows = plane_rows::<T, PREPARED>(&mut prepared, self.arguments.size).into_par_iter();
        rows.with_min_len(MIN_ROWS).enumerate().for_each(|(row, out)| arch.dispatch(Prepare { pass: self, row, out }));
        prepared
    }

    /// The comparisons that have a weight.
    fn compare(&self, prepared: &[T], wanted: bool) -> Vec<Compared<T>> {
        let pixels = self.arguments.pixels();
        let first = if self.terms.branch_similarity() { comparison::DYNAMIC } else { comparison::COMPOSED };
        let end = if self.terms.composed_dssim > 0.0 { comparison::COMPOSED + 1 } else { comparison::COMPOSED };
        let mut found = Vec::new();
        if first < end {
            let pictures = &prepared[first * COLOUR_CHANNELS * pixels..end * COLOUR_CHANNELS * pixels];
            let photos = self.arguments.photo.repeat(end - first);
            let work = Comparison { kind: Similarity::Ssim, window: &self.terms.ssim, comparisons: [first, end] };
            found.push(work.compare(self, [pictures, &photos], prepared, wanted));
        }
        if self.terms.likeness > 0.0 {
            let (dynamic, rest) = prepared.split_at(COLOUR_CHANNELS * pixels);
            let pair = [dynamic, &rest[..COLOUR_CHANNELS * pixels]];
            let comparisons = [comparison::STRUCTURE, comparison::STRUCTURE + 1];
            let work = Comparison { kind: Similarity::Structure, window: &self.terms.structure, comparisons };
            found.push(work.compare(self, pair, prepared, wanted));
        }
        found
    }

    /// Sums the terms, and writes the gradients of both renders if there is room for them.
    fn finish(&self, prepared: &[T], comparisons: &[Compared<T>], renders: Option<&mut [Vec<T>; 2]>) -> Sums {
        let size = self.arguments.size;
        let rows: Vec<Option<GradientRow<'_, T>>> = match renders {
            Some([dynamic, static_]) => {
                let pairs = plane_rows(dynamic, size).into_iter().zip(plane_rows(static_, size));
                pairs.map(|(dynamic, static_)| Some(GradientRow { dynamic, static_ })).collect()
            }
            None => (0..size[0]).map(|_| None).collect(),
        };
        let arch = Arch::new();
        let finish = |(row, out)| arch.dispatch(Finish { pass: self, prepared, comparisons, row, out });
        let sums: Vec<Sums> = rows.into_par_iter().with_min_len(MIN_ROWS).enumerate().map(finish).collect();
        let mut total = Sums::default();
        sums.iter().for_each(|sum| total.add(sum));
        total
    }
}

/// Neighbouring comparisons of one kind.
struct Comparison<'a> {
    kind: Similarity,
    window: &'a Window,
    /// The first, and one past the last.
    comparisons: [usize; 2],
}

impl Comparison<'_> {
    fn compare<T: Lanes>(&self, pass: &Pass<'_, T>, pair: [&[T]; 2], prepared: &[T], wanted: bool) -> Compared<T> {
        let [first, end] = self.comparisons;
        let (pixels, size) = (pass.arguments.pixels(), pass.arguments.size);
        let cotangents = prepared[PICTURES * pixels..].chunks(pixels).take(end).skip(first);
        let cotangents = cotangents.flat_map(|plane| [plane; COLOUR_CHANNELS]).collect::<Vec<_>>().concat();
        let [map, mean, square, cross] = weighted_similarity(self.kind, pair, &cotangents, size, self.window);
        let v_pictures = match wanted {
            true => weighted_backward(pair, [&mean, &square, &cross], size, self.window),
            false => Vec::new(),
        };
        Compared { first, map, v_pictures }
    }
}

/// The rows of several planes of the same size: one array per row.
fn plane_rows<T, const P: usize>(planes: &mut [T], [height, width]: [usize; 2]) -> Vec<[&mut [T]; P]> {
    let mut planes = planes.chunks_mut(height * width).map(|plane| plane.chunks_mut(width));
    // Proof: there are `P` planes of `height` rows each.
    let mut rows: [_; P] = std::array::from_fn(|_| planes.next().expect("a plane"));
    (0..height).map(|_| rows.each_mut().map(|rows| rows.next().expect("a row"))).collect()
}
