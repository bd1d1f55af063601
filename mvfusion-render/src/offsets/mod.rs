//! The blocks of a matrix, taken apart as one op.
//!
//! As separate tensor operations, each slice would have a backward step that writes a matrix of zeros and adds it to the
//! others. Here, every number of the adjoint is written once.

pub(crate) mod op;

use burn::tensor::Tensor;

/// Takes a matrix `[N, C]` apart into blocks `[height, width]`: for each height, the blocks of all widths side by side.
/// The heights sum to `N` and the widths to `C`. Gradients reach the matrix.
///
/// # Panics
/// If heights or widths do not sum to the size of the matrix.
pub fn apart(matrix: Tensor<2>, heights: &[usize], widths: &[usize]) -> Vec<Vec<Tensor<2>>> {
    let [rows, columns] = matrix.dims();
    assert_eq!(heights.iter().sum::<usize>(), rows, "the parts {heights:?} have as many rows as the matrix");
    assert_eq!(widths.iter().sum::<usize>(), columns, "the parts {widths:?} have as many columns as the matrix");
    let mut blocks = op::apart(matrix, heights, widths).into_iter();
    heights.iter().map(|_| blocks.by_ref().take(widths.len()).collect()).collect()
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    const HEIGHTS: [usize; 2] = [2, 3];
    const WIDTHS: [usize; 4] = [3, 1, 4, 2];

    fn matrix(seed: u64, [rows, columns]: [usize; 2], device: &Device) -> Tensor<2> {
        let data = TensorData::new(random(seed, rows * columns), [rows, columns]);
        Tensor::from_data(data, (device, DType::F64))
    }

    fn whole(device: &Device) -> Tensor<2> {
        matrix(1, [HEIGHTS.iter().sum(), WIDTHS.iter().sum()], device)
    }

    fn blocks(matrix: &Tensor<2>) -> Vec<Tensor<2>> {
        apart(matrix.clone(), &HEIGHTS, &WIDTHS).into_iter().flatten().collect()
    }

    /// The first index and the length of each part.
    fn ranges(lengths: &[usize]) -> Vec<[usize; 2]> {
        let firsts = lengths.iter().scan(0, |end, length| {
            *end += length;
            Some(*end - length)
        });
        firsts.zip(lengths).map(|(first, &length)| [first, length]).collect()
    }

    /// The same by slices.
    fn sliced(matrix: &Tensor<2>) -> Vec<Tensor<2>> {
        let block = |[row, height]: [usize; 2], [column, width]: [usize; 2]| {
            matrix.clone().narrow(0, row, height).narrow(1, column, width)
        };
        ranges(&HEIGHTS)
            .iter()
            .flat_map(|&rows| ranges(&WIDTHS).into_iter().map(move |columns| (rows, columns)))
            .map(|(rows, columns)| block(rows, columns))
            .collect()
    }

    /// The adjoint of the matrix if the blocks in `used` matter, each twice.
    fn adjoint(matrix: &Tensor<2>, parts: &[Tensor<2>], used: &[usize], device: &Device) -> Vec<f64> {
        let weighed = used.iter().map(|&part| {
            let own = parts[part].clone();
            let weights = self::matrix(10 + part as u64, own.dims(), device);
            (own.clone() * weights).sum() + own.square().sum()
        });
        let gradients = weighed.reduce(|sum, term| sum + term).expect("a part is used").backward();
        numbers(matrix.grad(&gradients).expect("tracked"))
    }

    #[test]
    fn blocks_and_their_adjoint_are_those_of_slices() {
        for_each_device(|device| {
            let device = device.autodiff();
            // All blocks, some of them, the last one alone.
            for used in [&[0, 1, 2, 3, 4, 5, 6, 7][..], &[6, 0], &[7]] {
                let matrix = whole(&device).require_grad();
                let parts = blocks(&matrix);
                for (part, wanted) in parts.iter().zip(sliced(&matrix)) {
                    assert_eq!(part.dims(), wanted.dims());
                    assert_eq!(numbers(part.clone().inner()), numbers(wanted.inner()));
                }
                let wanted = adjoint(&matrix, &sliced(&matrix), used, &device);
                assert_eq!(adjoint(&matrix, &parts, used, &device), wanted);
            }
        });
    }

    #[test]
    fn a_matrix_that_is_computed_and_used_elsewhere_gets_all_its_gradients() {
        for_each_device(|device| {
            let device = device.autodiff();
            let leaf = whole(&device).require_grad();
            let of = |apart: &dyn Fn(&Tensor<2>) -> Vec<Tensor<2>>| {
                let matrix = leaf.clone().exp();
                let [first, _, third, _, _, _, _, last] = apart(&matrix).try_into().expect("eight blocks");
                let loss = first.square().sum() + third.sum() + last.exp().sum() + matrix.sin().sum();
                numbers(leaf.grad(&loss.backward()).expect("tracked"))
            };
            // Two sums of two numbers, in another order.
            const EXACT: f64 = 1e-14;
            let (found, wanted) = (of(&blocks), of(&sliced));
            assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() <= EXACT * b.abs().max(1.0)));
        });
    }

    #[test]
    fn a_matrix_without_gradient_is_taken_apart() {
        for_each_device(|device| {
            for device in [device.clone(), device.autodiff()] {
                let matrix = whole(&device);
                assert!(blocks(&matrix).into_iter().zip(sliced(&matrix)).all(|(a, b)| numbers(a) == numbers(b)));
            }
        });
    }
}
