//! When a checkpoint is made, and when the run stops: what all ranks decide between batches without
//! waiting for each other.
//!
//! A signal ends a batch before its end ([`crate::propagate::interruption`]); its rank then waits
//! for the others to vote.
//!
//! At the end of each batch a rank looks whether the last vote is over ([`Vote`]); if so it does
//! what was decided and posts the next one. A rank without batches left goes on voting until all
//! are finished. So all ranks see the same outcomes in the same order, whatever the number of their
//! batches, and wait for each other only to write and at the end of a stage.
//!
//! A vote is over a batch or two after it was posted, which is too late where the time runs out. So
//! when the wall time is near, and before the first batch shows how long one takes, ranks go
//! *together*: each waits, after its batch, for the vote that it posts then.

use crate::parallel::communicator::Communicator;
use crate::parallel::communicator::vote::Vote;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// A rank requests a checkpoint, ...
const WRITE: u64 = 1;
/// ... or has received a signal to stop, ...
const SIGNAL: u64 = 2;
/// ... or sees the time run out, ...
const TIME: u64 = 4;
/// ... or will soon, ...
const SOON: u64 = 8;
/// ... or has batches left, ...
const UNFINISHED: u64 = 16;
/// ... or failed.
const FAILED: u64 = 32;

/// Part of the wall time, at most [`MOST_SPARE`], that is left for the end of the program.
const SPARE: f64 = 0.02;
const MOST_SPARE: Duration = Duration::from_secs(30);
/// Factor by which an operation may take longer than the longest one before.
const CAUTION: f64 = 1.2;
/// Batches before the end from which on ranks go together: up to two until all know, one until they
/// did, one to go on with.
const NEAR: u32 = 4;
/// Bytes a second that a rank is expected to write before it is known.
const USUAL_RATE: f64 = 1e8;

/// How far a rank is in a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Standing {
    /// The rank has batches left.
    Working,
    /// The rank has finished its batches.
    Finished,
    /// The rank left a batch before its end, as the run is to stop.
    Left,
    /// A batch failed.
    Failed,
}

/// The common decision of the ranks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// No decision yet, or none needed.
    GoOn,
    /// To write a checkpoint.
    Write,
    /// Write a checkpoint and stop, after a signal.
    StopAsTold,
    /// The same, as the time runs out.
    StopInTime,
    /// All are finished: the stage is over.
    Finished,
    /// One failed: all leave.
    Failed,
}

/// When checkpoints are made.
#[derive(Clone, Debug, Default)]
pub struct CheckpointTimes {
    /// Every so often, by rank 0's clock.
    pub every: Option<Duration>,
    /// How long the program may take, and since when it does.
    pub wall: Option<(Instant, Duration)>,
    /// Raised when the run shall stop.
    pub stop: Arc<AtomicBool>,
}

/// The clock and the votes of a rank.
pub struct Watch {
    vote: Vote,
    times: CheckpointTimes,
    /// Whether its clock counts: rank 0's does.
    leads: bool,
    /// Whether ranks wait for each other's votes.
    together: bool,
    /// When the last checkpoint was begun or finished, or the run began.
    written: Instant,
    /// Whether the last vote was for none: however often they are wanted, there is a batch between
    /// two.
    rested: bool,
    /// How long a checkpoint takes to write; `None` before the first estimate.
    writing: Option<Duration>,
    /// When this rank began its batch, and how long the longest took, if there was one.
    begun: Option<Instant>,
    longest: Option<Duration>,
    /// Batches that this rank finished.
    pub batches: usize,
    /// When the vote was posted, and how long the longest took until its outcome was seen.
    posted: Instant,
    slowest: Duration,
}

impl Watch {
    /// Begins to watch. Collective.
    pub fn new(communicator: &Communicator, times: CheckpointTimes) -> Self {
        let now = Instant::now();
        Self {
            vote: Vote::new(&communicator.world),
            together: times.wall.is_some(),
            times,
            leads: communicator.world.rank() == 0,
            written: now,
            rested: true,
            writing: None,
            begun: None,
            longest: None,
            batches: 0,
            posted: now,
            slowest: Duration::ZERO,
        }
    }

    /// Size in bytes of a checkpoint of this rank. It predicts the time of the first checkpoint.
    pub fn expect(&mut self, bytes: impl FnOnce() -> usize) {
        (self.writing).get_or_insert_with(|| Duration::from_secs_f64(bytes() as f64 / USUAL_RATE));
    }

    /// This rank continues with its next batch, if any.
    pub fn begin(&mut self, standing: Standing) {
        self.begun = (standing == Standing::Working).then(Instant::now);
    }

    /// The common decision of all ranks, at the beginning of a stage and after each batch (see
    /// [`begin`](Self::begin)). After `Write` they decide again. `Finished`, `Failed` or a stop is
    /// the last decision of a stage. Collective over the space group, whose ranks have the same
    /// `standing`.
    pub fn decide(&mut self, communicator: &Communicator, standing: Standing) -> Verdict {
        if let Some(begun) = self.begun.take() {
            self.longest = self.longest.max(Some(begun.elapsed()));
            let ended = !matches!(standing, Standing::Left | Standing::Failed);
            self.batches += usize::from(ended);
        }
        loop {
            if !self.vote.is_posted() {
                self.post(standing);
            }
            // A rank with batches left polls the vote; a rank without batches waits for it.
            if standing == Standing::Working && !self.together && !self.is_over(communicator) {
                return Verdict::GoOn;
            }
            let outcome = self.vote.take();
            self.slowest = self.slowest.max(self.posted.elapsed());
            let has = |bit| outcome & bit != 0;
            let verdict = match () {
                () if has(FAILED) => Verdict::Failed,
                () if !has(UNFINISHED) => Verdict::Finished,
                () if has(SIGNAL) => Verdict::StopAsTold,
                () if has(TIME) => Verdict::StopInTime,
                () if has(WRITE) => Verdict::Write,
                () => Verdict::GoOn,
            };
            let stale = has(SOON) && !self.together;
            self.together = has(SOON);
            self.rested = verdict != Verdict::Write;
            if !self.rested {
                self.written = Instant::now();
            }
            if matches!(verdict, Verdict::GoOn | Verdict::Write) && !self.together {
                self.post(standing);
            }
            if verdict != Verdict::GoOn || !stale {
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
            _ => space.max_count(usize::from(!over)) == 0,
        }
    }

    fn post(&mut self, standing: Standing) {
        let mut bits = match standing {
            Standing::Working => UNFINISHED,
            Standing::Finished => 0,
            Standing::Left => UNFINISHED | SIGNAL,
            Standing::Failed => UNFINISHED | FAILED,
        };
        if self.times.stop.load(Ordering::Relaxed) {
            bits |= SIGNAL;
        }
        if self.leads {
            bits |= self.hands();
        }
        self.posted = Instant::now();
        self.vote.post(bits);
    }

    /// The decision by wall time.
    fn hands(&self) -> u64 {
        let mut bits = 0;
        let due = |every: Duration| self.written.elapsed() >= every;
        if self.rested && self.times.every.is_some_and(due) {
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

    /// A checkpoint was tried and took so long.
    pub fn wrote(&mut self, took: Duration) {
        self.writing = Some(took);
        self.written = Instant::now();
    }
}
