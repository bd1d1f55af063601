//! Intermediate results of the CPU twin, for benchmarks and comparisons with other rasterisers.

use burn::backend::ops::FloatTensorOps;
use burn::backend::{Dispatch, DispatchTensor, TensorMetadata};
use burn::tensor::{Shape, Tensor};
use mvfusion_data::Camera;
use mvfusion_kernels::splat::{PROJECTED_LEN, Projected};

use super::cpu::blend::Tally;
use super::cpu::cloud::Cloud;
use super::cpu::forward::forward;
use super::cpu::lanes::{LANES, Lane, Lanes};
use super::cpu::view::View;
use super::{SplatError, SplatInputs, SplatSettings, check};
use crate::real::with_real;

/// The projection of each Gaussian, and the amount of work in blending. Rows of culled Gaussians are zero.
#[derive(Clone, Debug, Default)]
pub struct SplatDiagnosis {
    /// Projected centres in pixels.
    pub means2d: Vec<[f64; 2]>,
    /// z in camera coordinates.
    pub depths: Vec<f64>,
    /// Inverse covariances on the image plane: xx, xy, yy.
    pub conics: Vec<[f64; 3]>,
    /// Radii along x and y, in pixels; 0 where culled.
    pub radii: Vec<[i32; 2]>,
    /// Colours, not negative.
    pub colours: Vec<[f64; 3]>,
    /// Opacities, compensated if the rules require it.
    pub opacities: Vec<f64>,
    /// Pairs of a Gaussian and a tile.
    pub intersections: usize,
    /// Evaluated pairs of a Gaussian and a pixel.
    pub evaluated_pairs: usize,
    /// Pairs of a Gaussian and a pixel in which the Gaussian contributes.
    pub contributing_pairs: usize,
}

/// Renders on the CPU, whatever the device of the inputs, and returns the intermediate results.
///
/// # Errors
/// Same as [`super::splat`].
pub fn diagnose(inputs: &SplatInputs, camera: &Camera, settings: &SplatSettings) -> Result<SplatDiagnosis, SplatError> {
    let (tensors, sizes) = check(inputs.clone(), None, camera, settings)?;
    with_real!(inputs.means.dtype(), T => {
        let values = tensors.map(|tensor| tensor.map_or_else(Vec::new, numbers::<T>));
        let cloud = Cloud { values: values.each_ref().map(Vec::as_slice), sizes };
        look_inside(&cloud, &View::new(camera, settings))
    })
}

/// The values of a tensor of any rank, row-major.
fn numbers<T: Lane>(tensor: DispatchTensor) -> Vec<T> {
    let shape = Shape::from([tensor.shape().num_elements()]);
    Tensor::<1>::from_dispatch(Dispatch::float_reshape(tensor, shape)).into_data().iter::<T>().collect()
}

fn look_inside<T: Lane>(cloud: &Cloud<T>, view: &View<T>) -> Result<SplatDiagnosis, SplatError> {
    let result = forward::<T, PairCount>(cloud, view);
    if let Some(error) = result.refused {
        return Err(error);
    }
    let rows = result.projections.records.as_chunks::<PROJECTED_LEN>().0;
    let splats: Vec<Projected<f64>> = rows.iter().map(|row| Projected::from_row(&row.map(|x| x.wide()))).collect();
    let (a, slope) = (|s: &Projected<f64>| s.curve_x, |s: &Projected<f64>| s.slope);
    Ok(SplatDiagnosis {
        means2d: splats.iter().map(|s| s.centre).collect(),
        depths: splats.iter().map(|s| s.depth).collect(),
        conics: splats.iter().map(|s| [a(s), a(s) * slope(s), s.curve_y + a(s) * slope(s) * slope(s)]).collect(),
        radii: result.projections.radii.as_chunks::<2>().0.to_vec(),
        colours: splats.iter().map(|s| s.colour).collect(),
        opacities: splats.iter().map(|s| s.opacity).collect(),
        intersections: result.bins.sorted.len(),
        evaluated_pairs: result.tallies.iter().map(|t| t.evaluated).sum(),
        contributing_pairs: result.tallies.iter().map(|t| t.contributing).sum(),
    })
}

/// Counts pairs of a Gaussian and a pixel.
#[derive(Default)]
struct PairCount {
    evaluated: usize,
    contributing: usize,
}

impl Tally for PairCount {
    fn segment<T: Lane>(&mut self, weights: &Lanes<T>) {
        self.evaluated += LANES;
        self.contributing += weights.iter().filter(|w| **w > T::zero()).count();
    }
}
