//! Comparisons that go on after a failure and report the worst entry of each.

use std::fmt::{Debug, Display, Write};

use anyhow::{Result, bail};

use crate::Array;

/// How far a number may be from the expected one: the sum of three allowances.
#[derive(Clone, Copy, Debug, Default)]
pub struct Tolerance {
    /// Times the largest magnitude of the expected array.
    pub of_largest: f64,
    /// Times the magnitude of the entry itself.
    pub of_entry: f64,
    /// The same for every entry.
    pub absolute: f64,
}

impl Tolerance {
    /// Times the largest magnitude of the expected array.
    pub const fn of_largest(factor: f64) -> Self {
        Self { of_largest: factor, of_entry: 0.0, absolute: 0.0 }
    }

    /// Times the magnitude of each entry.
    pub const fn of_entry(factor: f64) -> Self {
        Self { of_largest: 0.0, of_entry: factor, absolute: 0.0 }
    }

    /// The same for every entry.
    pub const fn absolute(allowance: f64) -> Self {
        Self { of_largest: 0.0, of_entry: 0.0, absolute: allowance }
    }

    /// This, and an absolute allowance.
    pub const fn plus(self, allowance: f64) -> Self {
        Self { absolute: self.absolute + allowance, ..self }
    }

    /// What is allowed at an entry of an array with this largest magnitude.
    fn allowed(&self, entry: f64, largest: f64) -> f64 {
        self.of_largest * largest + self.of_entry * entry.abs() + self.absolute
    }
}

/// Entries that may be further off than the others.
#[derive(Clone, Copy, Debug)]
pub struct Few {
    /// Their share of all entries at most.
    pub share: f64,
    /// How far they may be off.
    pub tolerance: Tolerance,
}

/// Comparisons of one test.
#[derive(Debug, Default)]
pub struct Checklist {
    failures: Vec<String>,
    compared: usize,
}

impl Checklist {
    /// Compares numbers; a number that is not finite differs from everything.
    pub fn close(&mut self, name: impl Display, expected: &Array, found: &Array, tolerance: Tolerance) {
        let everywhere = |_| true;
        self.close_where(name, expected, found, tolerance, everywhere);
    }

    /// Compares the numbers at those flat indices that `counts` accepts.
    pub fn close_where(
        &mut self,
        name: impl Display,
        expected: &Array,
        found: &Array,
        tolerance: Tolerance,
        counts: impl Fn(usize) -> bool,
    ) {
        self.compared += 1;
        if expected.shape != found.shape {
            self.failures.push(format!("`{name}` has shape {:?}, expected {:?}", found.shape, expected.shape));
            return;
        }
        let largest = expected.largest();
        let allowed = |e: f64| tolerance.allowed(e, largest);
        let excess = |&i: &usize| {
            let (e, f) = (expected.values[i], found.values[i]);
            // Written so that NaN counts as infinitely wrong.
            if (e - f).abs() <= allowed(e) { 0.0 } else { ((e - f).abs() / allowed(e)).max(1.0) }
        };
        let bad: Vec<usize> = (0..expected.values.len()).filter(|&i| counts(i) && excess(&i) > 0.0).collect();
        let Some(&worst) = bad.iter().max_by(|a, b| excess(a).total_cmp(&excess(b))) else { return };
        let (e, f) = (expected.values[worst], found.values[worst]);
        self.failures.push(format!(
            "`{name}` differs at {} of {} entries, worst at {:?}: expected {e:e}, got {f:e}, difference {:e}, allowed {:e}",
            bad.len(),
            expected.values.len(),
            coordinates(worst, &expected.shape),
            (e - f).abs(),
            allowed(e),
        ));
    }

    /// Compares numbers of which a few may be further off.
    pub fn close_but_few(
        &mut self,
        name: impl Display,
        expected: &Array,
        found: &Array,
        tolerance: Tolerance,
        few: Few,
    ) {
        let largest = expected.largest();
        let pairs = expected.values.iter().zip(&found.values);
        let beyond = pairs.filter(|&(&e, &f)| (e - f).abs() > tolerance.allowed(e, largest)).count();
        let are_few = beyond as f64 <= few.share * expected.values.len() as f64;
        self.close(name, expected, found, if are_few { few.tolerance } else { tolerance });
    }

    /// Compares single numbers.
    pub fn close_number(&mut self, name: impl Display, expected: f64, found: f64, tolerance: Tolerance) {
        self.close(name, &Array::list(vec![expected]), &Array::list(vec![found]), tolerance);
    }

    /// Compares what must be the same.
    pub fn same<T: PartialEq + Debug>(&mut self, name: impl Display, expected: &[T], found: &[T]) {
        self.compared += 1;
        if expected.len() != found.len() {
            self.failures.push(format!("`{name}` has {} entries, expected {}", found.len(), expected.len()));
        } else if let Some(i) = (0..expected.len()).find(|&i| expected[i] != found[i]) {
            let differing = expected.iter().zip(found).filter(|(e, f)| e != f).count();
            self.failures.push(format!(
                "`{name}` differs at {differing} of {} entries, first at {i}: expected {:?}, got {:?}",
                expected.len(),
                expected[i],
                found[i]
            ));
        }
    }

    /// Notes a failure of another kind.
    pub fn fail(&mut self, message: String) {
        self.failures.push(message);
    }

    /// Number of comparisons so far.
    pub fn compared(&self) -> usize {
        self.compared
    }

    /// What came out.
    ///
    /// # Errors
    /// If a comparison failed, with all that did; or if nothing was compared.
    pub fn finish(self) -> Result<()> {
        if self.compared == 0 {
            bail!("nothing was compared");
        }
        if self.failures.is_empty() {
            return Ok(());
        }
        let mut message = format!("{} of {} comparisons failed:", self.failures.len(), self.compared);
        for failure in &self.failures {
            // Writing to a string cannot fail.
            let _ = write!(message, "\n  {failure}");
        }
        bail!(message)
    }
}

/// The place of a flat index in an array.
fn coordinates(mut index: usize, shape: &[usize]) -> Vec<usize> {
    let mut place: Vec<usize> = shape
        .iter()
        .rev()
        .map(|&length| {
            let along = index % length;
            index /= length;
            along
        })
        .collect();
    place.reverse();
    place
}

#[cfg(test)]
mod tests {
    use super::*;

    fn list(values: &[f64]) -> Array {
        Array::list(values.to_vec())
    }

    #[test]
    fn the_worst_entry_is_named() {
        let mut checks = Checklist::default();
        let expected = Array::new([2, 2], vec![1.0, 2.0, 3.0, 4.0]);
        let found = Array::new([2, 2], vec![1.0, 2.1, 3.5, 4.0]);
        checks.close("x", &expected, &found, Tolerance::absolute(0.01));
        let message = checks.finish().expect_err("two entries differ").to_string();
        assert!(
            message.contains("`x` differs at 2 of 4 entries, worst at [1, 0]: expected 3e0, got 3.5e0"),
            "{message}"
        );
    }

    #[test]
    fn allowances_add_up() {
        let tolerance = Tolerance { of_largest: 0.01, of_entry: 0.1, absolute: 1.0 };
        for (found, agrees) in [(6.8, false), (6.6, true)] {
            let mut checks = Checklist::default();
            // 0.01 * 20 + 0.1 * 5 + 1 = 1.7 is allowed at the first entry, whose value is 5.
            checks.close("x", &list(&[5.0, 20.0]), &list(&[found, 20.0]), tolerance);
            assert_eq!(checks.finish().is_ok(), agrees);
        }
    }

    #[test]
    fn a_few_entries_may_be_further_off_but_not_many() {
        let expected = list(&[1.0; 10]);
        let few = Few { share: 0.2, tolerance: Tolerance::absolute(0.5) };
        for (off, by, agrees) in
            [(2, 0.4, true), (3, 0.4, false), (1, 0.6, false), (1, f64::NAN, false), (10, 0.1, true)]
        {
            let found: Vec<f64> = (0..10).map(|i| if i < off { 1.0 + by } else { 1.0 }).collect();
            let mut checks = Checklist::default();
            checks.close_but_few("x", &expected, &list(&found), Tolerance::absolute(0.2), few);
            assert_eq!(checks.finish().is_ok(), agrees, "{off} entries off by {by}");
        }
    }

    #[test]
    fn nan_agrees_with_nothing() {
        let mut checks = Checklist::default();
        checks.close("x", &list(&[f64::NAN]), &list(&[f64::NAN]), Tolerance::absolute(1.0));
        assert!(checks.finish().is_err());
    }

    #[test]
    fn a_test_without_a_comparison_fails() {
        assert!(Checklist::default().finish().is_err());
    }
}
