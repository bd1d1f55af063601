//! `knn_init`: Gaussians on the points of a cloud.

use anyhow::Result;
use burn::tensor::{DType, Device};
use glam::Vec3;
use mvfusion_data::PointCloud;
use mvfusion_model::initial::{Masking, gaussians_on, mean_squared_distances};
use mvfusion_tests::{Array, Checklist, Tolerance};

use crate::archive::Archive;

/// From the README of the oracle.
const TOLERANCE: Tolerance = Tolerance::of_largest(1e-5);

/// The same, of each distance: they spread over decades.
const DISTANCES: Tolerance = Tolerance::of_entry(1e-5);

/// Opacity at the start.
const OPACITY: f64 = 0.1;

/// The Gaussians of a cloud.
pub fn check(archive: &Archive, device: &Device) -> Result<()> {
    let cloud =
        PointCloud { positions: vectors(archive.array("in.points")?), colours: vectors(archive.array("in.colors")?) };
    let mut checks = Checklist::default();
    let squared = Array::list(mean_squared_distances(&cloud.positions));
    checks.close("mean_sq_3nn", archive.array("out.mean_sq_3nn")?, &squared, DISTANCES);

    let gaussians = gaussians_on(&cloud, Masking::Absent, 3, OPACITY, device, DType::F32);
    for (name, parameter) in [
        ("out.scaling", &gaussians.log_scales),
        ("out.rotation", &gaussians.quaternions),
        ("out.opacity", &gaussians.opacity_logits),
        ("out.f_dc", &gaussians.sh_dc),
    ] {
        let expected = archive.array(name)?;
        let found = Array::of(parameter.val()).reshaped(expected.shape.clone());
        checks.close(name, expected, &found, TOLERANCE);
    }
    let highest = Array::of(gaussians.sh_rest.val()).largest();
    checks.close_number("f_rest", archive.number("out.f_rest_absmax")?, highest, TOLERANCE);
    checks.finish()
}

/// Rows of three as single-precision vectors, which they are.
fn vectors(rows: &Array) -> Vec<Vec3> {
    rows.values.chunks_exact(3).map(|r| Vec3::new(r[0] as f32, r[1] as f32, r[2] as f32)).collect()
}
