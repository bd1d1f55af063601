//! What the tests of this crate share: the compiled devices, numbers in and out of tensors.

use burn::tensor::{DType, Device, Tensor};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

/// Runs a test body on every CPU device that was compiled in.
pub(crate) fn for_each_device(body: impl Fn(Device)) {
    #[cfg(feature = "flex")]
    body(crate::device::flex());
    #[cfg(feature = "ndarray")]
    body(crate::device::ndarray());
}

/// `count` numbers in `0..1`.
pub(crate) fn random(seed: u64, count: usize) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    (0..count).map(|_| rng.random()).collect()
}

/// The numbers of a tensor, row-major, in double precision.
pub(crate) fn numbers<const D: usize>(tensor: Tensor<D>) -> Vec<f64> {
    tensor.cast(DType::F64).into_data().try_into_vec().expect("the cast made them f64")
}
