//! Every op on every backend against the first CPU backend: results and gradients, from nothing to 200,000 rows.

#[cfg(any(feature = "wgpu", feature = "cuda"))]
mod gpu;
mod ops;
mod photos;
mod pictures;

use anyhow::{Result, ensure};
use burn::tensor::{DType, Device, Tensor};
use libtest_mimic::Trial;
use mvfusion_model::random::Stream;
use mvfusion_tests::{Backend, Checklist, backends, tensor};

use ops::{CASES, Case};
use pictures::{SCENES, Scene, compare_pictures};

/// Two backends, of which the second is right.
#[derive(Clone, Copy)]
struct Pair {
    backend: Backend,
    reference: Backend,
}

/// One trial an op, for each backend but the one that all are compared with.
pub fn trials(backend: Backend) -> Vec<Trial> {
    let Some(reference) = backends().into_iter().next().filter(|first| first.name != backend.name) else {
        return Vec::new();
    };
    let pair = Pair { backend, reference };
    let ops = CASES.iter().map(|&(name, case)| pair.trial(name, move || pair.compare(case)));
    let pictures =
        SCENES.iter().map(|scene| pair.trial(&format!("splat::{}", scene.name), move || pair.compare_scene(scene)));
    let trials = ops.chain(pictures);
    #[cfg(any(feature = "wgpu", feature = "cuda"))]
    let trials = trials.chain(gpu::trials(pair));
    trials.collect()
}

impl Pair {
    fn trial(self, name: &str, body: impl FnOnce() -> Result<()> + Send + 'static) -> Trial {
        Trial::test(format!("parity::{}::{name}", self.backend.name), move || {
            body().map_err(|error| format!("{error:#}").into())
        })
    }

    fn compare(self, case: Case) -> Result<()> {
        let (found, wanted) = (case(&device(self.backend))?, case(&device(self.reference))?);
        ensure!(found.len() == wanted.len(), "{} results, expected {}", found.len(), wanted.len());
        let mut checks = Checklist::default();
        for ((name, found, _), (_, wanted, tolerance)) in found.iter().zip(&wanted) {
            checks.close(name, wanted, found, *tolerance);
        }
        checks.finish()
    }

    fn compare_scene(self, scene: &Scene) -> Result<()> {
        compare_pictures(scene, &device(self.backend), &device(self.reference))
    }
}

fn device(backend: Backend) -> Device {
    (backend.device)().autodiff()
}

/// A leaf of normal numbers.
fn normal<const D: usize>(shape: [usize; D], scale: f64, seed: u64, device: &Device) -> Tensor<D> {
    let mut stream = Stream::new(seed, 7);
    let values: Vec<f64> = (0..shape.iter().product()).map(|_| scale * stream.normal()).collect();
    leaf(tensor(&values, shape, device, DType::F32))
}

/// A tensor that is tracked if its device tracks gradients.
fn leaf<const D: usize>(tensor: Tensor<D>) -> Tensor<D> {
    if tensor.is_autodiff() { tensor.require_grad() } else { tensor }
}

/// A leaf of numbers in `low..high`.
fn uniform<const D: usize>(shape: [usize; D], range: [f64; 2], seed: u64, device: &Device) -> Tensor<D> {
    let mut stream = Stream::new(seed, 8);
    let values: Vec<f64> = (0..shape.iter().product()).map(|_| stream.uniform(range[0], range[1])).collect();
    leaf(tensor(&values, shape, device, DType::F32))
}

/// The loss of a result under random weights.
fn weighed<const D: usize>(result: &Tensor<D>, seed: u64) -> Tensor<1> {
    let weights = normal(result.dims(), 1.0, seed, &result.device()).inner();
    (result.clone() * Tensor::from_inner(weights)).sum()
}
