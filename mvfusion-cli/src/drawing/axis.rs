//! An axis: the range it shows, where its ticks stand, and what is written beside them.

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spacing {
    /// Equal steps are equally long.
    Linear,
    /// Equal ratios are equally long; values that are not positive have no place.
    Logarithmic,
}

/// An axis that shows all of its values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis {
    low: f64,
    high: f64,
    spacing: Spacing,
}

/// A tick: its value, and what is written beside it.
#[derive(Clone, Debug, PartialEq)]
pub struct Tick {
    /// The value.
    pub value: f64,
    /// The text.
    pub label: String,
}

impl Axis {
    /// A linear axis from the least to the greatest of the finite values, widened where they are all the same.
    pub fn linear(values: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high) = range(values).unwrap_or((0.0, 1.0));
        // Below this share of their size, values differ by rounding alone.
        if high - low <= 1e-9 * low.abs().max(high.abs()) {
            let room = if low == 0.0 { 1.0 } else { 0.05 * low.abs() };
            (low, high) = (low - room, high + room);
        }
        Self { low, high, spacing: Spacing::Linear }
    }

    /// A logarithmic axis if the values are positive and the largest is `ratio` times the smallest or more, else a
    /// linear one.
    pub fn logarithmic_from(ratio: f64, values: impl Iterator<Item = f64> + Clone) -> Self {
        match range(values.clone()) {
            Some((low, high)) if low > 0.0 && high / low >= ratio => Self { low, high, spacing: Spacing::Logarithmic },
            _ => Self::linear(values),
        }
    }

    /// The same axis, longer at both ends by a share of its length.
    pub fn with_room(self, share: f64) -> Self {
        let Self { low, high, spacing } = self;
        let (low, high) = match spacing {
            Spacing::Linear => (low - share * (high - low), high + share * (high - low)),
            Spacing::Logarithmic => (low / (high / low).powf(share), high * (high / low).powf(share)),
        };
        Self { low, high, spacing }
    }

    /// The same axis down to zero, unless it reaches below; for amounts, whose ratio is seen then.
    pub fn down_to_zero(self) -> Self {
        Self { low: self.low.min(0.0), ..self }
    }

    /// How its values are spread.
    pub fn spacing(&self) -> Spacing {
        self.spacing
    }

    /// Where a value stands: 0 at the low end, 1 at the high one.
    pub fn place(&self, value: f64) -> f64 {
        match self.spacing {
            Spacing::Linear => (value - self.low) / (self.high - self.low),
            Spacing::Logarithmic => (value.ln() - self.low.ln()) / (self.high.ln() - self.low.ln()),
        }
    }

    /// About `wanted` ticks at round values.
    pub fn ticks(&self, wanted: usize) -> Vec<Tick> {
        match self.spacing {
            Spacing::Linear => self.linear_ticks(wanted),
            Spacing::Logarithmic => self.logarithmic_ticks(wanted),
        }
    }

    fn linear_ticks(&self, wanted: usize) -> Vec<Tick> {
        let step = round_step((self.high - self.low) / wanted.max(1) as f64);
        // A tolerance of a millionth of a step, so that rounding does not cost the tick at an end.
        let (first, last) = ((self.low / step - 1e-6).ceil(), (self.high / step + 1e-6).floor());
        let count = (last - first).max(0.0) as usize + 1;
        (0..count)
            .map(|k| (first + k as f64) * step)
            .map(|value| Tick { value, label: label(value, step, self.low.abs().max(self.high.abs())) })
            .collect()
    }

    /// At 1, 2 and 5 times the powers of ten, or at these alone where there are many.
    fn logarithmic_ticks(&self, wanted: usize) -> Vec<Tick> {
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let within = |value: &f64| (self.low * (1.0 - 1e-6)..=self.high * (1.0 + 1e-6)).contains(value);
        let at = |factors: &[f64], every: usize| -> Vec<f64> {
            let powers = (first..=last).step_by(every);
            powers.flat_map(|power| factors.iter().map(move |f| f * 10f64.powi(power))).filter(within).collect()
        };
        let fine = at(&[1.0, 2.0, 5.0], 1);
        let values =
            if fine.len() <= 2 * wanted { fine } else { at(&[1.0], 1 + (last - first) as usize / wanted.max(1)) };
        values.into_iter().map(|value| Tick { value, label: label(value, value, value) }).collect()
    }
}

/// The least and the greatest of the finite values.
fn range(values: impl Iterator<Item = f64>) -> Option<(f64, f64)> {
    let finite = values.filter(|value| value.is_finite());
    finite.fold(None, |range, value| {
        let (low, high) = range.unwrap_or((value, value));
        Some((value.min(low), value.max(high)))
    })
}

/// The least of 1, 2 and 5 times a power of ten that is no less than `step`.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    // The power of ten may be rounded; a step that is off by that little is the step meant.
    let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power >= step * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

/// Sizes from which thousands and millions are written as `k` and `M`, and powers of ten.
const THOUSANDS: f64 = 1e4;
const MILLIONS: f64 = 1e6;
const POWERS: f64 = 1e9;
/// Where more decimals would be needed, powers of ten are written too.
const MOST_DECIMALS: usize = 6;

/// A value as short as a distance of `step` to its neighbours allows, on an axis that reaches `size`.
fn label(value: f64, step: f64, size: f64) -> String {
    // What is much less than a step is a rounded nothing.
    if value.abs() < 1e-6 * step {
        return "0".into();
    }
    let (unit, suffix) = match size {
        MILLIONS.. => (1e6, "M"),
        THOUSANDS.. => (1e3, "k"),
        _ => (1.0, ""),
    };
    let decimals = (-(step / unit).log10() - 1e-9).ceil().max(0.0) as usize;
    if size >= POWERS || decimals > MOST_DECIMALS {
        return format!("{value:.2e}").replace(".00e", "e");
    }
    format!("{:.decimals$}{suffix}", value / unit)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: Axis, wanted: usize) -> Vec<String> {
        axis.ticks(wanted).into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn ticks_stand_at_round_values_within_the_range() {
        assert_eq!(labels(Axis::linear([10.0, 66.0].into_iter()), 5), ["20", "40", "60"]);
        assert_eq!(labels(Axis::linear([16.5, 22.7].into_iter()), 4), ["18", "20", "22"]);
        assert_eq!(labels(Axis::linear([0.0, 1.0].into_iter()), 5), ["0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(labels(Axis::linear([-0.3, 0.3].into_iter()), 3), ["-0.2", "0", "0.2"]);
        assert_eq!(labels(Axis::linear([0.0, 25_000.0].into_iter()), 5), ["0", "5k", "10k", "15k", "20k", "25k"]);
        assert_eq!(labels(Axis::linear([0.0, 3e6].into_iter()), 3), ["0", "1M", "2M", "3M"]);
    }

    #[test]
    fn values_over_decades_get_a_logarithmic_axis_and_others_do_not() {
        let fitting = |values: &[f64]| Axis::logarithmic_from(10.0, values.iter().copied());
        let axis = fitting(&[0.004, 2.0, f64::NAN]);
        assert_eq!(axis.spacing(), Spacing::Logarithmic);
        let expected = ["0.005", "0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1", "2"];
        assert_eq!(labels(axis, 5), expected);
        assert_eq!(labels(fitting(&[1e-7, 1e3]), 4), ["1e-7", "0.0001", "0.1", "100"]);
        assert!((axis.place(0.004).abs() + (axis.place(2.0) - 1.0).abs()) < 1e-12);
        assert!((axis.place((0.004f64 * 2.0).sqrt()) - 0.5).abs() < 1e-12);
        for values in [[0.5, 2.0], [0.0, 2.0], [-1.0, 20.0]] {
            assert_eq!(fitting(&values).spacing(), Spacing::Linear, "{values:?}");
        }
    }

    #[test]
    fn close_values_have_labels_of_their_own() {
        assert_eq!(labels(Axis::linear([0.0912, 0.09131].into_iter()), 3), ["0.09120", "0.09125", "0.09130"]);
        assert_eq!(labels(Axis::linear([0.0, 3e-8].into_iter()), 3), ["0", "1e-8", "2e-8", "3e-8"]);
    }

    #[test]
    fn room_is_as_long_at_both_ends_as_it_was_asked_for() {
        for values in [[2.0, 6.0], [1.0, 1e4]] {
            let axis = Axis::logarithmic_from(10.0, values.into_iter()).with_room(0.25);
            let places = values.map(|value| axis.place(value));
            assert!((places[0] - 1.0 / 6.0).abs() < 1e-12 && (places[1] - 5.0 / 6.0).abs() < 1e-12, "{places:?}");
        }
    }

    #[test]
    fn a_constant_or_nothing_at_all_still_has_an_axis() {
        let odd = [vec![1e-300, 1e300], vec![-1e12, -1e11]];
        let constant = [vec![], vec![f64::NAN, f64::INFINITY], vec![0.0], vec![7.0, 7.0], vec![-1e300]];
        for values in constant.into_iter().chain(odd) {
            let axis = Axis::linear(values.iter().copied());
            let ticks = axis.ticks(4);
            assert!((1..=9).contains(&ticks.len()), "{values:?}: {ticks:?}");
            assert!(ticks.iter().all(|tick| (-0.01..=1.01).contains(&axis.place(tick.value))), "{values:?}: {ticks:?}");
        }
    }
}
