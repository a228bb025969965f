//! Seconds by step of a run.

use crate::base::memory;
use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Seconds by step.
pub(crate) struct Stopwatch {
    pub(crate) seconds: BTreeMap<String, f64>,
    pub(crate) started: Instant,
    pub(crate) last: Instant,
}

impl Stopwatch {
    /// Starts the first lap; starting MPI took `start_seconds` before.
    pub(crate) fn start(start_seconds: f64) -> Self {
        let now = Instant::now();
        Self {
            seconds: BTreeMap::from([("start".to_owned(), start_seconds)]),
            started: now,
            last: now,
        }
    }

    /// Assigns `seconds` of the current lap to the step `name`.
    pub(crate) fn part(&mut self, name: &str, seconds: f64) {
        *self.seconds.entry(name.to_owned()).or_default() += seconds;
        self.last += Duration::from_secs_f64(seconds);
    }

    /// Ends the lap; its time, less its parts, is assigned to the step `name`. It also
    /// [marks](memory::mark) the memory that the step took.
    pub(crate) fn lap(&mut self, name: &str) {
        memory::mark();
        *self.seconds.entry(name.to_owned()).or_default() += self.last.elapsed().as_secs_f64();
        self.last = Instant::now();
    }
}
