//! The rest of the budget: finer grids of schemes whose order is not known yet.
//!
//! Counting allows for about a third of what a core does, so time is left when the search has
//! used all that it may count. As much is counted then once more, for the next grid of each scheme
//! whose order is assumed or from one pair of errors, cheapest first. So it is known beforehand
//! which budget holds the next grid of a scheme.

use crate::base::error::Result;
use crate::problem::case::{Limiter, Method};
use crate::study::advise::Study;
use crate::study::advise::grid_search::{SearchStart, next_grid};
use crate::study::advise::reached_grid::ReachedGrid;
use crate::study::budget::Budget;

/// Part of what is counted once more, for their next grids; what is left is for grids that follow
/// from these, and for runs by modes.
const FOR_NEXT_GRIDS: f64 = 0.7;
/// Part of the time within which the rest may be begun.
const LATEST: f64 = 0.6;

/// The next grid of a scheme whose order is open.
struct NextGrid {
    /// Index of the scheme.
    of: usize,
    shape: Vec<usize>,
    /// Updates that its trial counts as.
    updates: f64,
}

impl Study<'_> {
    /// The next grids of the schemes in `found` whose order is open, cheapest first.
    fn next_grids(&mut self, found: &[ReachedGrid]) -> Vec<NextGrid> {
        let open = found.iter().enumerate().filter(|(_, reached)| reached.is_open());
        let trials = &mut self.trials;
        let next = |(of, reached): (usize, &ReachedGrid)| {
            let shape = next_grid(trials, reached);
            let updates = trials.updates_to_try(reached.scheme, &shape).unwrap_or(f64::INFINITY);
            NextGrid { of, shape, updates }
        };
        let mut grids: Vec<NextGrid> = open.map(next).collect();
        grids.sort_by(|a, b| a.updates.total_cmp(&b.updates));
        grids
    }

    /// Finds the budgets that hold the next grids of schemes in `found` whose order is open, each
    /// with those that are cheaper, after trials of so many `updates`.
    pub(super) fn price_next_grids(&mut self, found: &[ReachedGrid], mut updates: f64) {
        for next in self.next_grids(found) {
            updates += next.updates;
            let seconds = Budget::seconds_for(updates, FOR_NEXT_GRIDS);
            // Where this budget should have held it, the clock was faster.
            let given = self.request.budget;
            let budget = if seconds > given { seconds } else { 2.0 * given };
            self.wanted.insert(found[next.of].scheme, budget);
        }
    }

    /// Spends what is left of the time on schemes in `found` whose order is open, and replaces
    /// their grids and set-ups. Collective.
    ///
    /// # Errors
    /// As [`Study::add_set_ups`].
    pub(super) fn spend_rest(&mut self, found: &mut [ReachedGrid]) -> Result<()> {
        let next_grids = self.next_grids(found);
        if next_grids.is_empty() || !self.trials.budget.is_before(LATEST) {
            return Ok(());
        }
        let counted = self.trials.budget.pause_count();
        let done = self.refine_open(next_grids, found);
        self.trials.budget.resume_count(counted);
        done
    }

    /// As [`spend_rest`](Self::spend_rest), for these `next` grids.
    fn refine_open(&mut self, next: Vec<NextGrid>, found: &mut [ReachedGrid]) -> Result<()> {
        let (mut tried, mut spent) = (Vec::new(), 0.0);
        for NextGrid { of, shape, updates } in next {
            let scheme = found[of].scheme;
            if !self.trials.affords(scheme, &shape, FOR_NEXT_GRIDS)? {
                break;
            }
            // A failed trial leaves the set-up as it was.
            if self.trials.run(scheme, &shape).is_ok() {
                tried.push(of);
                spent += updates;
            }
        }
        for (k, &of) in tried.iter().enumerate() {
            let share = (k + 1) as f64 / tried.len() as f64;
            let (scheme, start) = (found[of].scheme, found[of].first().to_vec());
            // A failed search does not replace the grid.
            let start = SearchStart { shape: &start, balance: false };
            if let Ok(reached) = self.coarsest(scheme, start, share) {
                found[of] = reached;
            }
        }
        self.price_next_grids(found, spent);
        self.share = 1.0;
        for of in tried {
            let scheme = found[of].scheme;
            let mut names = vec![self.name(Method::Classical, scheme)];
            // Set-ups with slopes have the name of those without by modes, which they have not.
            if scheme.limiter == Limiter::None {
                names.push(self.name(Method::Schrodingerized, scheme));
            }
            self.candidates.retain(|candidate| !names.contains(&candidate.entry.name));
            self.left_out.retain(|left| left.grid.is_none() || !names.contains(&left.name));
            self.add_set_ups(&found[of])?;
        }
        Ok(())
    }
}
