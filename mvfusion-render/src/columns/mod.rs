//! The columns of a matrix, taken apart as one op.
//!
//! As separate tensor operations, each slice would have a backward step that writes a matrix of zeros and adds it to the
//! others. Here, every column of the adjoint is written once.

pub(crate) mod op;

use burn::tensor::Tensor;

/// Takes a matrix `[N, C]` apart into neighbouring matrices `[N, width]`. The widths sum to `C`. Gradients reach the
/// matrix.
///
/// # Panics
/// If the widths do not sum to the number of columns.
pub fn apart(matrix: Tensor<2>, widths: &[usize]) -> Vec<Tensor<2>> {
    let columns = matrix.dims()[1];
    assert_eq!(widths.iter().sum::<usize>(), columns, "the parts {widths:?} have as many columns as the matrix");
    op::apart(matrix, widths)
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    const ROWS: usize = 5;
    const WIDTHS: [usize; 4] = [3, 1, 4, 2];

    fn matrix(seed: u64, columns: usize, device: &Device) -> Tensor<2> {
        let data = TensorData::new(random(seed, ROWS * columns), [ROWS, columns]);
        Tensor::from_data(data, (device, DType::F64))
    }

    /// The same by slices.
    fn sliced(matrix: &Tensor<2>) -> Vec<Tensor<2>> {
        let firsts = WIDTHS.iter().scan(0, |end, width| {
            *end += width;
            Some(*end - width)
        });
        firsts.zip(WIDTHS).map(|(first, width)| matrix.clone().narrow(1, first, width)).collect()
    }

    /// The adjoint of the matrix if the parts in `used` matter, each twice.
    fn adjoint(matrix: &Tensor<2>, parts: &[Tensor<2>], used: &[usize], device: &Device) -> Vec<f64> {
        let weighed = used.iter().map(|&part| {
            let own = parts[part].clone();
            let weights = self::matrix(10 + part as u64, WIDTHS[part], device);
            (own.clone() * weights).sum() + own.square().sum()
        });
        let gradients = weighed.reduce(|sum, term| sum + term).expect("a part is used").backward();
        numbers(matrix.grad(&gradients).expect("tracked"))
    }

    #[test]
    fn parts_and_their_adjoint_are_those_of_slices() {
        for_each_device(|device| {
            let device = device.autodiff();
            // All parts, some of them, the last one alone.
            for used in [&[0, 1, 2, 3][..], &[2, 0], &[3]] {
                let matrix = matrix(1, WIDTHS.iter().sum(), &device).require_grad();
                let parts = apart(matrix.clone(), &WIDTHS);
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
            let leaf = matrix(1, WIDTHS.iter().sum(), &device).require_grad();
            let of = |apart: &dyn Fn(&Tensor<2>) -> Vec<Tensor<2>>| {
                let matrix = leaf.clone().exp();
                let [first, _, third, _] = apart(&matrix).try_into().expect("four parts");
                let gradients = (first.square().sum() + third.sum() + matrix.sin().sum()).backward();
                numbers(leaf.grad(&gradients).expect("tracked"))
            };
            // Two sums of two numbers, in another order.
            const EXACT: f64 = 1e-14;
            let (found, wanted) = (of(&|matrix| apart(matrix.clone(), &WIDTHS)), of(&sliced));
            assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() <= EXACT * b.abs().max(1.0)));
        });
    }

    #[test]
    fn a_matrix_without_gradient_is_taken_apart() {
        for_each_device(|device| {
            for device in [device.clone(), device.autodiff()] {
                let matrix = matrix(1, WIDTHS.iter().sum(), &device);
                let parts = apart(matrix.clone(), &WIDTHS);
                assert!(parts.into_iter().zip(sliced(&matrix)).all(|(a, b)| numbers(a) == numbers(b)));
            }
        });
    }
}
