//! The time that a study may take.
//!
//! Two measures: rank 0's clock, which decides for all ranks, and counted updates of unknowns, for
//! decisions that must be the same on every machine and on any number of ranks. A study that must
//! be reproducible takes a clock that counts, too ([`BudgetClock::Updates`]).

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::base::text::{rounded_up, short};
use crate::parallel::communicator::{Group, World};
use crate::plan::here::seconds_before_solving;
use crate::problem::case::Case;
use std::cell::RefCell;
use std::time::Instant;

/// Updates of an unknown that count as a second: at most a third of what a core does, so that it
/// holds on a busy machine, too.
const UPDATES_PER_SECOND: f64 = 4e7;
/// Updates a second of [`BudgetClock::Updates`]: what a core does.
const CLOCK_UPDATES_PER_SECOND: f64 = 3.0 * UPDATES_PER_SECOND;

/// Longest budget in seconds that is named to the user.
const LONGEST_BUDGET: f64 = 1e5;

/// Part of the time left that is allowed for, once the rate of this machine is known.
const OF_TIME_LEFT: f64 = 0.6;
/// Largest factor by which the allowed updates may grow when counting starts again.
const MOST_MORE: f64 = 4.0;

/// Budgets below this are no reason to refuse a grid here.
const SHORTEST: f64 = 0.1;
/// The first trial may take this many seconds whatever the budget: nothing is known before it.
const SHORTEST_TRIAL: f64 = 0.5;

/// Refuses a grid for which the steps before the first trial take longer than `limit` seconds.
/// Collective.
///
/// # Errors
/// [`Error::Input`].
pub fn refuse_slow_grid(world: &World, case: &Case, limit: f64) -> Result<()> {
    let cells = case.space.space_cells() as f64;
    world.group().on_first_rank(|| match seconds_before_solving(case) {
        seconds if seconds > limit.max(SHORTEST) => Err(Error::Input(format!(
            "{}: --budget {limit} s: evaluating V and bounds on {cells:.3e} cells of space takes \
             about {seconds:.0} s; fewer cells (axis.N.x.cells) or a longer budget",
            case.name
        ))),
        _ => Ok(()),
    })
}

/// A `budget` in seconds in words, rounded up.
pub fn longer(budget: f64) -> String {
    if budget < LONGEST_BUDGET {
        format!("a --budget of about {} s", short(rounded_up(budget)))
    } else {
        "a longer --budget".to_owned()
    }
}

/// Whole milliseconds of so many seconds.
fn milliseconds(seconds: f64) -> usize {
    (1e3 * seconds) as usize
}

/// The clock of a study.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BudgetClock {
    /// Rank 0's clock.
    Seconds,
    /// The counted updates at the rate of an average core, which are the same on every machine and
    /// on any number of ranks.
    Updates,
}

/// The time limit of a study, and the part of it that was used.
pub struct Budget {
    all: Group,
    clock: BudgetClock,
    started: Instant,
    limit: f64,
    /// Seconds after the start at which the part in progress is to end.
    end: f64,
    /// Seconds after the start at which counting began.
    counting_since: f64,
    counted: f64,
    /// All updates that were counted, also before counting started again.
    all_counted: f64,
    /// Updates that may be counted.
    allowed: f64,
    /// The part of the limit that has passed, as output.
    progress: RefCell<Progress>,
}

impl Budget {
    /// `limit` seconds from now on, of which the passing ones are shown as progress called `name`.
    pub fn new(world: &World, name: &'static str, limit: f64, clock: BudgetClock) -> Self {
        let prints = world.group().is_first();
        Self {
            all: world.group(),
            clock,
            progress: Progress::new(prints, name, milliseconds(limit)).into(),
            started: Instant::now(),
            all_counted: 0.0,
            limit,
            end: limit,
            counting_since: 0.0,
            counted: 0.0,
            allowed: limit * UPDATES_PER_SECOND,
        }
    }

    /// The group of all ranks.
    pub fn group(&self) -> &Group {
        &self.all
    }

    /// Seconds allowed.
    pub fn limit(&self) -> f64 {
        self.limit
    }

    /// Seconds since the start: by this rank's clock, or by what was counted.
    pub fn elapsed(&self) -> f64 {
        match self.clock {
            BudgetClock::Seconds => self.started.elapsed().as_secs_f64(),
            BudgetClock::Updates => self.all_counted / CLOCK_UPDATES_PER_SECOND,
        }
    }

    /// Seconds of work of so many `updates`, if the clock counts them.
    pub fn counted_seconds(&self, updates: f64) -> Option<f64> {
        (self.clock == BudgetClock::Updates).then_some(updates / CLOCK_UPDATES_PER_SECOND)
    }

    /// Whether a first trial of `seconds` fits into the budget. By this rank's clock.
    pub fn fits_first(&self, seconds: f64) -> bool {
        self.elapsed() + seconds <= self.limit.max(SHORTEST_TRIAL)
    }

    /// Ends the part in progress after `shares` of `parts` equal shares of the time left.
    pub fn share(&mut self, shares: usize, parts: usize) {
        let now = self.elapsed();
        let left = (self.limit - now).max(0.0);
        self.end = now + left * shares as f64 / parts.max(1) as f64;
    }

    /// Whether the time of the part in progress is over. Collective.
    pub fn is_over(&self) -> bool {
        !self.has_time_for(0.0)
    }

    /// Whether `seconds` more fit into the time of the part in progress. Collective.
    pub fn has_time_for(&self, seconds: f64) -> bool {
        self.decide(self.elapsed() + seconds <= self.end)
    }

    /// Rank 0's numbers on all ranks. Shows progress. Collective.
    pub fn from_rank_zero<const N: usize>(&self, mut numbers: [f64; N]) -> [f64; N] {
        if self.elapsed() < self.limit {
            self.progress.borrow_mut().advance_to(milliseconds(self.elapsed()));
        }
        if !self.all.is_first() {
            numbers = [f64::NEG_INFINITY; N];
        }
        self.all.max_into(&mut numbers);
        numbers
    }

    /// Rank 0's decision on all ranks. Collective.
    pub fn decide(&self, decision: bool) -> bool {
        self.from_rank_zero([f64::from(decision)])[0] > 0.5
    }

    /// Counts `updates` as used.
    pub fn count(&mut self, updates: f64) {
        self.counted += updates;
        self.all_counted += updates;
    }

    /// The part of the whole budget that was counted as used.
    pub fn used(&self) -> f64 {
        self.counted / self.allowed
    }

    /// The updates of this `part` of the whole budget.
    pub fn updates(&self, part: f64) -> f64 {
        part * self.allowed
    }

    /// Whether `updates` are at most this `part` of the whole budget.
    pub fn fits_count(&self, updates: f64, part: f64) -> bool {
        updates <= self.updates(part)
    }

    /// Whether `updates` more still fit into this `part` of the budget by count, and rank 0's clock
    /// has not passed the limit. Collective.
    pub fn fits(&self, updates: f64, part: f64) -> bool {
        let late = self.decide(self.elapsed() > self.limit);
        !late && self.fits_count(self.counted + updates, part)
    }

    /// A budget in seconds of which trials of `updates` take the `part`.
    pub fn seconds_for(updates: f64, part: f64) -> f64 {
        updates / (part * UPDATES_PER_SECOND)
    }

    /// Whether less than this `part` of the time has passed. Collective.
    pub fn is_before(&self, part: f64) -> bool {
        self.decide(self.elapsed() < part * self.limit)
    }

    /// Counts from zero, apart from what was counted so far, until [`resume_count`] gets the number
    /// that this returns.
    ///
    /// [`resume_count`]: Self::resume_count
    pub fn pause_count(&mut self) -> f64 {
        std::mem::take(&mut self.counted)
    }

    /// Goes on from the `counted` updates that [`pause_count`](Self::pause_count) returned.
    pub fn resume_count(&mut self, counted: f64) {
        self.counted = counted;
    }

    /// Starts counting from zero again. Allowed is then what this machine does in [`OF_TIME_LEFT`]
    /// of the time left, at the rate so far or since counting began, whichever is higher, and at
    /// most [`MOST_MORE`] times what was allowed before. Changes nothing and returns false if that
    /// is less than a quarter of it, or no more than it although nothing was counted. Collective.
    pub fn recount(&mut self) -> bool {
        let now = self.elapsed();
        if self.all_counted == 0.0 {
            return false;
        }
        let rate = self.all_counted / now;
        let rate = rate.max(self.counted / (now - self.counting_since));
        let [now, held] = self.from_rank_zero([now, OF_TIME_LEFT * rate * (self.limit - now)]);
        let least = if self.counted > 0.0 { 0.25 } else { 1.0 };
        let worth = held > least * self.allowed;
        if worth {
            (self.counting_since, self.allowed) = (now, held.min(MOST_MORE * self.allowed));
            self.counted = 0.0;
        }
        worth
    }
}
