//! The moments of a Gaussian's cotangents over a tile, and its gradients from them. GPU twin: `cube/moments.rs`.

use mvfusion_kernels::splat::{ProjectedGradient, TILE};

use super::blend::Staged;
use super::lanes::{Lane, Vectors, columns, from_middle, sum_vector};

/// Sums of 1, y, y² over the rows of one half of a tile, one lane per column.
pub(super) struct Columns<V> {
    sums: [V; 3],
    counted: [V; 2],
}

impl<V: Copy> Columns<V> {
    #[inline(always)]
    pub(super) fn new<T: Lane, X: Vectors<T, V = V>>(x: X) -> Self {
        let zero = x.splat(T::zero());
        Self { sums: [zero; 3], counted: [zero; 2] }
    }

    #[inline(always)]
    pub(super) fn add<T: Lane, X: Vectors<T, V = V>>(&mut self, x: X, v: V, row: usize) {
        let y = from_middle::<T>(row);
        let [one, first, second] = self.sums;
        self.sums = [x.add(one, v), x.fma(v, x.splat(y), first), x.fma(v, x.splat(y * y), second)];
    }

    #[inline(always)]
    pub(super) fn add_counted<T: Lane, X: Vectors<T, V = V>>(&mut self, x: X, v: V, row: usize) {
        let [one, first] = self.counted;
        self.counted = [x.add(one, v), x.fma(v, x.splat(from_middle::<T>(row)), first)];
    }
}

/// Moments of the gradient of `sigma` (up to the factor `-opacity`) about the middle of the tile, one per lane.
pub(super) struct Moments<V> {
    one: V,
    x: V,
    y: V,
    xx: V,
    xy: V,
    yy: V,
    /// Moments 1, x, y of the statistic.
    counted: [V; 3],
}

impl<V: Copy> Moments<V> {
    #[inline(always)]
    pub(super) fn new<T: Lane, X: Vectors<T, V = V>>(x: X) -> Self {
        let zero = x.splat(T::zero());
        Self { one: zero, x: zero, y: zero, xx: zero, xy: zero, yy: zero, counted: [zero; 3] }
    }

    #[inline(always)]
    pub(super) fn add_half<T: Lane, X: Vectors<T, V = V>>(&mut self, x: X, sums: &Columns<V>, half: usize) {
        let [one, y, yy] = sums.sums;
        let place = x.sub(x.load(&columns(half)), x.splat(T::of((TILE as f64 - 1.0) / 2.0)));
        self.one = x.add(self.one, one);
        self.x = x.fma(one, place, self.x);
        self.xx = x.fma(one, x.mul(place, place), self.xx);
        self.y = x.add(self.y, y);
        self.xy = x.fma(y, place, self.xy);
        self.yy = x.add(self.yy, yy);
        let [one, y] = sums.counted;
        let [sum, sum_x, sum_y] = self.counted;
        self.counted = [x.add(sum, one), x.fma(one, place, sum_x), x.add(sum_y, y)];
    }

    /// Gradients of centre, covariance and opacity. With `d = pixel - centre`, `u = dx + slope dy` and
    /// `g = d sigma / d d = (curve_x u, slope curve_x u + curve_y dy)`, sigma has the gradient `-g` with respect to the
    /// centre; with `w = (√curve_x u, √curve_y dy)`, it has `-w wᵀ / 2` with respect to the whitened covariance.
    #[inline(always)]
    pub(super) fn gradient<T: Lane, X: Vectors<T, V = V>>(
        &self,
        vectors: X,
        splat: &Staged<T>,
        counted: bool,
    ) -> ProjectedGradient<T> {
        // No closures over vectors here: they would be compiled without the instruction set of the caller.
        let (one, x, y) = (sum_vector(vectors, self.one), sum_vector(vectors, self.x), sum_vector(vectors, self.y));
        let (xx, xy, yy) = (sum_vector(vectors, self.xx), sum_vector(vectors, self.xy), sum_vector(vectors, self.yy));
        let middle = T::of((TILE as f64 - 1.0) / 2.0);
        let (two, half, slope) = (T::of(2.0), T::of(0.5), splat.slope);
        let (curve_x, curve_y) = (two * splat.half_curve_x, two * splat.half_curve_y);
        let middle_y = splat.first[1] + middle;
        let middle_u = splat.first[0] + middle + slope * middle_y;
        let centre = |one: T, x: T, y: T| {
            let (u, dy) = (x + slope * y + middle_u * one, y + middle_y * one);
            let along = curve_x * u;
            [splat.opacity * along, splat.opacity * (slope * along + curve_y * dy)]
        };
        // Sums of u, dy, u², u dy and dy².
        let u = x + slope * y + middle_u * one;
        let uu = xx + slope * (two * xy + slope * yy) + middle_u * (two * (x + slope * y) + middle_u * one);
        let u_dy = xy + slope * yy + middle_u * y + middle_y * u;
        let dy_dy = yy + middle_y * (two * y + middle_y * one);
        let statistic = if counted {
            let [one, x, y] = self.counted;
            centre(sum_vector(vectors, one), sum_vector(vectors, x), sum_vector(vectors, y))
        } else {
            centre(one, x, y)
        };
        ProjectedGradient {
            centre: centre(one, x, y),
            whitened: [
                half * splat.opacity * curve_x * uu,
                splat.opacity * curve_x.sqrt() * curve_y.sqrt() * u_dy,
                half * splat.opacity * curve_y * dy_dy,
            ],
            opacity: one,
            statistic,
        }
    }
}
