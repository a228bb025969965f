//! Seconds by step of a run.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Seconds by step.
pub(crate) struct Stopwatch {
    pub(crate) seconds: BTreeMap<String, f64>,
    pub(crate) started: Instant,
    pub(crate) last: Instant,
}

impl Stopwatch {
    pub(crate) fn start() -> Self {
        let now = Instant::now();
        Self {
            seconds: BTreeMap::new(),
            started: now,
            last: now,
        }
    }

    /// `seconds` of what the next lap is about to count were `name`'s.
    pub(crate) fn part(&mut self, name: &str, seconds: f64) {
        *self.seconds.entry(name.to_owned()).or_default() += seconds;
        self.last += Duration::from_secs_f64(seconds);
    }

    /// What was done since the last lap took the time since then.
    pub(crate) fn lap(&mut self, name: &str) {
        *self.seconds.entry(name.to_owned()).or_default() += self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
    }
}
