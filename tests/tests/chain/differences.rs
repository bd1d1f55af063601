//! Gradients against central finite differences in double precision.

use std::collections::BTreeMap;

use anyhow::{Result, bail, ensure};
use mvfusion_model::random::Stream;
use mvfusion_tests::Array;

/// Half the distance of the two points of a difference. In double precision its own errors, of rounding and of
/// curvature, stay two decades below the tolerance.
const STEP: f64 = 1e-6;

/// Entries that are looked at in each input.
const ENTRIES: usize = 200;

/// How far a gradient may be from the difference, as a share of the largest entry of the input's gradient.
const TOLERANCE: f64 = 1e-6;

/// Inputs or gradients by name.
pub type Values = BTreeMap<String, Array>;

/// Compares `gradients` with differences of `loss` around `values`, at random entries of every input that has one.
///
/// # Errors
/// If an entry differs, with the worst of each input; if a gradient is zero all over.
pub fn compare(values: &Values, gradients: &Values, loss: impl Fn(&Values) -> f64) -> Result<()> {
    let mut failures = Vec::new();
    for (number, (name, gradient)) in gradients.iter().enumerate() {
        let Some(input) = values.get(name) else { bail!("`{name}` is no input") };
        ensure!(gradient.shape == input.shape, "the gradient of `{name}` has shape {:?}", gradient.shape);
        let largest = gradient.largest();
        ensure!(largest > 0.0, "the gradient of `{name}` is zero: its check would be empty");
        let mut worst = (0.0, 0, 0.0);
        let mut moved = values.clone();
        for entry in Stream::new(7, number as u64).permutation(input.values.len()).into_iter().take(ENTRIES) {
            let mut at = |offset: f64| {
                if let Some(array) = moved.get_mut(name) {
                    array.values[entry] = input.values[entry] + offset;
                }
                loss(&moved)
            };
            let difference = (at(STEP) - at(-STEP)) / (2.0 * STEP);
            at(0.0);
            let error = (difference - gradient.values[entry]).abs();
            if error > worst.0 || error.is_nan() {
                worst = (error, entry, difference);
            }
        }
        let (error, entry, difference) = worst;
        if error > TOLERANCE * largest || error.is_nan() {
            failures.push(format!(
                "`{name}` entry {entry}: gradient {:e}, difference {difference:e}, off by {:.1e} of the largest entry {largest:e}",
                gradient.values[entry],
                error / largest,
            ));
        }
    }
    ensure!(
        failures.is_empty(),
        "{} of {} inputs differ:\n  {}",
        failures.len(),
        gradients.len(),
        failures.join("\n  ")
    );
    Ok(())
}
