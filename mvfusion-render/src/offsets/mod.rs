//! Offsets of several attributes of Gaussians, side by side in a matrix as a network gives them, added to these attributes.
//!
//! As separate tensor operations, each attribute would need a slice and a sum, and each slice a backward step that writes
//! a matrix of zeros and adds it to the others. Here, a set of attributes is one launch on a GPU, and so is its adjoint.

mod cpu;
pub(crate) mod op;

use burn::tensor::Tensor;

use op::Division;

/// Largest number of attributes in a set.
pub const MOST_ATTRIBUTES: usize = 6;

/// The sums of attributes and their offsets. The matrix of offsets `[N, C]` has the rows of all sets of attributes one
/// after the other, and a block of columns for each attribute of a set, of which `blocks` are the widths. An attribute is
/// a matrix with the rows of its set, f32, or f64 on a CPU. It may have fewer columns than its block; the rest of the block
/// is then not used. Gradients reach offsets and attributes.
///
/// # Panics
/// If a set has more than [`MOST_ATTRIBUTES`] attributes, or not one of each block, the sizes do not match, or the dtype
/// is another one.
pub fn add(attributes: Vec<Vec<Tensor<2>>>, offsets: Tensor<2>, blocks: &[usize]) -> Vec<Vec<Tensor<2>>> {
    let widths: Vec<usize> = attributes.first().into_iter().flatten().map(|attribute| attribute.dims()[1]).collect();
    let heights: Vec<usize> =
        attributes.iter().map(|set| set.first().map_or(0, |attribute| attribute.dims()[0])).collect();
    assert!(
        (1..=MOST_ATTRIBUTES).contains(&blocks.len()),
        "a set has 1 to {MOST_ATTRIBUTES} attributes, not {}",
        blocks.len()
    );
    for (set, &height) in attributes.iter().zip(&heights) {
        let found: Vec<[usize; 2]> = set.iter().map(Tensor::dims).collect();
        let wanted: Vec<[usize; 2]> = widths.iter().map(|&width| [height, width]).collect();
        assert!(
            found == wanted && found.len() == blocks.len(),
            "sets of attributes of the sizes {found:?} and {wanted:?}"
        );
    }
    assert!(
        widths.iter().zip(blocks).all(|(width, block)| width <= block),
        "columns {widths:?} of the blocks {blocks:?}"
    );
    let division = Division { heights, blocks: blocks.to_vec(), widths };
    assert_eq!(offsets.dims(), [division.rows(), division.columns()], "rows and columns of the offsets");
    let count = blocks.len();
    let sets = attributes.len();
    let mut sums = op::add(offsets, attributes.into_iter().flatten().collect(), division).into_iter();
    (0..sets).map(|_| sums.by_ref().take(count).collect()).collect()
}

#[cfg(test)]
mod tests {
    use burn::tensor::{DType, Device, TensorData};

    use super::*;
    use crate::test_support::{for_each_device, numbers, random};

    const HEIGHTS: [usize; 2] = [2, 3];
    const BLOCKS: [usize; 4] = [3, 1, 6, 2];
    /// The third attribute does not have all columns of its block.
    const WIDTHS: [usize; 4] = [3, 1, 4, 2];

    fn matrix(seed: u64, [rows, columns]: [usize; 2], device: &Device) -> Tensor<2> {
        let data = TensorData::new(random(seed, rows * columns), [rows, columns]);
        Tensor::from_data(data, (device, DType::F64))
    }

    fn offsets(device: &Device) -> Tensor<2> {
        matrix(1, [HEIGHTS.iter().sum(), BLOCKS.iter().sum()], device)
    }

    fn attributes(device: &Device) -> Vec<Vec<Tensor<2>>> {
        let set = |height: usize| {
            let of_width = |(i, width): (usize, &usize)| matrix((10 * height + i) as u64, [height, *width], device);
            WIDTHS.iter().enumerate().map(of_width).collect()
        };
        HEIGHTS.map(set).into()
    }

    /// The same by slices.
    fn by_slices(attributes: Vec<Vec<Tensor<2>>>, offsets: &Tensor<2>) -> Vec<Tensor<2>> {
        let mut sums = Vec::new();
        let mut row = 0;
        for (set, height) in attributes.into_iter().zip(HEIGHTS) {
            let mut column = 0;
            for ((attribute, width), block) in set.into_iter().zip(WIDTHS).zip(BLOCKS) {
                sums.push(attribute + offsets.clone().narrow(0, row, height).narrow(1, column, width));
                column += block;
            }
            row += height;
        }
        sums
    }

    fn by_op(attributes: Vec<Vec<Tensor<2>>>, offsets: &Tensor<2>) -> Vec<Tensor<2>> {
        add(attributes, offsets.clone(), &BLOCKS).into_iter().flatten().collect()
    }

    type Sums = fn(Vec<Vec<Tensor<2>>>, &Tensor<2>) -> Vec<Tensor<2>>;

    /// The sums, and the adjoints of the offsets and of the attributes if the sums in `used` matter.
    fn found(sums: Sums, used: &[usize], device: &Device) -> [Vec<f64>; 3] {
        let offsets = offsets(device).require_grad();
        let attributes: Vec<Vec<Tensor<2>>> =
            attributes(device).into_iter().map(|set| set.into_iter().map(Tensor::require_grad).collect()).collect();
        let sums = sums(attributes.clone(), &offsets);
        let weighed = used.iter().map(|&index| {
            let own = sums[index].clone();
            let weights = matrix(50 + index as u64, own.dims(), device);
            (own.clone() * weights).sum() + own.square().sum()
        });
        let gradients = weighed.reduce(|sum, term| sum + term).expect("a sum is used").backward();
        let of_attributes = attributes.iter().flatten().filter_map(|attribute| attribute.grad(&gradients));
        [
            sums.into_iter().flat_map(|sum| numbers(sum.inner())).collect(),
            numbers(offsets.grad(&gradients).expect("tracked")),
            of_attributes.flat_map(numbers).collect(),
        ]
    }

    #[test]
    fn sums_and_adjoints_are_those_of_slices() {
        for_each_device(|device| {
            let device = device.autodiff();
            // All sums, some of them, the last one alone.
            for used in [&[0, 1, 2, 3, 4, 5, 6, 7][..], &[6, 0], &[7]] {
                assert_eq!(found(by_op, used, &device), found(by_slices, used, &device), "{used:?}");
            }
        });
    }

    #[test]
    fn offsets_that_are_computed_and_used_elsewhere_get_all_their_gradients() {
        for_each_device(|device| {
            let device = device.autodiff();
            let leaf = offsets(&device).require_grad();
            let of = |sums: Sums| {
                let offsets = leaf.clone().exp();
                let [first, _, third, _, _, _, _, last] =
                    sums(attributes(&device), &offsets).try_into().expect("eight sums");
                let loss = first.square().sum() + third.sum() + last.exp().sum() + offsets.sin().sum();
                numbers(leaf.grad(&loss.backward()).expect("tracked"))
            };
            // Two sums of two numbers, in another order.
            const EXACT: f64 = 1e-14;
            let (found, wanted) = (of(by_op), of(by_slices));
            assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() <= EXACT * b.abs().max(1.0)));
        });
    }

    #[test]
    fn only_what_is_tracked_gets_a_gradient() {
        for_each_device(|device| {
            let device = device.autodiff();
            let (constants, tracked) = (attributes(&device), attributes(&device)[0][0].clone().require_grad());
            let mut sets = constants.clone();
            sets[0][0] = tracked.clone();
            let sums = by_op(sets, &offsets(&device));
            let gradients = sums.into_iter().map(Tensor::sum).reduce(|a, b| a + b).expect("a sum").backward();
            assert_eq!(numbers(tracked.grad(&gradients).expect("tracked")), vec![1.0; 6]);
            assert!(constants[0][1].grad(&gradients).is_none());
        });
    }

    #[test]
    fn constants_are_added_with_and_without_autodiff() {
        for_each_device(|device| {
            for device in [device.clone(), device.autodiff()] {
                let (found, wanted) = (by_op(attributes(&device), &offsets(&device)), attributes(&device));
                let wanted = by_slices(wanted, &offsets(&device));
                assert!(found.into_iter().zip(wanted).all(|(a, b)| numbers(a) == numbers(b)));
            }
        });
    }

    #[test]
    #[should_panic(expected = "columns [3] of the blocks [2]")]
    fn an_attribute_wider_than_its_block_is_refused() {
        for_each_device(|device| {
            let (attribute, offsets) = (Tensor::zeros([4, 3], &device), Tensor::zeros([4, 2], &device));
            add(vec![vec![attribute]], offsets, &[2]);
        });
    }
}
