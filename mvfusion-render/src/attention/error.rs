//! Errors in the arguments of the op.

use burn::tensor::{DType, Tensor};

use crate::device::takes;

/// An invalid argument of [`forward`](super::forward).
#[derive(Debug, thiserror::Error)]
pub enum AttentionError {
    /// There are no queries per row.
    #[error("`queries` has shape {found:?}; expected [rows, queries, width] with at least one query")]
    Queries {
        /// The tensor's shape.
        found: [usize; 3],
    },
    /// The shape of the memory does not match the queries.
    #[error(
        "`memory` has shape {found:?}; expected [{rows}, keys, {columns}] with at least one key",
        rows = expected[0],
        columns = expected[1]
    )]
    Memory {
        /// The tensor's shape.
        found: [usize; 3],
        /// Rows of the queries, and columns of a key with its value.
        expected: [usize; 2],
    },
    /// The number of heads does not divide the columns.
    #[error(
        "{heads} heads cannot divide {width} columns: the width must be a positive multiple of the number of heads"
    )]
    Heads {
        /// Requested number of heads.
        heads: usize,
        /// Columns of the queries.
        width: usize,
    },
    /// The device does not support a dtype, or the two dtypes differ.
    #[error("`queries` has dtype {queries:?} and `memory` has dtype {memory:?}; expected f32 in both, or f64 on a CPU")]
    Type {
        /// Dtype of the queries.
        queries: DType,
        /// Dtype of the memory.
        memory: DType,
    },
    /// The two tensors are on different devices.
    #[error("`memory` is on another device than `queries`: move both to one device")]
    OtherDevice,
}

/// Checks all arguments of [`forward`](super::forward).
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
    let device = queries.device();
    match (queries.dtype(), memory.dtype()) {
        // Devices are equal with and without autodiff.
        (own, other) if own == other && takes(&device, own) => match memory.device() == device {
            true => Ok(()),
            false => Err(AttentionError::OtherDevice),
        },
        (queries, memory) => Err(AttentionError::Type { queries, memory }),
    }
}
