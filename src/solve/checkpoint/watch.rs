//! The common decision of all ranks, between batches and without waiting, to write a checkpoint or
//! to stop.
//!
//! A signal interrupts a batch ([`crate::propagate::interruption`]); its rank then waits for the
//! votes of the others.
//!
//! At the end of each batch a rank checks whether the last vote is over ([`Vote`]). If so, it
//! follows the decision and posts the next vote. A rank without batches continues to vote until all
//! are finished. So all ranks see the same outcomes in the same order, for any numbers of batches,
//! and wait for each other only to write and at the end of a stage.
//!
//! A vote is over a batch or two after it was posted, which may be too late for the wall time. So
//! near the wall time, and before the first batch shows how long batches take, ranks go *together*:
//! after its batch, each posts a vote and waits for its outcome.

use crate::parallel::communicator::Communicator;
use crate::parallel::communicator::vote::Vote;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Bit of a vote: the rank requests a checkpoint.
const WRITE: u64 = 1;
/// Bit of a vote: the rank has received a signal to stop.
const SIGNAL: u64 = 2;
/// Bit of a vote: the wall time ends before another batch.
const TIME: u64 = 4;
/// Bit of a vote: the wall time ends soon.
const SOON: u64 = 8;
/// Bit of a vote: the rank has batches left.
const UNFINISHED: u64 = 16;
/// Bit of a vote: a batch of the rank failed.
const FAILED: u64 = 32;

/// Part of the wall time, at most [`MOST_SPARE`], that is left for the end of the program.
const SPARE: f64 = 0.02;
const MOST_SPARE: Duration = Duration::from_secs(30);
/// Factor by which an operation may take longer than the longest one before.
const CAUTION: f64 = 1.2;
/// Number of batches before the wall time from which ranks go together: up to two until all ranks
/// know, one that they finish, and one more.
const NEAR: u32 = 4;
/// Assumed bytes a second that a rank writes, before the first checkpoint.
const USUAL_RATE: f64 = 1e8;

/// The state of a rank in a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RankState {
    /// The rank has batches left.
    Working,
    /// The rank has finished its batches.
    Finished,
    /// The rank interrupted a batch, as the run is to stop.
    Left,
    /// A batch failed.
    Failed,
}

/// The common decision of the ranks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CommonDecision {
    /// No decision yet, or none needed.
    GoOn,
    /// Write a checkpoint.
    Write,
    /// Write a checkpoint and stop, after a signal.
    StopBySignal,
    /// Write a checkpoint and stop, as the wall time ends.
    StopByWallTime,
    /// All ranks are finished: the stage is over.
    Finished,
    /// A rank failed: all stop.
    Failed,
}

/// The times at which checkpoints are made, and the signal to stop.
#[derive(Clone, Debug, Default)]
pub struct CheckpointTimes {
    /// The interval between checkpoints, by rank 0's clock.
    pub every: Option<Duration>,
    /// The start of the program, and the wall time that it may take.
    pub wall: Option<(Instant, Duration)>,
    /// The flag that is raised when the run is to stop.
    pub stop: Arc<AtomicBool>,
}

/// The clock and the votes of a rank.
pub struct Watch {
    vote: Vote,
    times: CheckpointTimes,
    /// Whether this is rank 0, whose clock counts.
    leads: bool,
    /// Whether ranks wait for each other's votes.
    together: bool,
    /// The time at which the last checkpoint was begun or finished, or at which the run began.
    written: Instant,
    /// Whether the last vote was not for a checkpoint: there is at least one batch between two
    /// checkpoints.
    batch_since_checkpoint: bool,
    /// Time to write a checkpoint; `None` before the first estimate.
    writing: Option<Duration>,
    /// Start of this rank's current batch, if there is one.
    begun: Option<Instant>,
    /// Longest time of a batch, if one is finished.
    longest: Option<Duration>,
    /// Batches that this rank finished.
    pub batches: usize,
    /// Time at which the last vote was posted.
    posted: Instant,
    /// Longest time from posting a vote to its outcome.
    slowest: Duration,
}

impl Watch {
    /// Starts the clock. Collective.
    pub fn new(communicator: &Communicator, times: CheckpointTimes) -> Self {
        let now = Instant::now();
        Self {
            vote: Vote::new(&communicator.world),
            together: times.wall.is_some(),
            times,
            leads: communicator.world.is_first(),
            written: now,
            batch_since_checkpoint: true,
            writing: None,
            begun: None,
            longest: None,
            batches: 0,
            posted: now,
            slowest: Duration::ZERO,
        }
    }

    /// Predicts the time of the first checkpoint from its size in bytes on this rank.
    pub fn predict_write_time(&mut self, bytes: impl FnOnce() -> usize) {
        (self.writing).get_or_insert_with(|| Duration::from_secs_f64(bytes() as f64 / USUAL_RATE));
    }

    /// Starts the clock of this rank's next batch, if it has one.
    pub fn begin(&mut self, standing: RankState) {
        self.begun = (standing == RankState::Working).then(Instant::now);
    }

    /// The common decision of all ranks, at the beginning of a stage and after each batch (see
    /// [`begin`](Self::begin)). After `Write` they decide again. `Finished`, `Failed` or a stop is
    /// the last decision of a stage. Collective over the space group, whose ranks have the same
    /// `standing`.
    pub fn decide(&mut self, communicator: &Communicator, standing: RankState) -> CommonDecision {
        if let Some(begun) = self.begun.take() {
            self.longest = self.longest.max(Some(begun.elapsed()));
            let ended = !matches!(standing, RankState::Left | RankState::Failed);
            self.batches += usize::from(ended);
        }
        loop {
            if !self.vote.is_posted() {
                self.post(standing);
            }
            // A rank with batches left polls the vote; a rank without batches waits for it.
            if standing == RankState::Working && !self.together && !self.is_over(communicator) {
                return CommonDecision::GoOn;
            }
            let outcome = self.vote.take();
            self.slowest = self.slowest.max(self.posted.elapsed());
            let has = |bit| outcome & bit != 0;
            let verdict = match () {
                () if has(FAILED) => CommonDecision::Failed,
                () if !has(UNFINISHED) => CommonDecision::Finished,
                () if has(SIGNAL) => CommonDecision::StopBySignal,
                () if has(TIME) => CommonDecision::StopByWallTime,
                () if has(WRITE) => CommonDecision::Write,
                () => CommonDecision::GoOn,
            };
            let stale = has(SOON) && !self.together;
            self.together = has(SOON);
            self.batch_since_checkpoint = verdict != CommonDecision::Write;
            if !self.batch_since_checkpoint {
                self.written = Instant::now();
            }
            if matches!(verdict, CommonDecision::GoOn | CommonDecision::Write) && !self.together {
                self.post(standing);
            }
            if verdict != CommonDecision::GoOn || !stale {
                return verdict;
            }
            // The vote was posted before this rank's current state was known.
        }
    }

    /// Whether the vote is over on all ranks of the space group.
    fn is_over(&mut self, communicator: &Communicator) -> bool {
        let over = self.vote.is_over();
        let space = &communicator.space;
        match space.size() {
            1 => over,
            _ => !space.any(!over),
        }
    }

    fn post(&mut self, standing: RankState) {
        let mut bits = match standing {
            RankState::Working => UNFINISHED,
            RankState::Finished => 0,
            RankState::Left => UNFINISHED | SIGNAL,
            RankState::Failed => UNFINISHED | FAILED,
        };
        if self.times.stop.load(Ordering::Relaxed) {
            bits |= SIGNAL;
        }
        if self.leads {
            bits |= self.clock_bits();
        }
        self.posted = Instant::now();
        self.vote.post(bits);
    }

    /// The bits that rank 0's clock sets.
    fn clock_bits(&self) -> u64 {
        let mut bits = 0;
        let due = |every: Duration| self.written.elapsed() >= every;
        if self.batch_since_checkpoint && self.times.every.is_some_and(due) {
            bits |= WRITE;
        }
        if let Some((start, wall)) = self.times.wall {
            let batch = self.longest.unwrap_or_default().max(self.slowest);
            let spare = wall.mul_f64(SPARE).min(MOST_SPARE);
            let left = wall.saturating_sub(start.elapsed() + spare);
            let takes = |batches: u32| {
                (batch * batches + self.writing.unwrap_or_default()).mul_f64(CAUTION)
            };
            if left < takes(1) {
                bits |= TIME;
            }
            if left < takes(NEAR) || self.longest.is_none() {
                bits |= SOON;
            }
        }
        bits
    }

    /// Records that an attempt to write a checkpoint `took` so long.
    pub fn wrote(&mut self, took: Duration) {
        self.writing = Some(took);
        self.written = Instant::now();
    }
}
