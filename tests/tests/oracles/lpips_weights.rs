//! `mvfusion lpips-weights` with the weights of `lpips_weights`: written as torchvision publishes them, and turned back
//! into the program's own file, they are the same tensors, and find the distances in `oracle_metrics`. The linear
//! layers of the package lpips come out of its wheel, which `$MVFUSION_LPIPS_WHEEL` names.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use libtest_mimic::Trial;
use mvfusion_model::evaluation::Backbone;
use mvfusion_tests::{TorchContainer, TorchTensors};

use crate::tiny::{mvfusion, text};
use crate::{failed, ignored, metrics};

/// The variable that names the wheel.
const WHEEL: &str = "MVFUSION_LPIPS_WHEEL";

/// What torchvision's files have besides the convolutions.
const OTHER: &str = "classifier.6.bias";

/// The trials.
pub fn trials(root: Option<&Path>) -> Vec<Trial> {
    let weights = root.map(|root| root.join(metrics::WEIGHTS)).filter(|folder| folder.is_dir());
    let wheel = std::env::var_os(WHEEL).map(PathBuf::from).filter(|wheel| wheel.is_file());
    let name = |what: &str| format!("lpips_weights::{what}");
    let Some(weights) = weights else {
        return vec![ignored(name("all"), format!("there is no folder {}", metrics::WEIGHTS))];
    };
    let mut trials: Vec<Trial> = TorchContainer::ALL
        .into_iter()
        .map(|container| {
            let weights = weights.clone();
            Trial::test(name(&format!("alex::{container:?}").to_lowercase()), move || {
                check(Backbone::Alex, container, &weights, None).map_err(failed)
            })
        })
        .collect();
    for backbone in Backbone::ALL {
        let title = name(&format!("wheel::{}", backbone.name()));
        let (weights, wheel) = (weights.clone(), wheel.clone());
        trials.push(match wheel {
            None => ignored(title, format!("{WHEEL} names no wheel of lpips")),
            Some(wheel) => {
                Trial::test(title, move || check(backbone, TorchContainer::Zip, &weights, Some(&wheel)).map_err(failed))
            }
        });
    }
    trials
}

/// Convolutions in a container, and linear layers in the wheel or in a file of the package's container.
fn check(backbone: Backbone, container: TorchContainer, weights: &Path, wheel: Option<&Path>) -> Result<()> {
    let expected = tensors(&backbone.file_in(weights).context("the network has a file")?)?;
    let is_linear = |name: &str| name.starts_with("lin");
    let place = tempfile::tempdir()?;
    let mut convolutions: TorchTensors = expected.clone();
    convolutions.retain(|name, _| !is_linear(name));
    convolutions.insert(OTHER.to_owned(), (vec![2], vec![0.5, -0.5]));
    let file = place.path().join("network.pth");
    fs::write(&file, container.save(&convolutions)?)?;
    let linear = place.path().join("linear.pth");
    let linear = match wheel {
        Some(wheel) => wheel,
        None => {
            let renamed = expected.iter().filter(|(name, _)| is_linear(name));
            let renamed = renamed.map(|(name, tensor)| (name.replace(".weight", ".model.1.weight"), tensor.clone()));
            fs::write(&linear, TorchContainer::Legacy.save(&renamed.collect())?)?;
            &linear
        }
    };
    let out = place.path().join("out");
    let said = mvfusion(&["lpips-weights", "--from", text(&file)?, text(linear)?, "--out", text(&out)?])?;
    ensure!(said.contains("SHA-256") && said.contains("written"), "{said}");
    let made = tensors(&backbone.file_in(&out).context("a file was made")?)?;
    ensure!(made.keys().eq(expected.keys()), "{:?} instead of {:?}", made.keys(), expected.keys());
    for (name, (shape, numbers)) in &expected {
        let (other_shape, others) = &made[name];
        ensure!(shape == other_shape, "`{name}` has the shape {other_shape:?} and not {shape:?}");
        // The file of VGG-16 has half the precision, also of the linear layers, of which the wheel has the originals.
        let is_rounded = backbone == Backbone::Vgg && is_linear(name);
        let differs = |(a, b): (&f32, &f32)| match is_rounded {
            true => (a - b).abs() > 1e-3 * b.abs() + 1e-7,
            false => a.to_bits() != b.to_bits(),
        };
        ensure!(!numbers.iter().zip(others).any(differs), "`{name}` has other numbers");
    }
    metrics::check_converted(backbone, &out)
}

/// The tensors of a file of the program, in single precision.
fn tensors(path: &Path) -> Result<TorchTensors> {
    let bytes = fs::read(path)?;
    let file = safetensors::SafeTensors::deserialize(&bytes)?;
    let mut tensors = BTreeMap::new();
    for (name, view) in file.tensors() {
        let numbers = match view.dtype() {
            safetensors::Dtype::F32 => {
                view.data().as_chunks::<4>().0.iter().map(|&bytes| f32::from_le_bytes(bytes)).collect()
            }
            safetensors::Dtype::F16 => {
                view.data().as_chunks::<2>().0.iter().map(|&bytes| half(u16::from_le_bytes(bytes))).collect()
            }
            other => anyhow::bail!("`{name}` holds {other:?}"),
        };
        tensors.insert(name, (view.shape().to_vec(), numbers));
    }
    Ok(tensors)
}

/// A number of half precision.
fn half(bits: u16) -> f32 {
    let (sign, exponent, fraction) = (bits >> 15, (bits >> 10) & 31, f32::from(bits & 1023));
    let magnitude = match exponent {
        0 => fraction * 2f32.powi(-24),
        exponent => (1.0 + fraction / 1024.0) * 2f32.powi(i32::from(exponent) - 15),
    };
    if sign == 1 { -magnitude } else { magnitude }
}
