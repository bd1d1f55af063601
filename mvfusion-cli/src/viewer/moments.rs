//! A cache of deformed Gaussians by time, within a budget of bytes: the least recently used goes first.

use std::collections::HashMap;

/// What a moment depends on besides the model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct MomentKey {
    /// The bits of the time.
    time: u64,
    /// Whether the temporal attention takes part.
    mfta: bool,
}

impl MomentKey {
    /// The key of a time with or without temporal attention.
    pub fn new(time: f64, mfta: bool) -> Self {
        Self { time: time.to_bits(), mfta }
    }
}

/// The cache. `T` is cheap to clone.
#[derive(Debug)]
pub struct MomentCache<T> {
    budget: usize,
    used: usize,
    /// Grows with every use.
    clock: u64,
    entries: HashMap<MomentKey, Entry<T>>,
}

#[derive(Debug)]
struct Entry<T> {
    moment: T,
    bytes: usize,
    last: u64,
}

impl<T: Clone> MomentCache<T> {
    /// An empty cache of `budget` bytes.
    pub fn new(budget: usize) -> Self {
        Self { budget, used: 0, clock: 0, entries: HashMap::new() }
    }

    /// A moment, if it is there.
    pub fn get(&mut self, key: MomentKey) -> Option<T> {
        self.clock += 1;
        let entry = self.entries.get_mut(&key)?;
        entry.last = self.clock;
        Some(entry.moment.clone())
    }

    /// Keeps a moment, and forgets those that were not used for longest until all fit. One that is larger than the
    /// whole budget is not kept.
    pub fn keep(&mut self, key: MomentKey, moment: T, bytes: usize) {
        self.forget(key);
        if bytes > self.budget {
            return;
        }
        while self.used + bytes > self.budget {
            let Some(oldest) = self.entries.iter().min_by_key(|(_, entry)| entry.last).map(|(key, _)| *key) else {
                break;
            };
            self.forget(oldest);
        }
        self.clock += 1;
        self.used += bytes;
        self.entries.insert(key, Entry { moment, bytes, last: self.clock });
    }

    /// Forgets everything, because the model has changed.
    pub fn clear(&mut self) {
        self.entries.clear();
        self.used = 0;
    }

    fn forget(&mut self, key: MomentKey) {
        if let Some(entry) = self.entries.remove(&key) {
            self.used -= entry.bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(time: f64) -> MomentKey {
        MomentKey::new(time, false)
    }

    #[test]
    fn the_least_recently_used_moment_goes_first() {
        let mut cache = MomentCache::new(30);
        for time in [0.0, 0.25, 0.5] {
            cache.keep(key(time), time, 10);
        }
        assert_eq!(cache.get(key(0.0)), Some(0.0), "used again");
        cache.keep(key(0.75), 0.75, 10);
        assert_eq!([0.0, 0.25, 0.5, 0.75].map(|time| cache.get(key(time)).is_some()), [true, false, true, true]);
    }

    #[test]
    fn the_budget_is_never_exceeded() {
        let mut cache = MomentCache::new(25);
        for index in 0..1000u32 {
            cache.keep(key(f64::from(index)), index, 1 + index as usize % 30);
            assert!(cache.used <= 25);
            assert_eq!(cache.used, cache.entries.values().map(|entry| entry.bytes).sum::<usize>());
        }
        cache.clear();
        assert_eq!((cache.used, cache.get(key(999.0))), (0, None));
    }

    #[test]
    fn a_moment_that_is_kept_again_counts_once() {
        let mut cache = MomentCache::new(25);
        cache.keep(key(0.5), 1, 10);
        cache.keep(key(0.5), 2, 20);
        assert_eq!((cache.used, cache.get(key(0.5))), (20, Some(2)));
    }

    #[test]
    fn attention_makes_another_moment() {
        let mut cache = MomentCache::new(25);
        cache.keep(MomentKey::new(0.5, true), 1, 10);
        assert_eq!(cache.get(MomentKey::new(0.5, false)), None);
    }
}
