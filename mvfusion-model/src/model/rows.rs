//! Changes of a branch's rows, and the trait of everything that follows them.

use burn::tensor::{Int, Tensor};

use crate::tensors;

/// The origin of a branch's Gaussians after a change of rows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RowMap {
    sources: Vec<usize>,
    kept: usize,
    added: usize,
}

impl RowMap {
    /// Rows `0..kept` are the Gaussians of the old rows `sources[..kept]`. The following rows are created from the old
    /// rows `sources[kept..]`, their parents.
    ///
    /// # Panics
    /// If there are fewer sources than kept rows.
    pub fn of_parents(sources: Vec<usize>, kept: usize) -> Self {
        assert!(kept <= sources.len(), "{kept} of {} rows cannot be kept", sources.len());
        Self { sources, kept, added: 0 }
    }

    /// The given old rows stay, in that order; the others are removed.
    pub fn keeping(rows: Vec<usize>) -> Self {
        Self { kept: rows.len(), sources: rows, added: 0 }
    }

    /// All `count` rows stay, followed by `added` Gaussians without a parent.
    pub fn appending(count: usize, added: usize) -> Self {
        Self { sources: (0..count).collect(), kept: count, added }
    }

    /// The old row of each new row that has one: first the Gaussians that stay, then the parents of new ones.
    pub fn sources(&self) -> &[usize] {
        &self.sources
    }

    /// Number of unchanged Gaussians, which are the first rows.
    pub fn kept(&self) -> usize {
        self.kept
    }

    /// Number of new Gaussians, with or without a parent.
    pub fn new_rows(&self) -> usize {
        self.sources.len() - self.kept + self.added
    }

    /// Maps values `[N, C]` of the old rows to the new rows. Children inherit from their parents; Gaussians without a
    /// parent get zeros.
    pub fn inherit(&self, values: &Tensor<2>) -> Tensor<2> {
        with_zeros(values.clone().select(0, index(&self.sources, values)), self.added)
    }

    /// Maps values `[N, C]` of the old rows to the new rows. All new Gaussians get zeros.
    pub fn keep(&self, values: &Tensor<2>) -> Tensor<2> {
        with_zeros(values.clone().select(0, index(&self.sources[..self.kept], values)), self.new_rows())
    }
}

/// Data with one row per Gaussian of a branch.
pub trait PerGaussian {
    /// Follows a change of rows.
    fn follow(&mut self, map: &RowMap);
}

impl<T: PerGaussian> PerGaussian for Option<T> {
    fn follow(&mut self, map: &RowMap) {
        if let Some(rows) = self {
            rows.follow(map);
        }
    }
}

impl<T: PerGaussian> PerGaussian for &mut T {
    fn follow(&mut self, map: &RowMap) {
        T::follow(self, map);
    }
}

fn index(rows: &[usize], like: &Tensor<2>) -> Tensor<1, Int> {
    tensors::rows_like(rows, like)
}

fn with_zeros(values: Tensor<2>, rows: usize) -> Tensor<2> {
    if rows == 0 {
        return values;
    }
    let zeros = Tensor::zeros([rows, values.dims()[1]], (&values.device(), values.dtype()));
    Tensor::cat(vec![values, zeros], 0)
}

#[cfg(test)]
mod tests {
    use burn::tensor::Device;

    use super::*;
    use crate::test_support::{for_each_device, values};

    /// Ten times the row index in the first column, one more in the second.
    fn table(rows: usize, device: &Device) -> Tensor<2> {
        let numbers: Vec<f32> = (0..rows).flat_map(|row| [10.0 * row as f32, 10.0 * row as f32 + 1.0]).collect();
        Tensor::<1>::from_floats(numbers.as_slice(), device).reshape([rows, 2])
    }

    #[test]
    fn children_inherit_or_start_at_zero() {
        for_each_device(|device| {
            let map = RowMap::of_parents(vec![2, 0, 2], 2);
            let table = table(3, &device);
            assert_eq!(values(map.inherit(&table)), [20.0, 21.0, 0.0, 1.0, 20.0, 21.0]);
            assert_eq!(values(map.keep(&table)), [20.0, 21.0, 0.0, 1.0, 0.0, 0.0]);
            assert_eq!((map.kept(), map.new_rows()), (2, 1));
        });
    }

    #[test]
    fn gaussians_without_a_parent_start_at_zero() {
        for_each_device(|device| {
            let map = RowMap::appending(2, 1);
            let expected = [0.0, 1.0, 10.0, 11.0, 0.0, 0.0];
            assert_eq!(values(map.inherit(&table(2, &device))), expected);
            assert_eq!(values(map.keep(&table(2, &device))), expected);
        });
    }

    #[test]
    fn rows_that_are_not_kept_go() {
        for_each_device(|device| {
            let map = RowMap::keeping(vec![2, 1]);
            assert_eq!(values(map.keep(&table(3, &device))), [20.0, 21.0, 10.0, 11.0]);
            assert_eq!(map.new_rows(), 0);
        });
    }
}
