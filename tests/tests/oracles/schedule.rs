//! `lr_schedule`: the learning rates of every parameter group over a run, in four configurations.

use anyhow::Result;
use burn::tensor::Device;
use mvfusion_model::config::{Decay, OptimConfig};
use mvfusion_model::model::gaussians::Attribute;
use mvfusion_model::train::optim::Rates;
use mvfusion_tests::{Array, Checklist, Tolerance};

use crate::archive::Archive;

/// From the README of the oracle.
const TOLERANCE: Tolerance = Tolerance::of_entry(1e-6);

/// The rates of the configurations (METHOD §11.1): grid, mask heads, higher colour coefficients.
fn configs() -> [(&'static str, OptimConfig); 4] {
    let photos = |grid: f64| OptimConfig {
        grid: Decay { start: grid, end: 2e-5 },
        mask_heads: Decay { start: 1.6e-5, end: 1.6e-6 },
        dynamic_sh_rest: Decay { start: 0.0025 / 2.0, end: 0.0025 / 2.0 },
        ..OptimConfig::default()
    };
    [
        ("neu3d", OptimConfig::default()),
        ("onthego_indoor", photos(8e-4)),
        ("onthego_outdoor", photos(8e-4)),
        ("robustnerf", photos(1.6e-3)),
    ]
}

/// The rate of a group of the files.
fn rate(rates: &Rates, branch: &str, group: &str) -> Option<f64> {
    let gaussians = if branch == "fg" { &rates.dynamic } else { &rates.static_ };
    Some(match (branch, group) {
        (_, "xyz") => gaussians.of(Attribute::Means),
        (_, "f_dc") => gaussians.of(Attribute::ShDc),
        (_, "f_rest") => gaussians.of(Attribute::ShRest),
        (_, "opacity") => gaussians.of(Attribute::OpacityLogits),
        (_, "scaling") => gaussians.of(Attribute::LogScales),
        (_, "rotation") => gaussians.of(Attribute::Quaternions),
        ("fg", "deformation") => rates.deformation,
        ("fg", "grid") => rates.grid,
        ("fg", "mask_update") => rates.mask_heads,
        _ => return None,
    })
}

/// Every rate of a file. It knows no device.
pub fn check(archive: &Archive, _device: &Device) -> Result<()> {
    let steps = archive.counts("in.iterations")?;
    let extent = archive.number("in.ext")?;
    let mut checks = Checklist::default();
    for (name, config) in configs() {
        let start = Rates::at(0, extent, &config);
        let course: Vec<Rates> = steps.iter().map(|&step| Rates::at(step, extent, &config)).collect();
        for branch in ["fg", "bg"] {
            let prefix = format!("out.{name}.{branch}.");
            let groups: Vec<&str> = archive.names().filter_map(|n| n.strip_prefix(&prefix)).collect();
            for group in groups.into_iter().filter(|group| !group.ends_with(".setup")) {
                let Some(first) = rate(&start, branch, group) else { continue };
                let found = course.iter().filter_map(|rates| rate(rates, branch, group)).collect();
                let key = format!("{prefix}{group}");
                checks.close(&key, archive.array(&key)?, &Array::list(found), TOLERANCE);
                let key = format!("{key}.setup");
                checks.close_number(&key, archive.number(&key)?, first, TOLERANCE);
            }
        }
    }
    checks.finish()
}
