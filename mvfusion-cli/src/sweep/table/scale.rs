//! The axis of a swept key: which values it shows, and where its ticks stand.

use crate::drawing::{Axis, Spacing, Tick};

/// Ratio of the largest to the smallest value from which equal ratios are equally long.
const LOGARITHMIC_FROM: f64 = 50.0;
/// Up to so many swept values each has a tick.
const MOST_VALUES: usize = 12;

/// An axis of swept values: logarithmic where they are positive and far apart.
pub(super) fn axis(values: &[f64]) -> Axis {
    Axis::logarithmic_from(LOGARITHMIC_FROM, values.iter().copied())
}

/// Ticks at swept values, if they are few, else at round ones.
pub(super) fn ticks(axis: &Axis, values: &[f64]) -> Vec<Tick> {
    if values.len() > MOST_VALUES && axis.spacing() == Spacing::Linear {
        return axis.ticks(MOST_VALUES / 2);
    }
    let every = values.len().div_ceil(MOST_VALUES).max(1);
    values.iter().step_by(every).map(|&value| Tick { value, label: number(value) }).collect()
}

/// A swept value as short as it can be written.
fn number(value: f64) -> String {
    let is_extreme = value != 0.0 && !(1e-3..1e6).contains(&value.abs());
    if is_extreme { format!("{value:e}") } else { value.to_string() }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(values: &[f64]) -> Vec<String> {
        ticks(&axis(values), values).into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn few_swept_values_have_a_tick_each() {
        assert_eq!(labels(&[3.0, 5.0, 7.0, 9.5]), ["3", "5", "7", "9.5"]);
        assert_eq!(labels(&[1e-5, 0.0025, 0.5, 1000.0, 2e6]), ["1e-5", "0.0025", "0.5", "1000", "2e6"]);
    }

    #[test]
    fn values_far_apart_stand_by_their_ratios() {
        assert_eq!(axis(&[1.0, 100.0]).spacing(), Spacing::Logarithmic);
        assert_eq!(axis(&[1.0, 49.0]).spacing(), Spacing::Linear);
    }

    #[test]
    fn many_swept_values_have_round_ticks() {
        let many: Vec<f64> = (0..=40).map(f64::from).collect();
        assert_eq!(labels(&many), ["0", "10", "20", "30", "40"]);
        let powers: Vec<f64> = (0..20).map(|power| 2f64.powi(power)).collect();
        assert!(labels(&powers).len() <= MOST_VALUES);
    }
}
