//! Interruption of a batch: the ranks that split space agree on it between two applications.
//!
//! Each rank checks a flag that a signal raises. If space is split, all ranks check after the same
//! applications, however each blocks its steps, and stop together: at each check they take the
//! outcome of the vote posted at the previous one, and post the next. So no rank waits for others,
//! and there is a vote about every tenth of a second.

use crate::matrix::blocking::MOST_LEVELS;
use crate::parallel::communicator::Group;
use crate::parallel::communicator::vote::Vote;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Rows that a rank applies between two votes, about: 0.1 s of work.
const ROWS_BETWEEN: usize = 1 << 20;
/// Least number of applications between two votes: the size of a block of steps.
const FEWEST_BETWEEN: usize = MOST_LEVELS;
/// Largest number of applications between two votes.
const MOST_BETWEEN: usize = 64;

/// Whether a batch is to be interrupted. All ranks of a space group check after the same
/// applications.
#[derive(Default)]
pub struct Interruption {
    /// The flag that is raised when the run is to stop.
    stop: Option<Arc<AtomicBool>>,
    /// The votes, if space is split.
    votes: Option<Vote>,
    /// Applications between two votes, and those since the last.
    every: usize,
    since: usize,
    /// Whether the batch may be interrupted now; the same on all ranks of the space group.
    pub allowed: bool,
}

impl Interruption {
    /// The interruption by the flag `stop` for ranks that split space, with `rows` rows on this
    /// one; without a flag, never. Collective over the space group.
    pub fn new(space: &Group, rows: usize, stop: Option<Arc<AtomicBool>>) -> Self {
        let most = space.max_count(rows).max(1);
        Self {
            stop,
            votes: (space.size() > 1).then(|| Vote::new(space)),
            every: (ROWS_BETWEEN / most).clamp(FEWEST_BETWEEN, MOST_BETWEEN),
            since: 0,
            allowed: false,
        }
    }

    /// The number of applications, at most `most`, that this rank may take before it calls
    /// [`after`](Self::after): up to the next check of all ranks, since each rank may block its
    /// steps differently.
    pub fn applications_until_check(&self, most: usize) -> usize {
        if self.stop.is_some() && self.allowed && self.votes.is_some() {
            most.min(self.every - self.since)
        } else {
            most
        }
    }

    /// Whether to interrupt the batch after `applications` more applications. Collective over the
    /// space group; allocates nothing.
    pub fn after(&mut self, applications: usize) -> bool {
        let Some(stop) = self.stop.as_ref().filter(|_| self.allowed) else {
            return false;
        };
        let stop_is_set = || stop.load(Ordering::Relaxed);
        let Some(votes) = &mut self.votes else {
            return stop_is_set();
        };
        self.since += applications;
        if self.since < self.every {
            return false;
        }
        self.since = 0;
        let leave = votes.is_posted() && votes.take() != 0;
        votes.post(u64::from(stop_is_set()));
        leave
    }
}

impl Drop for Interruption {
    fn drop(&mut self) {
        // All ranks of the space group posted equally many votes.
        if let Some(votes) = self.votes.as_mut().filter(|votes| votes.is_posted()) {
            votes.take();
        }
    }
}
