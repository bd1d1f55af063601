//! A scale of a curve: which values it shows, and where its ticks stand.

/// Ratio of the largest to the smallest value from which equal ratios are equally long.
const LOGARITHMIC_FROM: f64 = 50.0;
/// Room beyond the values at both ends, as a share of their range.
const ROOM: f64 = 0.06;
/// Up to so many swept values each has a tick.
const MOST_VALUES: usize = 12;

/// A scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scale {
    low: f64,
    high: f64,
    is_logarithmic: bool,
}

/// A tick: its value, and what is written beside it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub value: f64,
    pub label: String,
}

impl Scale {
    /// A scale of figures, with some room beyond them.
    pub fn linear(values: impl Iterator<Item = f64>) -> Self {
        let (low, high) = range(values);
        // Values that differ by rounding alone are one value.
        let is_flat = high - low <= 1e-9 * low.abs().max(high.abs());
        let room = match (is_flat, low == 0.0) {
            (false, _) => ROOM * (high - low),
            (true, true) => 1.0,
            (true, false) => 0.05 * low.abs(),
        };
        Self { low: low - room, high: high + room, is_logarithmic: false }
    }

    /// A scale of swept values: logarithmic where they are positive and far apart.
    pub fn swept(values: &[f64]) -> Self {
        let (low, high) = range(values.iter().copied());
        if low > 0.0 && high / low >= LOGARITHMIC_FROM {
            let room = (high / low).powf(ROOM);
            return Self { low: low / room, high: high * room, is_logarithmic: true };
        }
        Self::linear(values.iter().copied())
    }

    /// Where a value stands: 0 at the low end, 1 at the high one.
    pub fn place(&self, value: f64) -> f64 {
        if self.is_logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    /// About `wanted` ticks at round values.
    pub fn ticks(&self, wanted: usize) -> Vec<Tick> {
        let step = round_step((self.high - self.low) / wanted.max(1) as f64);
        let (first, last) = ((self.low / step).ceil(), (self.high / step).floor());
        let count = (last - first).max(0.0) as usize + 1;
        let values = (0..count).map(|index| (first + index as f64) * step);
        let size = self.low.abs().max(self.high.abs());
        values.map(|value| Tick { value, label: round_number(value, step, size) }).collect()
    }

    /// Ticks at swept values, if they are few, else at round ones.
    pub fn swept_ticks(&self, values: &[f64]) -> Vec<Tick> {
        if values.len() > MOST_VALUES && !self.is_logarithmic {
            return self.ticks(MOST_VALUES / 2);
        }
        let every = values.len().div_ceil(MOST_VALUES).max(1);
        values.iter().step_by(every).map(|&value| Tick { value, label: number(value) }).collect()
    }
}

/// A round value as short as a distance of `step` to its neighbours allows, on a scale that reaches `size`.
fn round_number(value: f64, step: f64, size: f64) -> String {
    let (unit, suffix) = match size {
        1e9.. => return format!("{value:.2e}"),
        1e6.. => (1e6, "M"),
        1e4.. => (1e3, "k"),
        _ => (1.0, ""),
    };
    let decimals = (-(step / unit).log10() - 1e-9).ceil().max(0.0) as usize;
    match decimals {
        // The sum makes a zero of a negative one.
        0..=6 => format!("{:.decimals$}{suffix}", value / unit + 0.0),
        _ => format!("{value:.2e}"),
    }
}

/// A swept value as short as it can be written.
fn number(value: f64) -> String {
    let is_extreme = value != 0.0 && !(1e-3..1e6).contains(&value.abs());
    if is_extreme { format!("{value:e}") } else { value.to_string() }
}

/// The least and the greatest value; 0 and 1 where there is none.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let widen = |range: Option<(f64, f64)>, value: f64| {
        Some(range.map_or((value, value), |(low, high)| (value.min(low), value.max(high))))
    };
    values.filter(|value| value.is_finite()).fold(None, widen).unwrap_or((0.0, 1.0))
}

/// The least of 1, 2 and 5 times a power of ten that is no less than `step`.
fn round_step(step: f64) -> f64 {
    let power = 10f64.powf(step.log10().floor());
    // The power of ten may be rounded; a step that is off by that little is the step meant.
    let factor = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * power >= step * (1.0 - 1e-9));
    factor.unwrap_or(10.0) * power
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(ticks: Vec<Tick>) -> Vec<String> {
        ticks.into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn few_swept_values_have_a_tick_each() {
        let windows = [3.0, 5.0, 7.0, 9.5];
        assert_eq!(labels(Scale::swept(&windows).swept_ticks(&windows)), ["3", "5", "7", "9.5"]);
        let rates = [1e-5, 0.0025, 0.5, 1000.0, 2e6];
        let scale = Scale::swept(&rates);
        assert_eq!(labels(scale.swept_ticks(&rates)), ["1e-5", "0.0025", "0.5", "1000", "2e6"]);
        let places: Vec<f64> = [1.0, 10.0, 100.0].iter().map(|&rate| Scale::swept(&[1.0, 100.0]).place(rate)).collect();
        assert!((places[1] - 0.5).abs() < 1e-12 && places[0] > 0.0 && places[2] < 1.0, "{places:?}");
    }

    #[test]
    fn many_swept_values_have_round_ticks() {
        let many: Vec<f64> = (0..=40).map(f64::from).collect();
        assert_eq!(labels(Scale::swept(&many).swept_ticks(&many)), ["0", "10", "20", "30", "40"]);
        let powers: Vec<f64> = (0..20).map(|power| 2f64.powi(power)).collect();
        assert!(Scale::swept(&powers).swept_ticks(&powers).len() <= MOST_VALUES);
    }

    #[test]
    fn figures_have_round_ticks_within_the_scale() {
        assert_eq!(labels(Scale::linear([30.0, 32.07].into_iter()).ticks(5)), ["30.0", "30.5", "31.0", "31.5", "32.0"]);
        assert_eq!(labels(Scale::linear([131e3, 145e3].into_iter()).ticks(4)), ["135k", "140k", "145k"]);
        assert_eq!(labels(Scale::linear([-1.0, 1.0].into_iter()).ticks(3)), ["-1", "0", "1"]);
        for values in [vec![], vec![0.0], vec![7.0, 7.0], vec![f64::NAN, 1.0], vec![1e-300, 1e300], vec![-1e12, -1e11]]
        {
            let scale = Scale::linear(values.iter().copied());
            let ticks = scale.ticks(5);
            assert!((1..=9).contains(&ticks.len()), "{values:?}: {ticks:?}");
            assert!(
                ticks.iter().all(|tick| (-0.01..=1.01).contains(&scale.place(tick.value))),
                "{values:?}: {ticks:?}"
            );
        }
    }
}
