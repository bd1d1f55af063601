//! What can be wrong with the arguments of the op.

use burn::tensor::{DType, Tensor};

use crate::device::takes;

/// An argument of [`forward`](super::forward) that does not fit.
#[derive(Debug, thiserror::Error)]
pub enum AttentionError {
    /// A row without a query.
    #[error("`queries` has shape {found:?}; expected [rows, queries, width] with a query at least")]
    Queries {
        /// Its shape.
        found: [usize; 3],
    },
    /// The memory is not made for these queries.
    #[error("`memory` has shape {found:?}; expected [{rows}, keys, {columns}] with a key at least", rows = expected[0], columns = expected[1])]
    Memory {
        /// Its shape.
        found: [usize; 3],
        /// Rows of the queries, and columns of a key and its value.
        expected: [usize; 2],
    },
    /// Heads that do not share the columns evenly.
    #[error("{heads} heads cannot share {width} columns: they must divide them, and neither may be zero")]
    Heads {
        /// Heads asked for.
        heads: usize,
        /// Columns of the queries.
        width: usize,
    },
    /// A tensor's numbers are of a type that the device does not take, or the two tensors differ.
    #[error("`queries` holds {queries:?} and `memory` holds {memory:?}; expected f32 in both, or f64 on a CPU")]
    Type {
        /// Type of the queries.
        queries: DType,
        /// Type of the memory.
        memory: DType,
    },
}

/// Checks everything that [`forward`](super::forward) takes.
pub(super) fn check(queries: &Tensor<3>, memory: &Tensor<3>, heads: usize) -> Result<(), AttentionError> {
    let [rows, count, width] = queries.dims();
    if count == 0 {
        return Err(AttentionError::Queries { found: queries.dims() });
    }
    if heads == 0 || width == 0 || !width.is_multiple_of(heads) {
        return Err(AttentionError::Heads { heads, width });
    }
    let found = memory.dims();
    if found[0] != rows || found[1] == 0 || found[2] != 2 * width {
        return Err(AttentionError::Memory { found, expected: [rows, 2 * width] });
    }
    match (queries.dtype(), memory.dtype()) {
        (own, other) if own == other && takes(&queries.device(), own) => Ok(()),
        (queries, memory) => Err(AttentionError::Type { queries, memory }),
    }
}
