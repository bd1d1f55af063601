//! Taking apart as a Burn backend extension.
//!
//! A node of Burn's graph has one result. The parts are therefore nodes of their own, which leave their cotangents with
//! the node of the whole matrix. That node comes after all of them in the backward pass, and joins the cotangents.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::{Shape, Slice, Tensor};

#[cfg(feature = "cube")]
use burn_cubecl::CubeBackend;

use crate::host::HostBackend;
use crate::list::Floats;

/// The sizes of the blocks.
#[derive(Clone, Debug)]
pub(crate) struct Blocks {
    pub heights: Vec<usize>,
    pub widths: Vec<usize>,
}

/// The op.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait BlockOps: Backend {
    /// See [`apart`](super::apart).
    fn apart(matrix: FloatTensor<Self>, size: Blocks) -> Floats<Self>;
}

impl<B: HostBackend> BlockOps for B {
    fn apart(matrix: FloatTensor<Self>, size: Blocks) -> Floats<Self> {
        slices::<Self>(&matrix, &size)
    }
}

#[cfg(feature = "cube")]
impl BlockOps for CubeBackend {
    fn apart(matrix: FloatTensor<Self>, size: Blocks) -> Floats<Self> {
        slices::<Self>(&matrix, &size)
    }
}

fn slices<B: Backend>(matrix: &FloatTensor<B>, size: &Blocks) -> Floats<B> {
    let columns = ranges(&size.widths);
    let block = |rows: Slice| columns.iter().map(move |&columns| B::float_slice(matrix.clone(), &[rows, columns]));
    Floats(ranges(&size.heights).into_iter().flat_map(block).collect())
}

/// Neighbouring ranges of these lengths.
fn ranges(lengths: &[usize]) -> Vec<Slice> {
    let mut end = 0;
    let range = |&length: &usize| {
        end += length as isize;
        Slice::new(end - length as isize, Some(end), 1)
    };
    lengths.iter().map(range).collect()
}

/// The cotangents of the parts, as far as there are any.
#[derive(Clone, Debug)]
struct Cotangents<B: Backend>(Arc<Mutex<Vec<Option<FloatTensor<B>>>>>);

impl<B: Backend> Cotangents<B> {
    fn lock(&self) -> MutexGuard<'_, Vec<Option<FloatTensor<B>>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The backward step of a part.
#[derive(Debug)]
struct PartBackward;

impl<B: Backend> Backward<B, 1> for PartBackward {
    type State = (Cotangents<B>, usize);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (cotangents, index) = ops.state;
        let v_part = gradients.consume::<B>(&ops.node);
        let mut cotangents = cotangents.lock();
        // The first part that has a cotangent registers one for the whole matrix, as Burn expects it. `WholeBackward`
        // ignores its values.
        if cotangents.iter().all(Option::is_none) {
            let [whole] = ops.parents;
            if let Some(whole) = whole {
                gradients.register::<B>(whole.id, v_part.clone());
            }
        }
        cotangents[index] = Some(v_part);
    }
}

/// The backward step of the whole matrix.
#[derive(Debug)]
struct WholeBackward;

impl<B: Backend> Backward<B, 1> for WholeBackward {
    type State = (Cotangents<B>, Blocks);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (cotangents, Blocks { heights, widths }) = ops.state;
        let any = gradients.consume::<B>(&ops.node);
        let (device, dtype) = (any.device(), any.dtype().into());
        let v_parts = std::mem::take(&mut *cotangents.lock());
        let mut v_parts = v_parts.into_iter();
        let mut row = |height: usize| {
            let zeros = |width: usize| B::float_zeros(Shape::from([height, width]), &device, dtype);
            // Widths first: at their end, nothing more is taken of the parts.
            let row = widths.iter().zip(v_parts.by_ref());
            B::float_cat(row.map(|(&width, v_part)| v_part.unwrap_or_else(|| zeros(width))).collect(), 1)
        };
        let mut v_rows: Vec<FloatTensor<B>> = heights.into_iter().map(&mut row).collect();
        let v_matrix = match v_rows.len() {
            1 => v_rows.remove(0),
            _ => B::float_cat(v_rows, 0),
        };
        let [matrix] = ops.parents;
        if let Some(matrix) = matrix {
            gradients.register::<B>(matrix.id, v_matrix);
        }
    }
}

impl<B: BlockOps, C: CheckpointStrategy> BlockOps for Autodiff<B, C> {
    fn apart(matrix: FloatTensor<Self>, size: Blocks) -> Floats<Self> {
        let parts = B::apart(matrix.primitive().clone(), size.clone());
        let cotangents = Cotangents::<B>(Arc::new(Mutex::new(vec![None; parts.0.len()])));
        let whole = match WholeBackward.prepare::<C>([matrix.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => prepared.finish((cotangents.clone(), size), matrix.into_primitive()),
            OpsKind::UnTracked(prepared) => prepared.finish(matrix.into_primitive()),
        };
        let record = |(index, part)| match PartBackward.prepare::<C>([whole.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => prepared.finish((cotangents.clone(), index), part),
            OpsKind::UnTracked(prepared) => prepared.finish(part),
        };
        Floats(parts.0.into_iter().enumerate().map(record).collect())
    }
}

pub(super) fn apart(matrix: Tensor<2>, heights: &[usize], widths: &[usize]) -> Vec<Tensor<2>> {
    let size = Blocks { heights: heights.to_vec(), widths: widths.to_vec() };
    <Dispatch as BlockOps>::apart(matrix.into_dispatch(), size).into_tensors().collect()
}
