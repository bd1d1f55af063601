//! Sums with offsets as a Burn backend extension.
//!
//! A node of Burn's graph has one result. The sums are therefore nodes of their own, which leave their cotangents with
//! the node of the whole matrix. That node comes after all of them in the backward pass, and joins the cotangents.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, TensorMetadata, backend_extension};
use burn::tensor::Tensor;

use super::cpu::{self, Place};
use crate::Real;
use crate::host::HostBackend;
use crate::list::Floats;
use crate::real::with_real;

/// How the matrix of offsets is divided.
#[derive(Clone, Debug)]
pub(crate) struct Division {
    /// Rows of each set of attributes.
    pub heights: Vec<usize>,
    /// Columns of each block of offsets.
    pub blocks: Vec<usize>,
    /// Columns of each attribute: the first of its block.
    pub widths: Vec<usize>,
}

impl Division {
    /// Columns of the matrix.
    pub fn columns(&self) -> usize {
        self.blocks.iter().sum()
    }

    /// Rows of the matrix.
    pub fn rows(&self) -> usize {
        self.heights.iter().sum()
    }

    /// Where the offsets of each attribute are, set by set.
    fn places(&self) -> Vec<Place> {
        let mut places = Vec::new();
        let mut row = 0;
        for height in &self.heights {
            let mut column = 0;
            for (block, &width) in self.blocks.iter().zip(&self.widths) {
                places.push(Place { rows: row..row + height, column, width });
                column += block;
            }
            row += height;
        }
        places
    }
}

/// The op.
#[backend_extension(Flex: cfg(feature = "flex"), NdArray: cfg(feature = "ndarray"), Cube: cfg(feature = "cube"), Autodiff)]
pub(crate) trait OffsetOps: Backend {
    /// See [`add`](super::add). The attributes are listed set by set.
    fn add_offsets(
        offsets: FloatTensor<Self>,
        #[extension_type] attributes: Floats<Self>,
        division: Division,
    ) -> Floats<Self>;
}

/// The adjoint; only on backends without autodiff.
pub(crate) trait OffsetAdjoint: OffsetOps {
    /// The adjoint of the offsets for the cotangents of the sums, of which at least one is there.
    fn join_cotangents(v_sums: Vec<Option<FloatTensor<Self>>>, division: &Division) -> FloatTensor<Self>;
}

impl<B: HostBackend> OffsetOps for B {
    fn add_offsets(offsets: FloatTensor<Self>, attributes: Floats<Self>, division: Division) -> Floats<Self> {
        with_real!(offsets.dtype(), T => {
            let (offsets, columns) = (B::values::<T>(offsets), division.columns());
            let add = |(attribute, place): (FloatTensor<B>, &Place)| {
                let shape = attribute.shape();
                B::tensor(cpu::add(&B::values::<T>(attribute), &offsets, columns, place), shape)
            };
            Floats(attributes.0.into_iter().zip(&division.places()).map(add).collect())
        })
    }
}

impl<B: HostBackend> OffsetAdjoint for B {
    fn join_cotangents(v_sums: Vec<Option<FloatTensor<B>>>, division: &Division) -> FloatTensor<B> {
        let (rows, columns) = (division.rows(), division.columns());
        // Proof: see the trait.
        let dtype = v_sums.iter().flatten().next().expect("a cotangent").dtype();
        with_real!(dtype, T => {
            let mut v_offsets = vec![T::of(0.0); rows * columns];
            for (v_sums, place) in v_sums.into_iter().zip(&division.places()) {
                if let Some(v_sums) = v_sums {
                    cpu::put(&B::values::<T>(v_sums), &mut v_offsets, columns, place);
                }
            }
            B::tensor(v_offsets, [rows, columns])
        })
    }
}

/// The cotangents of the sums, as far as there are any.
#[derive(Clone, Debug)]
struct Cotangents<B: Backend>(Arc<Mutex<Vec<Option<FloatTensor<B>>>>>);

impl<B: Backend> Cotangents<B> {
    fn lock(&self) -> MutexGuard<'_, Vec<Option<FloatTensor<B>>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The backward step of a sum.
#[derive(Debug)]
struct SumBackward;

impl<B: Backend> Backward<B, 2> for SumBackward {
    type State = (Cotangents<B>, usize);

    fn backward(self, ops: Ops<Self::State, 2>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (cotangents, index) = ops.state;
        let v_sum = gradients.consume::<B>(&ops.node);
        let [whole, attribute] = ops.parents;
        if let Some(attribute) = attribute {
            gradients.register::<B>(attribute.id, v_sum.clone());
        }
        if let Some(whole) = whole {
            let mut cotangents = cotangents.lock();
            // The first sum that has a cotangent registers one for the whole matrix, as Burn expects it. `WholeBackward`
            // ignores its values.
            if cotangents.iter().all(Option::is_none) {
                gradients.register::<B>(whole.id, v_sum.clone());
            }
            cotangents[index] = Some(v_sum);
        }
    }
}

/// The backward step of the whole matrix.
#[derive(Debug)]
struct WholeBackward;

impl<B: OffsetAdjoint> Backward<B, 1> for WholeBackward {
    type State = (Cotangents<B>, Division);

    fn backward(self, ops: Ops<Self::State, 1>, gradients: &mut Gradients, _: &mut Checkpointer) {
        let (cotangents, division) = ops.state;
        gradients.consume::<B>(&ops.node);
        let v_sums = std::mem::take(&mut *cotangents.lock());
        let [offsets] = ops.parents;
        if let Some(offsets) = offsets {
            gradients.register::<B>(offsets.id, B::join_cotangents(v_sums, &division));
        }
    }
}

impl<B: OffsetAdjoint, C: CheckpointStrategy> OffsetOps for Autodiff<B, C> {
    fn add_offsets(offsets: FloatTensor<Self>, attributes: Floats<Self>, division: Division) -> Floats<Self> {
        let plain = Floats(attributes.0.iter().map(|attribute| attribute.primitive().clone()).collect());
        let sums = B::add_offsets(offsets.primitive().clone(), plain, division.clone());
        let cotangents = Cotangents::<B>(Arc::new(Mutex::new(vec![None; sums.0.len()])));
        let whole = match WholeBackward.prepare::<C>([offsets.node()]).compute_bound().stateful() {
            OpsKind::Tracked(prepared) => prepared.finish((cotangents.clone(), division), offsets.into_primitive()),
            OpsKind::UnTracked(prepared) => prepared.finish(offsets.into_primitive()),
        };
        let record = |(index, (sum, attribute)): (usize, (FloatTensor<B>, &FloatTensor<Self>))| match SumBackward
            .prepare::<C>([whole.node(), attribute.node()])
            .compute_bound()
            .stateful()
        {
            OpsKind::Tracked(prepared) => prepared.finish((cotangents.clone(), index), sum),
            OpsKind::UnTracked(prepared) => prepared.finish(sum),
        };
        Floats(sums.0.into_iter().zip(&attributes.0).enumerate().map(record).collect())
    }
}

pub(super) fn add(offsets: Tensor<2>, attributes: Vec<Tensor<2>>, division: Division) -> Vec<Tensor<2>> {
    let attributes = Floats::of(attributes);
    <Dispatch as OffsetOps>::add_offsets(offsets.into_dispatch(), attributes, division).into_tensors().collect()
}
