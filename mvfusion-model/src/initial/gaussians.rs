//! Initial clouds of Gaussians, as values and as parameters.

use burn::tensor::{DType, Device, Tensor};
use glam::Vec3;
use mvfusion_data::{GaussianCloud, Lifetime, PointCloud, rest_width};

use super::neighbours::mean_squared_distances;
use crate::model::gaussians::{Attribute, Gaussians, SH_C0, attribute_tensor};

/// Lower bound of mean squared distances, so that log-scales are finite (3DGS).
const MIN_SQUARED_DISTANCE: f64 = 1e-7;

/// Whether Gaussians have mask logits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Masking {
    /// With mask logits, in a dynamic branch that is blended with a static one.
    Blended {
        /// Mask logit of the foreground; the other two start at 0.
        dynamic_logit: f64,
    },
    /// Without mask logits.
    Absent,
}

/// Isotropic Gaussians on the points of a cloud (METHOD §1.1, column "init"), with SH degree 0 and without masks.
/// Their scales are the roots of the given mean squared distances to neighbours, one for each point.
pub fn cloud_on(points: &PointCloud, mean_squared_distances: &[f64], opacity: f64) -> GaussianCloud {
    let count = points.len();
    let logit = mvfusion_data::logit(opacity);
    let coefficient = |channel: f32| ((f64::from(channel) - 0.5) / SH_C0) as f32;
    let log_scale = |&squared: &f64| [squared.max(MIN_SQUARED_DISTANCE).sqrt().ln() as f32; 3];
    GaussianCloud {
        sh_degree: 0,
        means: points.positions.iter().map(Vec3::to_array).collect(),
        sh_dc: points.colours.iter().map(|colour| colour.to_array().map(coefficient)).collect(),
        sh_rest: Vec::new(),
        opacity_logits: vec![logit; count],
        log_scales: mean_squared_distances.iter().map(log_scale).collect(),
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]; count],
        mask_logits: None,
        lifetimes: None,
    }
}

/// Gaussians on the points of a cloud, as parameters (METHOD §1.1, column "init"). They have room for the given SH
/// degree; the current one, [`Gaussians::sh_degree`], is 0.
pub fn gaussians_on(
    points: &PointCloud,
    masking: Masking,
    sh_degree: usize,
    opacity: f64,
    device: &Device,
    dtype: DType,
) -> Gaussians {
    let cloud = cloud_on(points, &mean_squared_distances(&points.positions), opacity);
    gaussians_of(&cloud, masking, sh_degree, device, dtype)
}

/// The Gaussians of a cloud, with room for the given SH degree, and with lifetimes if the cloud has them. The current
/// degree, [`Gaussians::sh_degree`], is the cloud's, as far as there is room. With [`Masking::Blended`], mask logits
/// are those of the cloud, or the initial ones if it has none.
pub fn gaussians_of(
    cloud: &GaussianCloud,
    masking: Masking,
    sh_degree: usize,
    device: &Device,
    dtype: DType,
) -> Gaussians {
    let degree = cloud.sh_degree.min(sh_degree);
    let cloud = cloud.clone().at_degree(sh_degree);
    let masks = match (masking, &cloud.mask_logits) {
        (Masking::Absent, _) => None,
        (Masking::Blended { .. }, Some(logits)) => Some(doubles(logits.as_flattened())),
        (Masking::Blended { dynamic_logit }, None) => Some([0.0, 0.0, dynamic_logit].repeat(cloud.len())),
    };
    let lifetimes = |of: fn(&Lifetime) -> Vec<f32>| {
        cloud.lifetimes.as_ref().map(|all| doubles(&all.iter().flat_map(of).collect::<Vec<_>>()))
    };
    let tensor = |values, columns| attribute_tensor(values, columns, device, dtype);
    let gaussians = Gaussians::from_tensors(|attribute| match attribute {
        Attribute::Means => Some(tensor(doubles(cloud.means.as_flattened()), 3)),
        Attribute::ShDc => Some(tensor(doubles(cloud.sh_dc.as_flattened()), 3)),
        Attribute::ShRest => Some(rest_tensor(doubles(&cloud.sh_rest), cloud.len(), sh_degree, device, dtype)),
        Attribute::OpacityLogits => Some(tensor(doubles(&cloud.opacity_logits), 1)),
        Attribute::LogScales => Some(tensor(doubles(cloud.log_scales.as_flattened()), 3)),
        Attribute::Quaternions => Some(tensor(doubles(cloud.quaternions.as_flattened()), 4)),
        Attribute::MaskLogits => masks.clone().map(|masks| tensor(masks, 3)),
        Attribute::TimeCentres => lifetimes(|life| vec![life.centre]).map(|values| tensor(values, 1)),
        Attribute::LogDurations => lifetimes(|life| vec![life.log_duration]).map(|values| tensor(values, 1)),
        Attribute::Velocities => lifetimes(|life| life.velocity.to_vec()).map(|values| tensor(values, 3)),
    })
    // Proof: each arm above is `Some`, except mask logits and lifetimes, which are optional.
    .expect("every attribute but mask logits and lifetimes is given above");
    Gaussians { sh_degree: degree, ..gaussians }
}

/// The higher colour coefficients of `count` Gaussians. Empty values would not determine the number of rows.
fn rest_tensor(values: Vec<f64>, count: usize, sh_degree: usize, device: &Device, dtype: DType) -> Tensor<2> {
    match rest_width(sh_degree) {
        0 => Tensor::zeros([count, 0], (device, dtype)),
        width => attribute_tensor(values, width, device, dtype),
    }
}

fn doubles(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}
