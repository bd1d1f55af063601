//! How much of a training's time pages may take.

use std::time::Duration;

/// The share of the training's own time that pictures may take while somebody watches. The promise is 20 %; sending and
/// cold caches take a part of it that is not measured here.
const SHARE: f64 = 0.15;
/// Credit never exceeds this many seconds, so that a long silence is not followed by a long pause.
const MOST: f64 = 0.2;

/// An account of time. A picture is paid for when its cost is known, so the account may go below zero, and the next one
/// waits until it is out of debt.
#[derive(Clone, Copy, Debug, Default)]
pub struct Budget {
    /// Seconds that may be spent.
    credit: f64,
}

impl Budget {
    /// Earns the share of some time of training.
    pub fn earn(&mut self, trained: Duration) {
        self.credit = (self.credit + SHARE * trained.as_secs_f64()).min(MOST);
    }

    /// Whether a picture may be rendered now.
    pub fn allows(&self) -> bool {
        self.credit > 0.0
    }

    /// Pays for a picture.
    pub fn spend(&mut self, cost: Duration) {
        self.credit -= cost.as_secs_f64();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: Duration = Duration::from_millis(40);
    const STEPS: u32 = 5000;

    /// The share of time that pictures of a cost take if they are always asked for.
    fn share(cost: impl Fn(usize) -> Duration) -> f64 {
        let (mut budget, mut spent, mut pictures) = (Budget::default(), Duration::ZERO, 0);
        for _ in 0..STEPS {
            budget.earn(STEP);
            while budget.allows() {
                let cost = cost(pictures);
                budget.spend(cost);
                spent += cost;
                pictures += 1;
            }
        }
        assert!(pictures > 10);
        spent.as_secs_f64() / (STEP * STEPS).as_secs_f64()
    }

    #[test]
    fn pictures_take_their_share_and_no_more_whatever_they_cost() {
        for milliseconds in [1, 30, 400, 2500] {
            let taken = share(|_| Duration::from_millis(milliseconds));
            assert!(taken > 0.8 * SHARE && taken < 1.1 * SHARE, "{milliseconds} ms: {taken}");
        }
        // Small ones while it moves, then a large one.
        let taken = share(|picture| Duration::from_millis(if picture % 10 == 9 { 900 } else { 20 }));
        assert!(taken < 1.1 * SHARE, "{taken}");
    }

    #[test]
    fn a_long_silence_buys_no_long_pause() {
        let mut budget = Budget::default();
        budget.earn(Duration::from_secs(3600));
        let mut spent = Duration::ZERO;
        while budget.allows() {
            budget.spend(Duration::from_millis(30));
            spent += Duration::from_millis(30);
        }
        assert!(spent <= Duration::from_millis(230), "{spent:?}");
    }
}
