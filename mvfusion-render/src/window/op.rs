//! The window ops as Burn backend extensions.

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::{Shape, Tensor};

use super::similarity::Similarity;
use super::{Window, cpu};
use crate::host::HostBackend;
use crate::real::with_real;

/// The separable blur and the similarity maps.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait WindowOps: Backend {
    /// Blurs `images` `[B, C, H, W]`.
    fn window_blur(images: FloatTensor<Self>, window: Window) -> FloatTensor<Self>;

    /// The similarity of `a` and `b`, both `[B, C, H, W]`, at each pixel.
    fn window_similarity(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        window: Window,
        kind: Similarity,
    ) -> FloatTensor<Self>;
}

/// The adjoint of the similarity; only on backends without autodiff.
pub(crate) trait SimilarityAdjoint: WindowOps {
    /// The map and its derivatives.
    fn window_similarity_tracked(
        pair: Pair<Self>,
        window: Window,
        kind: Similarity,
    ) -> (FloatTensor<Self>, Slopes<Self>);

    /// The adjoints of the two images.
    fn window_similarity_backward(
        pair: Pair<Self>,
        slopes: Slopes<Self>,
        v_map: FloatTensor<Self>,
        window: Window,
    ) -> Pair<Self>;
}

/// Two images, or their adjoints.
#[derive(Clone, Debug)]
pub(crate) struct Pair<B: Backend> {
    pub a: FloatTensor<B>,
    pub b: FloatTensor<B>,
}

/// The derivatives of a similarity with respect to the windowed moments mean a, mean b, mean a² + b² and mean ab. A CPU
/// has four maps in this order, a GPU one with its kernels' order.
#[derive(Clone, Debug)]
pub(crate) struct Slopes<B: Backend>(pub Vec<FloatTensor<B>>);

fn size_of(shape: &Shape) -> [usize; 2] {
    [shape[2], shape[3]]
}

impl<B: HostBackend> WindowOps for B {
    fn window_blur(images: FloatTensor<Self>, window: Window) -> FloatTensor<Self> {
        let shape = images.shape();
        with_real!(images.dtype(), T => {
            B::tensor(cpu::blur(&B::values::<T>(images), size_of(&shape), &window), shape)
        })
    }

    fn window_similarity(a: FloatTensor<B>, b: FloatTensor<B>, window: Window, kind: Similarity) -> FloatTensor<B> {
        let shape = a.shape();
        with_real!(a.dtype(), T => {
            let (a, b) = (B::values::<T>(a), B::values::<T>(b));
            B::tensor(cpu::similarity(kind, [&a, &b], size_of(&shape), &window), shape)
        })
    }
}

impl<B: HostBackend> SimilarityAdjoint for B {
    fn window_similarity_tracked(pair: Pair<B>, window: Window, kind: Similarity) -> (FloatTensor<B>, Slopes<B>) {
        let shape = pair.a.shape();
        with_real!(pair.a.dtype(), T => {
            let (a, b) = (B::values::<T>(pair.a), B::values::<T>(pair.b));
            let maps = cpu::similarity_with_slopes(kind, [&a, &b], size_of(&shape), &window);
            let [map, mean_a, mean_b, square, cross] = maps.map(|map| B::tensor(map, shape.clone()));
            (map, Slopes(vec![mean_a, mean_b, square, cross]))
        })
    }

    fn window_similarity_backward(pair: Pair<B>, slopes: Slopes<B>, v_map: FloatTensor<B>, window: Window) -> Pair<B> {
        let shape = v_map.shape();
        with_real!(v_map.dtype(), T => {
            let (a, b, v_map) = (B::values::<T>(pair.a), B::values::<T>(pair.b), B::values::<T>(v_map));
            let slopes: Vec<B::Values<T>> = slopes.0.into_iter().map(B::values::<T>).collect();
            let slopes = [0, 1, 2, 3].map(|moment| &slopes[moment][..]);
            let adjoints = cpu::similarity_backward([&a, &b], slopes, &v_map, size_of(&shape), &window);
            let [a, b] = adjoints.map(|adjoint| B::tensor(adjoint, shape.clone()));
            Pair { a, b }
        })
    }
}

#[derive(Debug)]
struct BlurBackward;

impl<B: WindowOps> Backward<B, 1> for BlurBackward {
    type State = Window;

    fn backward(self, ops: Ops<Window, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let v_blurred = gradients.consume::<B>(&ops.node);
        let [images] = ops.parents;
        if let Some(node) = images {
            gradients.register::<B>(node.id, B::window_blur(v_blurred, ops.state));
        }
    }
}

#[derive(Debug)]
struct SimilarityBackward;

impl<B: SimilarityAdjoint> Backward<B, 2> for SimilarityBackward {
    type State = (Pair<B>, Slopes<B>, Window);

    fn backward(self, ops: Ops<Self::State, 2>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (pair, slopes, window) = ops.state;
        let v_map = gradients.consume::<B>(&ops.node);
        let [a, b] = ops.parents;
        let adjoints = B::window_similarity_backward(pair, slopes, v_map, window);
        for (node, adjoint) in [(a, adjoints.a), (b, adjoints.b)] {
            if let Some(node) = node {
                gradients.register::<B>(node.id, adjoint);
            }
        }
    }
}

impl<B: SimilarityAdjoint, C: CheckpointStrategy> WindowOps for Autodiff<B, C> {
    fn window_blur(images: FloatTensor<Self>, window: Window) -> FloatTensor<Self> {
        let prepared = BlurBackward.prepare::<C>([images.node()]).compute_bound().stateful();
        let blurred = B::window_blur(images.into_primitive(), window.clone());
        match prepared {
            OpsKind::Tracked(prepared) => prepared.finish(window, blurred),
            OpsKind::UnTracked(prepared) => prepared.finish(blurred),
        }
    }

    fn window_similarity(
        a: FloatTensor<Self>,
        b: FloatTensor<Self>,
        window: Window,
        kind: Similarity,
    ) -> FloatTensor<Self> {
        let prepared = SimilarityBackward.prepare::<C>([a.node(), b.node()]).compute_bound().stateful();
        let pair: Pair<B> = Pair { a: a.into_primitive(), b: b.into_primitive() };
        match prepared {
            OpsKind::Tracked(prepared) => {
                let (map, slopes) = B::window_similarity_tracked(pair.clone(), window.clone(), kind);
                prepared.finish((pair, slopes, window), map)
            }
            OpsKind::UnTracked(prepared) => prepared.finish(B::window_similarity(pair.a, pair.b, window, kind)),
        }
    }
}

pub(super) fn blur(images: Tensor<4>, window: &Window) -> Tensor<4> {
    Tensor::from_dispatch(<Dispatch as WindowOps>::window_blur(images.into_dispatch(), window.clone()))
}

pub(super) fn similarity(a: Tensor<4>, b: Tensor<4>, window: &Window, kind: Similarity) -> Tensor<4> {
    assert_eq!(a.dims(), b.dims(), "similar pictures are of one shape");
    let (a, b) = (a.into_dispatch(), b.into_dispatch());
    Tensor::from_dispatch(<Dispatch as WindowOps>::window_similarity(a, b, window.clone(), kind))
}
