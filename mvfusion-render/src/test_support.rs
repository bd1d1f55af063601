//! Helpers for the tests of this crate: the compiled devices, and values in and out of tensors.

use burn::tensor::{DType, Device, Tensor};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Runs a test body on every CPU device of this build.
pub(crate) fn for_each_device(body: impl Fn(Device)) {
    #[cfg(feature = "flex")]
    body(crate::device::flex());
    #[cfg(feature = "ndarray")]
    body(crate::device::ndarray());
}

/// Two devices between which nothing is shared.
#[cfg(all(feature = "flex", feature = "ndarray"))]
pub(crate) fn two_devices() -> [Device; 2] {
    [crate::device::flex(), crate::device::ndarray()]
}

/// `count` random numbers in `0..1`.
pub(crate) fn random(seed: u64, count: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| rng.random()).collect()
}

/// The values of a tensor, row-major, in double precision.
pub(crate) fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.cast(DType::F64).into_data().try_into_vec().expect("the cast made them f64")
}

/// Asserts that results and gradients agree, each relative to its largest value.
pub(crate) fn assert_parts_close(found: &[Vec<f64>; 3], wanted: &[Vec<f64>; 3], tolerance: f64, what: &str) {
    for (part, (found, wanted)) in found.iter().zip(wanted).enumerate() {
        assert_eq!(found.len(), wanted.len(), "{what}, part {part}");
        let largest = wanted.iter().fold(0.0f64, |largest, x| largest.max(x.abs()));
        let worst = found.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(worst <= tolerance * largest, "{what}, part {part}: off by {worst}, the largest is {largest}");
    }
}
