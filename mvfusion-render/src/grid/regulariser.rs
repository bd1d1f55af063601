//! R_grid of METHOD §4.4: penalties that keep the planes smooth and the time planes close to 1.

mod cpu;
pub(crate) mod op;

use burn::tensor::{Tensor, TensorData};

use super::{GridError, GridLayout, error};

/// The three terms of R_grid, each `[1]`, unweighted. The "plane TV" term is actually a smoothness term along one axis.
#[derive(Clone, Debug)]
pub struct GridPenalties {
    /// The sum over scales and the planes xy, xz, yz of the mean squared second difference along the height.
    pub plane_smooth: Tensor<1>,
    /// The same over the planes xt, yt, zt, whose height is time.
    pub time_smooth: Tensor<1>,
    /// The sum over scales and the planes xt, yt, zt of the mean of `|1 - p|`.
    pub l1_time: Tensor<1>,
}

/// The penalties of `planes` `[cells, F]` in the order of [`GridLayout::planes`]; f32, or f64 on a CPU. A plane with
/// fewer than three rows has no second difference and adds nothing to the smoothness. The gradient of `|1 - p|` at 1 is
/// 0.
///
/// # Errors
/// If the planes do not match the layout.
pub fn penalties(planes: Tensor<2>, layout: &GridLayout) -> Result<GridPenalties, GridError> {
    error::check_planes(&planes, layout)?;
    let terms = op::penalties(planes, layout);
    let [plane_smooth, time_smooth, l1_time] = [0, 1, 2].map(|term| terms.clone().narrow(0, term, 1));
    Ok(GridPenalties { plane_smooth, time_smooth, l1_time })
}

/// The sum of the penalties in the order of [`GridPenalties`], each times its weight: `[1]`. As one product, it takes
/// fewer launches than a sum of slices.
///
/// # Errors
/// As [`penalties`].
pub fn weighted_penalty(planes: Tensor<2>, layout: &GridLayout, weights: [f64; 3]) -> Result<Tensor<1>, GridError> {
    error::check_planes(&planes, layout)?;
    let terms = op::penalties(planes, layout);
    let weights = TensorData::from(weights).convert_dtype(terms.dtype());
    let weights = Tensor::<1>::from_data(weights, (&terms.device(), terms.dtype()));
    Ok((terms * weights).sum())
}
