//! The discrete Fourier transform of a power of two of numbers.
//!
//! It is ours because the crates for it ask for features of `num-integer` that nothing else does, and every tensor
//! library below the other crates would be compiled with them.

use std::f64::consts::TAU;

/// A complex number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Complex(pub(super) f32, pub(super) f32);

impl Complex {
    pub(super) fn conjugate(self) -> Self {
        Self(self.0, -self.1)
    }

    pub(super) fn times(self, other: Self) -> Self {
        Self(self.0 * other.0 - self.1 * other.1, self.0 * other.1 + self.1 * other.0)
    }

    /// The number of length one in the same direction; zero stays zero.
    pub(super) fn whitened(self) -> Self {
        let norm = self.0.hypot(self.1);
        if norm > f32::MIN_POSITIVE { Self(self.0 / norm, self.1 / norm) } else { Self(0.0, 0.0) }
    }

    fn plus(self, other: Self) -> Self {
        Self(self.0 + other.0, self.1 + other.1)
    }

    fn minus(self, other: Self) -> Self {
        Self(self.0 - other.0, self.1 - other.1)
    }
}

/// The sign of the exponents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Direction {
    Forward,
    /// Without the division by the length.
    Backward,
}

/// Transforms numbers in place (Cooley and Tukey 1965, radix 2). Their count must be a power of two.
pub(super) fn transform(values: &mut [Complex], direction: Direction) {
    let length = values.len();
    debug_assert!(length.is_power_of_two());
    if length < 2 {
        return;
    }
    let shift = usize::BITS - length.trailing_zeros();
    for index in 0..length {
        let mirrored = index.reverse_bits() >> shift;
        if index < mirrored {
            values.swap(index, mirrored);
        }
    }
    let sign = if direction == Direction::Forward { -1.0 } else { 1.0 };
    // Each from its own angle, in f64: products of roots would gather errors.
    let root = |index: usize| {
        let (sine, cosine) = (sign * TAU * index as f64 / length as f64).sin_cos();
        Complex(cosine as f32, sine as f32)
    };
    let roots: Vec<Complex> = (0..length / 2).map(root).collect();
    let mut half = 1;
    while half < length {
        let stride = length / (2 * half);
        for block in values.chunks_exact_mut(2 * half) {
            let (even, odd) = block.split_at_mut(half);
            for ((a, b), index) in even.iter_mut().zip(odd).zip(0..) {
                let turned = b.times(roots[index * stride]);
                (*a, *b) = (a.plus(turned), a.minus(turned));
            }
        }
        half *= 2;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_the_sum_of_its_definition_and_goes_back() {
        let values: Vec<Complex> = (0..16).map(|i| Complex((i * i % 7) as f32, (3 * i % 5) as f32)).collect();
        let mut found = values.clone();
        transform(&mut found, Direction::Forward);
        for (k, value) in found.iter().enumerate() {
            let term = |(n, v): (usize, &Complex)| {
                let (sine, cosine) = (-TAU * (k * n) as f64 / 16.0).sin_cos();
                v.times(Complex(cosine as f32, sine as f32))
            };
            let sum = values.iter().enumerate().map(term).fold(Complex(0.0, 0.0), Complex::plus);
            assert!(value.minus(sum).0.hypot(value.minus(sum).1) < 1e-4, "{k}: {value:?} {sum:?}");
        }
        transform(&mut found, Direction::Backward);
        assert!(
            found.iter().zip(&values).all(|(a, b)| (a.0 / 16.0 - b.0).abs() < 1e-5 && (a.1 / 16.0 - b.1).abs() < 1e-5)
        );
    }
}
