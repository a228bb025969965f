//! The attempts of a chart: each setting is run, refused or left out, one after the other.
//!
//! Rank 0's clock decides for all ranks. Predictions use numbers that all ranks have, so that
//! leaving out a setting takes two short messages, and none once the budget is used up.

use crate::base::error::{Error, Result};
use crate::base::text::time_text;
use crate::parallel::communicator::World;
use crate::problem::case::{Case, Limiter, Reductions};
use crate::problem::grid::PhaseSpace;
use crate::run::Solution;
use crate::scheme::reduce::reduced;
use crate::solve::prepared::Prepared;
use crate::study::budget::Budget;
use crate::study::chart::entry::{ChartEntry, Status};
use crate::study::chart::programme::{Programme, Setting};
use crate::study::chart::setup::{Setup, refused};
use crate::study::choices::row_choices;
use crate::study::cost::{CostModel, GridKey, TrialSeconds};
use crate::study::trial::{seconds_of_result, trial};
use std::time::Instant;

/// Largest part of the budget that a trial may take, so that many methods are tried.
const LARGEST_PART: f64 = 0.125;
/// Largest part of the budget that a trial of the case as given may take.
const GIVEN_PART: f64 = 0.25;
/// A trial is begun only if this many times its expected seconds are left.
const MARGIN: f64 = 1.3;
/// Methods are compared on the finest grid where the first trials of all profiles together take at
/// most this part of the budget.
const COMPARED: f64 = 0.1;
/// A trial that takes at most this part of the budget is repeated: short times are noisy.
const QUICK: f64 = 5e-4;
/// Number of runs of such a trial.
const REPEATS: usize = 3;

/// The key of the reduction of a case, which depends on its grid and its scheme.
fn reduction_key(case: &Case) -> GridKey {
    let slopes = case.scheme.limiter != Limiter::None;
    GridKey::new(case, format!("{} {:?} {slopes}", row_choices(case), case.method))
}

/// The grid of a case after its reduction.
struct ReducedGrid {
    key: GridKey,
    space: PhaseSpace,
    reductions: Reductions,
}

/// Expected seconds of a trial.
#[derive(Clone, Copy)]
struct ExpectedSeconds {
    seconds: f64,
    /// Whether the seconds are only a lower bound.
    at_least: bool,
}

/// The grid on which a chart compares methods.
pub(crate) struct ComparedGrid {
    /// The grid.
    pub space: PhaseSpace,
    /// The reason why it is coarser than the case's own; `None` if it is not.
    pub why_coarser: Option<String>,
}

/// The entry of `case` that is refused for this `reason`.
fn refusal(case: &Case, reason: String) -> ChartEntry {
    ChartEntry { reason: Some(reason), ..ChartEntry::of(case, Status::Refused) }
}

/// All attempts of a chart so far.
pub(crate) struct Attempts<'a> {
    world: &'a World,
    case: &'a Case,
    /// The case with elements of other degrees.
    degrees: &'a [Case],
    /// Whether `V` jumps.
    jumps: bool,
    budget: Budget,
    /// Whether the budget is used up, on all ranks.
    over: bool,
    cost: CostModel,
    reduced_grids: Vec<ReducedGrid>,
    tried: Vec<Setting>,
    /// The entry of each setting tried, in order.
    pub entries: Vec<ChartEntry>,
    /// The error of the first trial that failed.
    pub first_error: Option<Error>,
    /// Whether the solution is zero everywhere; unknown before the first trial.
    pub zero: Option<bool>,
}

impl<'a> Attempts<'a> {
    /// A chart of `case`, and of the case with elements of other `degrees`, within `budget`, before
    /// any attempt.
    pub fn new(
        world: &'a World,
        case: &'a Case,
        degrees: &'a [Case],
        jumps: bool,
        budget: Budget,
    ) -> Self {
        Self {
            world,
            case,
            degrees,
            jumps,
            budget,
            over: false,
            cost: CostModel::default(),
            reduced_grids: Vec::new(),
            tried: Vec::new(),
            entries: Vec::new(),
            first_error: None,
            zero: None,
        }
    }

    /// Tries the settings of `programme`, and the case as given. Returns the grid on which methods
    /// are compared. Collective.
    ///
    /// # Errors
    /// That of the first trial, if every method fails on two grids: all others would fail, too.
    pub fn run_programme(&mut self, programme: &Programme) -> Result<ComparedGrid> {
        self.try_all(programme.every_method());
        let given = Setting { space: self.case.space.clone(), setup: Setup::Given, flux: None };
        self.try_all(vec![given]);
        self.try_all(programme.own_grid());
        if !self.has_results() {
            return Err(self.why_nothing_ran());
        }
        let compared = self.grid_for_comparison(programme);
        self.try_all(programme.every_choice(&compared.space));
        self.try_all(programme.other_degrees());
        self.try_all(programme.other_grids());
        self.try_all(programme.other_fluxes());
        self.try_all(programme.everything(&compared.space));
        Ok(compared)
    }

    /// The case with elements of the degree of `space`.
    fn base(&self, space: &PhaseSpace) -> &'a Case {
        let other = self.degrees.iter().find(|case| case.space.degree() == space.degree());
        other.unwrap_or(self.case)
    }

    /// Whether anything ran.
    pub fn has_results(&self) -> bool {
        self.entries.iter().any(|e| e.status == Status::Done)
    }

    /// The error that nothing could be run: that of the first trial that failed, or that none fits
    /// into the budget.
    fn why_nothing_ran(&mut self) -> Error {
        if let Some(error) = self.first_error.take() {
            return error;
        }
        let quickest = (self.entries.iter())
            .filter_map(|entry| Some((entry.expected_seconds?, entry.grid.as_str())))
            .min_by(|a, b| a.0.total_cmp(&b.0));
        let (seconds, grid) = quickest.unwrap_or((0.0, ""));
        let limit = self.budget.limit();
        let why = if seconds < limit {
            format!("no time is left for a run on {grid}, the coarsest grid")
        } else {
            let seconds = time_text(seconds);
            format!("a run on {grid}, the coarsest grid, is expected to take at least {seconds}")
        };
        Error::Input(format!(
            "{}: --budget {limit} s: {why}; fewer cells (axis.N.x.cells, axis.N.v.cells) or a \
             longer budget",
            self.case.name
        ))
    }

    /// Seconds since the beginning, by this rank's clock.
    pub fn elapsed(&self) -> f64 {
        self.budget.elapsed()
    }

    /// Tries `settings` in order, each once. Collective.
    pub fn try_all(&mut self, settings: Vec<Setting>) {
        for setting in settings {
            let usual = setting.flux == Some(self.base(&setting.space).scheme.flux);
            if !usual && !self.tried.contains(&setting) {
                let entry = self.attempt(&setting);
                self.entries.push(entry);
                self.tried.push(setting);
            }
        }
    }

    /// Runs, refuses or leaves out one setting. Collective.
    fn attempt(&mut self, setting: &Setting) -> ChartEntry {
        let base = self.base(&setting.space);
        let mut case = setting.apply(base, None);
        let entry = self.outcome(&mut case, setting).unwrap_or_else(|error| {
            let reason = error.to_string();
            self.first_error.get_or_insert(error);
            refusal(&case, reason)
        });
        ChartEntry {
            as_given: setting.setup == Setup::Given,
            paper: matches!(setting.setup, Setup::Paper { .. }),
            no_jump: !self.jumps || case.is_galerkin(),
            ..entry
        }
    }

    /// Runs, refuses or leaves out `setting`, and sets the interval of `case` if it is the paper's
    /// set-up. Collective.
    ///
    /// # Errors
    /// Those of reducing, measuring and running the case.
    fn outcome(&mut self, case: &mut Case, setting: &Setting) -> Result<ChartEntry> {
        let setup = &setting.setup;
        if let Some(why) = refused(case) {
            return Ok(refusal(case, why));
        }
        let at_least = |seconds| ExpectedSeconds { seconds, at_least: true };
        if self.is_over() {
            return Ok(self.left_out(case, setting, at_least(self.least_seconds(case))));
        }
        if self.with_known_reduction(case).is_none() {
            let least = self.least_seconds(case);
            if !self.budget.decide(self.fits(setup, least)) {
                return Ok(self.left_out(case, setting, at_least(least)));
            }
        }
        let mut reduced_case = self.reduce(case)?;
        // The paper's interval depends on measured bounds of the matrix.
        if matches!(setup, Setup::Paper { .. }) {
            let least = (self.cost).overhead(&reduced_case, reduced_case.space.cells() as f64);
            if !self.budget.decide(self.fits(setup, least)) {
                return Ok(self.left_out(case, setting, at_least(least)));
            }
            let Prepared { bounds, .. } = Prepared::here(self.world, &reduced_case)?;
            *case = setting.apply(self.base(&setting.space), Some(&bounds));
            reduced_case.warp = case.warp.clone();
        }
        let (expected, error) = self.predicted_seconds(&reduced_case);
        // With measured bounds the plan of the trial fails, too; without them it may succeed.
        if self.budget.decide(error.is_some() && self.cost.is_measured(&reduced_case)) {
            let reason = error.map_or(String::new(), |e| e.to_string());
            return Ok(refusal(case, reason));
        }
        // A lower bound does not show that a trial fits. One that cannot be planned fails at once.
        let known = !expected.at_least || error.is_some();
        if !self.budget.decide(known && self.fits(setup, expected.seconds)) {
            return Ok(self.left_out(case, setting, expected));
        }
        let (trial, seconds) = self.trial_with_seconds(&reduced_case)?;
        self.cost.learn(&reduced_case, &trial.plan, seconds);
        if self.zero.is_none() {
            let all = trial.results.fields.iter().flatten();
            let largest = all.fold(0.0, |largest, f| f64::max(largest, f.abs()));
            self.zero = Some(self.budget.group().max(largest) == 0.0);
        }
        Ok(ChartEntry::done(case, &trial, seconds))
    }

    /// The entry of `case`, which is left out and expected to take this long; at least as long as
    /// the same set-up on coarser grids.
    fn left_out(&self, case: &Case, setting: &Setting, expected: ExpectedSeconds) -> ChartEntry {
        let ExpectedSeconds { seconds, at_least } = expected;
        let coarser = self.seconds_on_coarser(setting);
        ChartEntry {
            expected_seconds: Some(seconds.max(coarser)),
            expected_at_least: at_least || coarser > seconds,
            ..ChartEntry::of(case, Status::LeftOut)
        }
    }

    /// Whether the budget is used up, once anything ran. Collective until it is.
    fn is_over(&mut self) -> bool {
        if !self.over {
            let used_up = self.has_results() && self.elapsed() > self.budget.limit();
            self.over = self.budget.decide(used_up);
        }
        self.over
    }

    /// Whether a trial of `seconds` fits into the budget. The first result may take all of it.
    fn fits(&self, setup: &Setup, seconds: f64) -> bool {
        if !self.has_results() {
            return self.budget.fits_first(seconds);
        }
        let limit = self.budget.limit();
        let room = self.elapsed() + MARGIN * seconds <= limit;
        let part = match setup {
            Setup::Given => GIVEN_PART,
            _ => LARGEST_PART,
        };
        room && seconds <= part * limit
    }

    /// Seconds of the same set-up, measured or expected, on grids of fewer cells: a lower bound.
    fn seconds_on_coarser(&self, setting: &Setting) -> f64 {
        let cells = setting.space.cells();
        let same = |s: &Setting| s.setup == setting.setup && s.flux == setting.flux;
        let coarser = |s: &Setting| same(s) && s.space.cells() < cells;
        (self.tried.iter().zip(&self.entries))
            .filter(|(tried, _)| coarser(tried))
            .filter_map(|(_, e)| e.expected_seconds.or(e.total_seconds))
            .fold(0.0, f64::max)
    }

    /// A lower bound on the seconds of a trial before its grid is reduced. It assumes the same part
    /// of needed cells as on the last reduced grid of this scheme.
    fn least_seconds(&self, case: &Case) -> f64 {
        let scheme = reduction_key(case).choices;
        let mut latest = self.reduced_grids.iter().rev();
        let part = (latest.find(|grid| grid.key.choices == scheme))
            .map_or(1.0, |grid| grid.space.cells() as f64 / grid.key.cells() as f64);
        self.cost.overhead(case, part * case.space.cells() as f64)
    }

    /// Expected seconds of a trial of `case`, and the error if it cannot be planned. They are a
    /// lower bound if it takes much too long anyway.
    fn predicted_seconds(&mut self, case: &Case) -> (ExpectedSeconds, Option<Error>) {
        let least = self.cost.overhead(case, case.space.cells() as f64);
        let at_least = |seconds| ExpectedSeconds { seconds, at_least: true };
        if self.has_results() && least > LARGEST_PART * self.budget.limit() {
            return (at_least(least), None);
        }
        match self.cost.work(case) {
            Ok(work) => {
                let seconds = self.cost.seconds(case, work);
                (ExpectedSeconds { seconds, at_least: false }, None)
            }
            Err(error) => (at_least(least), Some(error)),
        }
    }

    /// `case` reduced to the cells that it needs, if these are known.
    fn with_known_reduction(&self, case: &Case) -> Option<Case> {
        let key = reduction_key(case);
        let known = self.reduced_grids.iter().find(|grid| grid.key == key)?;
        Some(Case {
            space: known.space.clone(),
            reductions: known.reductions.clone(),
            ..case.clone()
        })
    }

    /// `case` reduced to the cells that it needs. Collective.
    fn reduce(&mut self, case: &Case) -> Result<Case> {
        if let Some(known) = self.with_known_reduction(case) {
            return Ok(known);
        }
        let found = reduced(self.budget.group(), case)?;
        self.reduced_grids.push(ReducedGrid {
            key: reduction_key(case),
            space: found.space.clone(),
            reductions: found.reductions.clone(),
        });
        Ok(found)
    }

    /// A trial and its seconds; a quick one is repeated, and the least seconds count. Collective.
    fn trial_with_seconds(&self, case: &Case) -> Result<(Solution, TrialSeconds)> {
        let once = || -> Result<(Solution, [f64; 3])> {
            let began = Instant::now();
            let trial = trial(self.world, case)?;
            let [result, solve] = [seconds_of_result(&trial.summary), trial.summary.solve_seconds];
            let mine = [result, solve, began.elapsed().as_secs_f64()];
            Ok((trial, self.budget.from_rank_zero(mine)))
        };
        let (trial, mut least) = once()?;
        for _ in 1..REPEATS {
            if least[2] > QUICK * self.budget.limit() {
                break;
            }
            let (_, again) = once()?;
            least = std::array::from_fn(|k| least[k].min(again[k]));
        }
        let [result, solve, total] = least;
        let seconds = TrialSeconds { result, solve, total };
        Ok((trial, seconds))
    }

    /// The finest grid, up to the case's own, on which the budget holds the comparison of methods
    /// by the estimate of rank 0. Collective.
    fn grid_for_comparison(&mut self, programme: &Programme) -> ComparedGrid {
        let Programme { grids, own, .. } = programme;
        let mut reason = |k: usize| self.too_expensive(&programme.profiles(&grids[k]));
        let why = reason(*own);
        let coarser = |_| (0..*own).rev().find(|&k| reason(k).is_none()).unwrap_or(0);
        let finest = why.as_ref().map_or(*own, coarser);
        let [finest] = self.budget.from_rank_zero([finest as f64]);
        let finest = (finest as usize).min(*own);
        let why_coarser = why.filter(|_| finest < *own);
        ComparedGrid { space: grids[finest].clone(), why_coarser }
    }

    /// The reason why these trials together are too expensive to compare methods on their grid.
    fn too_expensive(&mut self, settings: &[Setting]) -> Option<String> {
        let allowed = COMPARED * self.budget.limit();
        if self.elapsed() > self.budget.limit() {
            return Some("the budget was used up before it".to_owned());
        }
        let (mut sum, mut bound) = (0.0, "");
        for setting in settings {
            let case = setting.apply(self.base(&setting.space), None);
            let overhead = self.least_seconds(&case);
            if sum + overhead > allowed {
                (sum, bound) = (sum + overhead, "at least ");
                break;
            }
            let case = self.with_known_reduction(&case).unwrap_or(case);
            // Refused settings cost nothing.
            if let Ok(work) = self.cost.work(&case) {
                sum += self.cost.seconds(&case, work);
            }
        }
        (sum > allowed).then(|| {
            format!(
                "a trial of each profile there is expected to take {bound}{} in all, \
                 more than {} of the budget",
                time_text(sum),
                time_text(allowed)
            )
        })
    }
}
