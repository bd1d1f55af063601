//! HexPlane interpolation and its penalties with tensor operations: slower, simple, and differentiated by Burn. It is
//! the reference for the tests of the ops.

use burn::tensor::{Int, Tensor};

use super::regulariser::GridPenalties;
use super::{GridBounds, GridLayout, PlaneLayout};
use mvfusion_kernels::grid::{PAIRS, TIME};

/// The position of a coordinate among the cells of an axis, for all points.
struct Place {
    /// `[N]`.
    low: Tensor<1, Int>,
    /// 1, or 0 on an axis of one cell.
    step: i64,
    /// `[N, 1]`.
    fraction: Tensor<2>,
}

impl Place {
    /// `grid_coordinate` is `[N, 1]`.
    fn new(grid_coordinate: Tensor<2>, cells: usize) -> Self {
        let last = (cells - 1) as f64;
        let cell = (grid_coordinate + 1.0) * (last / 2.0);
        let outside = cell.clone().lower_equal_elem(0.0).bool_or(cell.clone().greater_equal_elem(last));
        // On and beyond the border, the coordinate has no gradient.
        let cell = cell.clone().mask_where(outside, cell.detach().clamp(0.0, last));
        let low = cell.clone().detach().floor().clamp(0.0, cells.saturating_sub(2) as f64);
        let fraction = cell - low.clone();
        Self { low: low.int().flatten::<1>(0, 1), step: i64::from(cells > 1), fraction }
    }
}

/// [`look_up`](super::look_up) without its checks.
pub fn look_up(
    planes: Tensor<2>,
    points: Tensor<2>,
    times: Tensor<2>,
    bounds: &GridBounds,
    layout: &GridLayout,
) -> Tensor<2> {
    let count = points.dims()[0];
    let coordinates: [Tensor<2>; 4] = std::array::from_fn(|axis| match axis {
        TIME => times.clone().expand([count, 1]),
        axis => {
            let world = points.clone().narrow(1, axis, 1);
            (world - bounds.max[axis]) * (2.0 / (bounds.min[axis] - bounds.max[axis])) - 1.0
        }
    });
    let all = layout.planes();
    let scales = all.chunks(6).enumerate().map(|(scale, six)| {
        let axes = layout.axes(scale);
        let places: [Place; 4] = std::array::from_fn(|axis| Place::new(coordinates[axis].clone(), axes[axis]));
        let samples = six.iter().map(|plane| sample(planes.clone(), plane, &places));
        samples.reduce(|product, sample| product * sample)
    });
    Tensor::cat(scales.flatten().collect(), 1)
}

/// The bilinear samples of one plane, `[N, F]`.
fn sample(planes: Tensor<2>, plane: &PlaneLayout, places: &[Place; 4]) -> Tensor<2> {
    let [column, row] = PAIRS[plane.pair].map(|axis| &places[axis]);
    let width = plane.width as i64;
    let low = row.low.clone() * width + column.low.clone() + plane.first_cell as i64;
    let cell = |down: i64, right: i64| planes.clone().select(0, low.clone() + (down * width + right));
    let top = mix(cell(0, 0), cell(0, column.step), column.fraction.clone());
    let bottom = mix(cell(row.step, 0), cell(row.step, column.step), column.fraction.clone());
    mix(top, bottom, row.fraction.clone())
}

fn mix(from: Tensor<2>, to: Tensor<2>, fraction: Tensor<2>) -> Tensor<2> {
    from.clone() + (to - from) * fraction
}

/// [`penalties`](super::regulariser::penalties) without its checks.
pub fn penalties(planes: Tensor<2>, layout: &GridLayout) -> GridPenalties {
    let zero = Tensor::<1>::zeros([1], (&planes.device(), planes.dtype()));
    let mut sums = GridPenalties { plane_smooth: zero.clone(), time_smooth: zero.clone(), l1_time: zero };
    for plane in layout.planes() {
        let (height, width, first) = (plane.height, plane.width, plane.first_cell);
        let cells = planes.clone().narrow(0, first, plane.cells());
        if plane.is_time() {
            sums.l1_time = sums.l1_time + (cells.clone() - 1.0).abs().mean();
        }
        if height < 3 {
            continue;
        }
        let rows = |from: usize| cells.clone().narrow(0, from * width, (height - 2) * width);
        let smooth = (rows(2) - rows(1) * 2.0 + rows(0)).square().mean();
        match plane.is_time() {
            true => sums.time_smooth = sums.time_smooth + smooth,
            false => sums.plane_smooth = sums.plane_smooth + smooth,
        }
    }
    sums
}
