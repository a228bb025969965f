//! `phasewarp advise`: the coarsest grids and the cheapest set-ups whose density meets an accuracy.
//!
//! The error is `∫|ρ − ρ_exact| dx / ∫|ρ_exact| dx` at the end, `ρ_exact` averaged over the cells.
//! Schemes are tried on coarse grids without Schrödingerization, each grid twice as fine as the one
//! before. Without `[exact]` the error is Richardson's estimate from the distance `d` to a grid
//! twice as fine, `e = d/(1 − 2^{−q})`. The order `q` is measured and not assumed: discontinuous
//! solutions have about 1/2. The grid that reaches the accuracy lies between two that were tried,
//! or follows from the order; it is tried itself if the budget allows (`grid_search`).
//! Schrödingerization adds at most a tenth of the accuracy: its tolerance follows from the norms of
//! `f` ([`spread`](crate::study::density::spread)) and is tried on a coarse grid.
//!
//! Counted work decides what is tried, so that the advice does not depend on the machine; rank 0's
//! clock only stops a search that takes far longer than counted ([`crate::study::budget`]), and
//! `--reproducible` leaves that to counted work, too. Schemes
//! whose order is still open get finer grids from the rest of the budget (`rest`). If the
//! search finds nothing, or only set-ups that take longer than the search itself, it goes on with
//! as much work as this machine can do in the time that is left.

mod candidates;
mod grid_search;
pub mod reached_grid;
pub mod report;
mod rest;
pub mod scheme;
mod scheme_search;
pub mod settings;
pub mod setups;
pub mod trials;

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::here::refuse_too_large_here;
use crate::problem::case::{Case, Limiter, Method};
use crate::study::advise::reached_grid::{Evidence, ReachedGrid};
use crate::study::advise::report::{may_be_slow, warnings};
use crate::study::advise::scheme::SchemeChoice;
use crate::study::advise::settings::base_case;
use crate::study::advise::setups::{
    AdviceReport, GivenCase, SetupReport, SkippedSetup, mark_expensive, mark_too_long, nearest,
};
use crate::study::advise::trials::Trials;
use crate::study::budget::{Budget, BudgetClock, refuse_slow_grid};
use crate::study::trial::refuse_start_from_file;
use std::collections::BTreeMap;

/// Part of the budget up to which schemes are run by modes; the rest is for other fluxes of the
/// best.
const FOR_SCHEMES: f64 = 0.85;
/// If a run of the best set-up takes more than this part of the budget, the search goes on.
const EXPENSIVE: f64 = 0.25;
/// Seconds, 30 days: a set-up that is expected to take longer is an estimate, not advice.
const LONGEST_ADVISED: f64 = 30.0 * 86400.0;
/// Relative round-off by which an error may exceed the accuracy.
const ROUND_OFF: f64 = 1e-9;

/// The request of the user.
#[derive(Clone, Copy, Debug)]
pub struct AdviceRequest {
    /// Relative L1 error of the density.
    pub accuracy: f64,
    /// Seconds for all trials, about.
    pub budget: f64,
    /// What measures them.
    pub clock: BudgetClock,
}

/// Finds the set-ups of `case` that reach the accuracy of `request`, the same on all ranks.
/// Collective.
///
/// # Errors
/// [`Error::Input`] if nothing reaches the accuracy, and for a case that starts from a file; the
/// error of a trial if none succeeds.
pub fn advise(world: &World, case: &Case, request: AdviceRequest) -> Result<AdviceReport> {
    let budget = Budget::new(world, "advise (of its budget)", request.budget, request.clock);
    refuse_start_from_file(case, "advice takes other grids than that of the file")?;
    refuse_slow_grid(world, case, request.budget)?;
    let mut study = Study::new(world, case, request, budget)?;
    let mut advised = study.search();
    while study.may_find_cheaper(&advised) && study.trials.budget.recount() {
        advised = study.search();
    }
    advised
}

/// A set-up, with its case and plan if it can be run.
struct SetupCandidate {
    entry: SetupReport,
    planned: Option<(Case, Plan)>,
}

/// The search for advice: its trials, and the set-ups found so far.
struct Study<'a> {
    world: &'a World,
    case: &'a Case,
    request: AdviceRequest,
    /// Whether `V` jumps.
    jumps: bool,
    trials: Trials<'a>,
    /// Part of the budget up to which runs by modes are tried.
    share: f64,
    left_out: Vec<SkippedSetup>,
    candidates: Vec<SetupCandidate>,
    /// The budget in seconds that may hold the next grid of a scheme, for those whose order is
    /// open.
    wanted: BTreeMap<SchemeChoice, f64>,
    /// Whether the search ended without a failed trial.
    ended: bool,
}

impl<'a> Study<'a> {
    fn new(
        world: &'a World,
        case: &'a Case,
        request: AdviceRequest,
        budget: Budget,
    ) -> Result<Self> {
        let base = base_case(case)?;
        refuse_too_large_here(world, &base)?;
        let trials = Trials::new(world, base, case.exact.clone(), budget)?;
        Ok(Self {
            world,
            case,
            request,
            jumps: Bounds::new(case)?.jumps,
            trials,
            share: FOR_SCHEMES,
            left_out: Vec::new(),
            candidates: Vec::new(),
            wanted: BTreeMap::new(),
            ended: false,
        })
    }

    /// Searches within the budget; no trial is made twice. Collective.
    ///
    /// # Errors
    /// As [`advise`].
    fn search(&mut self) -> Result<AdviceReport> {
        (self.share, self.candidates, self.ended) = (FOR_SCHEMES, Vec::new(), false);
        self.left_out.clear();
        if self.case.varies() && !self.case.is_galerkin() {
            let why = "not possible if the inflow depends on time";
            self.left_out.push(SkippedSetup::new("slopes (scheme.limiter)", why));
        }
        self.try_own_grid()?;
        let mut found = self.grids_by_scheme()?;
        self.wanted.clear();
        self.price_next_grids(&found, 0.0);
        for reached in &found {
            self.add_set_ups(reached)?;
        }
        self.try_fluxes(&found)?;
        self.spend_rest(&mut found)?;
        let given = match found.iter().find(|found| found.scheme == SchemeChoice::of(self.case)) {
            Some(reached) => self.given_case(reached)?,
            None => None,
        };
        self.ended = true;
        self.advised(given)
    }

    /// Adds the set-ups of a scheme on its grid: the classical one, and that by modes if they can
    /// run it. Collective.
    fn add_set_ups(&mut self, reached: &ReachedGrid) -> Result<()> {
        self.add_classical(reached)?;
        match reached.scheme.limiter {
            Limiter::None => self.add_schrodingerized(reached),
            _ => Ok(()),
        }
    }

    /// Whether more trials may find something cheaper: the search ended and advises nothing, or its
    /// best set-up takes more than the part [`EXPENSIVE`] of the budget and is expected to take
    /// longer than the search did. Collective.
    fn may_find_cheaper(&self, advised: &Result<AdviceReport>) -> bool {
        let best = advised.as_ref().ok().and_then(|advised| advised.best_of(self.case.method));
        let Some(best) = best else { return self.ended };
        let budget = &self.trials.budget;
        let is_long = best.seconds.is_none_or(|seconds| seconds > budget.elapsed());
        !budget.fits_count(best.updates(), EXPENSIVE) && budget.decide(is_long)
    }

    fn name(&self, method: Method, scheme: SchemeChoice) -> String {
        scheme.name(method, self.jumps)
    }

    /// The advice: all set-ups, quickest first, with the best one by each method.
    fn advised(&mut self, given: Option<GivenCase>) -> Result<AdviceReport> {
        let candidates = std::mem::take(&mut self.candidates);
        let left_out = std::mem::take(&mut self.left_out);
        let Self { world, case, request, trials, .. } = self;
        let settled = |SetupCandidate { mut entry, planned }: SetupCandidate| {
            let predicted = planned.map(|(target, plan)| trials.seconds(&target, &plan));
            let counted = trials.budget.counted_seconds(entry.updates());
            entry.seconds = counted.or(entry.seconds).or(predicted);
            entry.seconds_counted = counted.is_some();
            entry.seconds_measured &= !entry.seconds_counted;
            entry.estimate = entry.not_settled(LONGEST_ADVISED);
            entry
        };
        let mut entries: Vec<SetupReport> = candidates.into_iter().map(settled).collect();
        let mut warnings = warnings(case, &entries, request.clock);
        mark_expensive(&mut entries, request.budget);
        mark_too_long(&mut entries, request.budget);
        // The least counted work; of equal ones the first, which has the case's own interface.
        let best = [Method::Schrodingerized, Method::Classical].map(|method| {
            (entries.iter())
                .filter(|e| e.refused.is_none() && e.estimate.is_none() && e.method == method)
                .min_by(|a, b| a.work().total_cmp(&b.work()))
                .map(|e| e.name.clone())
        });
        entries.sort_by(|a, b| {
            let seconds = |e: &SetupReport| e.seconds.unwrap_or(f64::INFINITY);
            let refused = a.refused.is_some().cmp(&b.refused.is_some());
            refused.then(seconds(a).total_cmp(&seconds(b)))
        });
        if entries.iter().all(|e| e.refused.is_some()) {
            return Err(out_of_reach(&case.name, request.accuracy, &entries));
        }
        let [best, best_classical] =
            best.map(|name| name.and_then(|name| entries.iter().position(|e| e.name == name)));
        let advised = [best, best_classical].into_iter().flatten();
        let slow = |k: usize| may_be_slow(&entries[k], &entries, request.budget);
        warnings.extend(advised.filter_map(slow));
        Ok(AdviceReport {
            title: case.title.clone(),
            accuracy: request.accuracy,
            ranks: world.group().size(),
            exact: trials.has_exact(),
            given,
            best,
            best_classical,
            entries,
            left_out,
            warnings,
        })
    }
}

/// The error for an accuracy that none of `entries` reaches, with the reason of the set-up that the
/// least longer budget may settle, or else of the one that has the fewest cells.
fn out_of_reach(name: &str, accuracy: f64, entries: &[SetupReport]) -> Error {
    let one_grid = |e: &SetupReport| e.known == Evidence::Extrapolated && e.order.pairs.is_empty();
    let all: Vec<&SetupReport> = entries.iter().collect();
    let nearest = nearest(&all);
    let verdict = if nearest.is_some() || entries.iter().any(one_grid) {
        "is not settled within this budget"
    } else {
        "is out of reach"
    };
    let reason =
        |e: &SetupReport| format!("{}: {}", e.name, e.refused.as_deref().unwrap_or_default());
    let fewest = || {
        let fewest = entries.iter().min_by(|a, b| a.cells.total_cmp(&b.cells));
        fewest.map_or(String::new(), |e| format!("With the fewest cells, {}", reason(e)))
    };
    let reason = nearest.map_or_else(fewest, reason);
    Error::Input(format!("{name}: --accuracy {accuracy:e} of the density {verdict}. {reason}"))
}
