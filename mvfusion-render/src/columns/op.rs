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

/// The op.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait ColumnOps: Backend {
    /// See [`apart`](super::apart).
    fn apart(matrix: FloatTensor<Self>, widths: Vec<usize>) -> Floats<Self>;
}

impl<B: HostBackend> ColumnOps for B {
    fn apart(matrix: FloatTensor<Self>, widths: Vec<usize>) -> Floats<Self> {
        slices::<Self>(&matrix, &widths)
    }
}

#[cfg(feature = "cube")]
impl ColumnOps for CubeBackend {
    fn apart(matrix: FloatTensor<Self>, widths: Vec<usize>) -> Floats<Self> {
        slices::<Self>(&matrix, &widths)
    }
}

fn slices<B: Backend>(matrix: &FloatTensor<B>, widths: &[usize]) -> Floats<B> {
    let rows = Slice::new(0, Some(matrix.shape()[0] as isize), 1);
    let mut end = 0;
    let parts = widths.iter().map(|&width| {
        let columns = Slice::new(end, Some(end + width as isize), 1);
        end += width as isize;
        B::float_slice(matrix.clone(), &[rows, columns])
    });
    Floats(parts.collect())
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
    type State = (Cotangents<B>, Vec<usize>);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (cotangents, widths) = ops.state;
        let any = gradients.consume::<B>(&ops.node);
        let (rows, device, dtype) = (any.shape()[0], any.device(), any.dtype().into());
        let zeros = |width| B::float_zeros(Shape::from([rows, width]), &device, dtype);
        let v_parts = std::mem::take(&mut *cotangents.lock());
        let v_parts = v_parts.into_iter().zip(widths).map(|(v_part, width)| v_part.unwrap_or_else(|| zeros(width)));
        let v_matrix = B::float_cat(v_parts.collect(), 1);
        let [matrix] = ops.parents;
        if let Some(matrix) = matrix {
            gradients.register::<B>(matrix.id, v_matrix);
        }
    }
}

impl<B: ColumnOps, C: CheckpointStrategy> ColumnOps for Autodiff<B, C> {
    fn apart(matrix: FloatTensor<Self>, widths: Vec<usize>) -> Floats<Self> {
        let cotangents = Cotangents::<B>(Arc::new(Mutex::new(vec![None; widths.len()])));
        let parts = B::apart(matrix.primitive().clone(), widths.clone());
        let whole = match WholeBackward.prepare::<C>([matrix.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => prepared.finish((cotangents.clone(), widths), matrix.into_primitive()),
            OpsKind::UnTracked(prepared) => prepared.finish(matrix.into_primitive()),
        };
        let record = |(index, part)| match PartBackward.prepare::<C>([whole.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => prepared.finish((cotangents.clone(), index), part),
            OpsKind::UnTracked(prepared) => prepared.finish(part),
        };
        Floats(parts.0.into_iter().enumerate().map(record).collect())
    }
}

pub(super) fn apart(matrix: Tensor<2>, widths: &[usize]) -> Vec<Tensor<2>> {
    <Dispatch as ColumnOps>::apart(matrix.into_dispatch(), widths.to_vec()).into_tensors().collect()
}
