//! `phasewarp advise`: the coarsest grids and the cheapest set-ups whose density meets an accuracy.
//!
//! The error is `∫|ρ − ρ_exact| dx / ∫|ρ_exact| dx` at the end, `ρ_exact` averaged over the cells.
//! Schemes are tried on coarse grids without Schrödingerization, each grid twice as fine as the one
//! before. Without `[exact]` the error is that of Richardson: from the distance `d` to a grid twice
//! as fine, `e = d/(1 − 2^{−q})`. The order `q` is measured and not assumed: discontinuous
//! solutions have about 1/2. The grid that reaches the accuracy lies between two that were tried,
//! or follows from the order; it is tried itself where the budget allows ([`grid_search`]).
//! Schrödingerization adds at most a tenth of the accuracy: its tolerance follows from the norms of
//! `f` ([`density::spread`]) and is tried on a coarse grid.
//!
//! Counted work decides what is tried, so that the advice does not depend on the machine; rank 0's
//! clock only stops a search that takes far longer than counted ([`crate::study::budget`]). If the
//! search finds nothing, or only set-ups that take longer than the search itself, it goes on with
//! as much work as this machine can do in the time that is left.

pub mod density;
pub mod grid_search;
pub mod order;
pub mod report;
pub mod scheme;
pub mod settings;
pub mod setups;
pub mod trials;

use crate::base::error::{Error, Result};
use crate::base::text::{bytes_text, rounded_down};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::here::refuse_too_large_here;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Data, LARGEST_TOLERANCE, Limiter, MeasurementEffort, Method};
use crate::problem::potential::overlooked;
use crate::run::planning;
use crate::study::advise::density::distance;
use crate::study::advise::grid_search::{
    DISCRETISATION, DensityError, Evidence, Goal, ReachedGrid, coarsest_grid, error_on, grid_near,
};
use crate::study::advise::report::{MOST_SHOWN, grid_text, warnings};
use crate::study::advise::scheme::SchemeChoice;
use crate::study::advise::settings::{base_case, command, settings};
use crate::study::advise::setups::{
    AdviceReport, ErrorParts, GivenCase, SetupReport, mark_unsettled_expensive,
};
use crate::study::advise::trials::{Trials, cells, mode_updates};
use crate::study::budget::refuse_slow_potential;
use crate::study::grids::{MOST_PLANNED_SPACE_CELLS, shape_text};
use crate::study::trial::{final_fields_only, refuse_start_from_file};

/// Largest part of the accuracy that the error of Schrödingerization may take.
const SCHRODINGERIZATION: f64 = 0.1;
/// Part of the budget for the grid searches of all schemes.
const FOR_GRIDS: f64 = 0.7;
/// Largest part of the budget that a run by modes on the coarse grid of a tolerance trial may take.
const FOR_MODES: f64 = 0.05;
/// Part of the budget up to which tolerances are tried on that grid.
const FOR_TOLERANCES: f64 = 0.8;
/// Part of the budget up to which schemes run by modes; the rest is for other fluxes of the best.
const FOR_SCHEMES: f64 = 0.85;
/// Largest part of the budget that a trial of the case on its own grid may take.
const FOR_CASE: f64 = 0.1;
/// If a run of the best set-up takes more than this part of the budget, the search goes on.
const EXPENSIVE: f64 = 0.25;
/// Seconds, 30 days: a set-up that is expected to take longer is an estimate, not advice.
const LONGEST_ADVISED: f64 = 30.0 * 86400.0;
/// The smallest tolerance that is advised.
const SMALLEST_TOLERANCE: f64 = 1e-12;
/// Largest number of tolerances that are tried.
const MOST_TOLERANCES: usize = 4;
/// Grids of more elements of space than this are not searched for regions of `V` without a cell.
const MOST_SEARCHED: usize = 1 << 17;
/// Largest number of cells of which a plan is made.
const MOST_CELLS: f64 = 1e11;
/// Bytes of memory a cell, of runs by modes and of classical runs, for grids that are not planned.
const BYTES: [f64; 2] = [340.0, 70.0];
/// Relative round-off by which an error may exceed the accuracy.
const ROUND_OFF: f64 = 1e-9;

/// What the user asks for.
#[derive(Clone, Copy, Debug)]
pub struct Request {
    /// Relative L1 error of the density.
    pub accuracy: f64,
    /// Seconds for all trials, about.
    pub budget: f64,
}

/// Finds the set-ups of `case` that are as exact as `request`. Collective; the same on all ranks.
///
/// # Errors
/// [`Error::Input`] where nothing reaches the accuracy, and for a case that starts from a warped
/// field; the error of a trial where none succeeds.
pub fn advise(world: &World, case: &Case, request: Request) -> Result<AdviceReport> {
    refuse_start_from_file(case, "advice takes other grids than that of the file")?;
    refuse_slow_potential(world, case, request.budget)?;
    let mut study = Study::new(world, case, request)?;
    let mut advised = study.search();
    while study.may_find_cheaper(&advised) && study.trials.budget.count_anew() {
        advised = study.search();
    }
    advised
}

/// A set-up, with its case and plan if it can be run.
struct SetupCandidate {
    entry: SetupReport,
    planned: Option<(Case, Plan)>,
}

/// A tolerance of Schrödingerization, tried on a coarse grid.
struct ToleranceTrial {
    tolerance: f64,
    /// Relative L1 error of the density that Schrödingerization adds on that grid, if it was tried.
    measured: Option<f64>,
    /// A bound on that error, if one is known.
    bound: Option<f64>,
}

/// The result of the search for the grid of a scheme.
enum SearchResult {
    /// The grid that was found.
    Found(ReachedGrid),
    /// The budget does not hold a run on the first grid, which has this shape.
    BudgetTooSmall(Vec<usize>),
    /// A trial failed.
    Failed(Error),
}

/// The search for advice: its trials, and the set-ups found so far.
struct Study<'a> {
    world: &'a World,
    case: &'a Case,
    request: Request,
    /// Whether `V` jumps.
    jumps: bool,
    trials: Trials<'a>,
    /// Part of the budget up to which runs by modes are tried.
    share: f64,
    left_out: Vec<String>,
    candidates: Vec<SetupCandidate>,
    /// Whether the search came to an end, and did not fail at a trial.
    ended: bool,
}

impl<'a> Study<'a> {
    fn new(world: &'a World, case: &'a Case, request: Request) -> Result<Self> {
        let base = base_case(case)?;
        refuse_too_large_here(world, &base)?;
        let trials = Trials::new(world, base, case.exact.clone(), request.budget)?;
        Ok(Self {
            world,
            case,
            request,
            jumps: Bounds::new(case)?.jumps,
            trials,
            share: FOR_SCHEMES,
            left_out: Vec::new(),
            candidates: Vec::new(),
            ended: false,
        })
    }

    /// Searches within the budget; no trial is made twice. Collective.
    ///
    /// # Errors
    /// As [`advise`].
    fn search(&mut self) -> Result<AdviceReport> {
        (self.share, self.candidates, self.ended) = (FOR_SCHEMES, Vec::new(), false);
        self.left_out = match self.case.varies() && !self.case.is_galerkin() {
            true => {
                vec!["slopes (scheme.limiter): not with an inflow that depends on time".to_owned()]
            }
            false => Vec::new(),
        };
        self.try_as_it_stands()?;
        let found = self.grids_by_scheme()?;
        for (scheme, reached) in &found {
            self.add_classical(*scheme, reached)?;
            if scheme.limiter == Limiter::None {
                self.add_schrodingerized(*scheme, reached)?;
            }
        }
        self.try_fluxes(&found)?;
        let given = match found.iter().find(|(scheme, _)| *scheme == SchemeChoice::of(self.case)) {
            Some((scheme, reached)) => self.given(*scheme, reached)?,
            None => None,
        };
        self.ended = true;
        self.advised(given)
    }

    /// Whether more trials may find something cheaper: the search ended and advises nothing, or its
    /// best set-up takes more than the part [`EXPENSIVE`] of the budget and is expected to take
    /// longer than the search did. Collective.
    fn may_find_cheaper(&self, advised: &Result<AdviceReport>) -> bool {
        let best = advised.as_ref().ok().and_then(|advised| advised.best_of(self.case.method));
        let Some(best) = best else { return self.ended };
        let budget = &self.trials.budget;
        let is_long = best.seconds.is_none_or(|seconds| seconds > budget.elapsed());
        !budget.holds(best.updates(), EXPENSIVE) && budget.decide(is_long)
    }

    fn name(&self, method: Method, scheme: SchemeChoice) -> String {
        scheme.name(method, self.jumps)
    }

    /// Tries the case's own grid first where that is cheap, so that its error is not extrapolated.
    /// Collective.
    fn try_as_it_stands(&mut self) -> Result<()> {
        let (scheme, own) = (SchemeChoice::of(self.case), self.case.space.elements());
        let trials = &mut self.trials;
        if trials.is_cheap(scheme, &own, FOR_CASE)? {
            let twice = trials.degree_case(scheme).grids.twice(&own);
            let known = match trials.error(scheme, &own) {
                Ok(None) if trials.is_cheap(scheme, &twice, FOR_CASE)? => {
                    trials.run(scheme, &twice).map(|_| ())
                }
                other => other.map(|_| ()),
            };
            if let Err(error) = known {
                let name = scheme.name(Method::Classical, self.jumps);
                self.left_out.push(format!("{name} as it stands: {error}"));
            }
        }
        Ok(())
    }

    /// The first grid of trials of `scheme`: the coarsest; or the case's own, if the data are so
    /// narrow that no cell of the coarsest grid holds them. Collective.
    fn start(&mut self, scheme: SchemeChoice) -> Vec<usize> {
        let degree_case = self.trials.degree_case(scheme);
        let own = degree_case.base.space.elements();
        let coarsest = degree_case.grids.coarsest(&own);
        match self.trials.has_run(scheme, &own) && self.trials.run(scheme, &coarsest).is_err() {
            true => own,
            false => coarsest,
        }
    }

    /// The schemes that can be tried. If a degree is refused, one line says so for all higher ones.
    fn schemes(&mut self) -> Vec<SchemeChoice> {
        let mut schemes = SchemeChoice::candidates(self.case, self.jumps);
        let refused =
            schemes.iter().find_map(|s| Some((s.degree, self.trials.prepare(s.degree).err()?)));
        if let Some((degree, error)) = refused {
            self.left_out.push(format!("elements of degree {degree} and more: {error}"));
        }
        schemes.retain(|scheme| self.trials.is_prepared(scheme.degree));
        schemes
    }

    /// The coarsest grid of each scheme that reaches the accuracy. Collective.
    ///
    /// # Errors
    /// The last one, where no scheme could be tried.
    fn grids_by_scheme(&mut self) -> Result<Vec<(SchemeChoice, ReachedGrid)>> {
        let schemes = self.schemes();
        // The first scheme is tried in any case.
        let first = self.start(schemes[0]);
        let mut found: Vec<(SchemeChoice, SearchResult)> = Vec::new();
        for (k, &scheme) in schemes.iter().enumerate() {
            // Each scheme has its share of the budget for grids.
            let share = FOR_GRIDS * (k + 1) as f64 / schemes.len() as f64;
            let tried = match k {
                0 => self.search_grid_from(scheme, &first, share),
                _ => self.search_grid(scheme, share)?,
            };
            found.push((scheme, tried));
        }
        self.spend_rest_on_modes(&mut found)?;
        self.reached_grids(found)
    }

    /// If no scheme that modes can run reaches the accuracy: gives the shares that others left over
    /// to these schemes one by one, fewest expected unknowns first, until one reaches it.
    /// Collective.
    fn spend_rest_on_modes(&mut self, found: &mut [(SchemeChoice, SearchResult)]) -> Result<()> {
        let by_modes = |scheme: &SchemeChoice| scheme.limiter == Limiter::None;
        if found.iter().any(|(scheme, tried)| by_modes(scheme) && !self.misses_accuracy(tried)) {
            return Ok(());
        }
        found.sort_by(|a, b| self.expected_unknowns(a).total_cmp(&self.expected_unknowns(b)));
        for (scheme, tried) in found {
            if !by_modes(scheme) || matches!(tried, SearchResult::Failed(_)) {
                continue;
            }
            // A failed second search does not replace the result of the first.
            let more = self.search_grid(*scheme, FOR_GRIDS)?;
            if matches!(more, SearchResult::Found(_)) {
                *tried = more;
            }
            if !self.misses_accuracy(tried) {
                break;
            }
        }
        Ok(())
    }

    /// The grids of `found`; schemes without one are left out, with the reason.
    ///
    /// # Errors
    /// The last error, if there is no grid at all.
    fn reached_grids(
        &mut self,
        found: Vec<(SchemeChoice, SearchResult)>,
    ) -> Result<Vec<(SchemeChoice, ReachedGrid)>> {
        let (mut grids, mut failure) = (Vec::new(), None);
        for (scheme, tried) in found {
            let name = self.name(Method::Classical, scheme);
            match tried {
                SearchResult::Found(grid) => grids.push((scheme, grid)),
                SearchResult::BudgetTooSmall(start) => {
                    let grid = shape_text(&start);
                    self.left_out.push(format!("{name}: the budget does not hold {grid} of them"));
                }
                SearchResult::Failed(error) => {
                    self.left_out.push(format!("{name}: {error}"));
                    failure = Some(error);
                }
            }
        }
        match grids.is_empty() {
            true => Err(failure.unwrap_or_else(|| Error::Input("nothing to try".to_owned()))),
            false => Ok(grids),
        }
    }

    /// The coarsest grid of `scheme` that reaches the accuracy, within this part of the budget.
    /// Collective.
    fn search_grid(&mut self, scheme: SchemeChoice, share: f64) -> Result<SearchResult> {
        let start = self.start(scheme);
        match self.trials.affords(scheme, &start, share)? {
            true => Ok(self.search_grid_from(scheme, &start, share)),
            false => Ok(SearchResult::BudgetTooSmall(start)),
        }
    }

    /// As [`search_grid`](Self::search_grid), from the grid `start` on. Collective.
    fn search_grid_from(
        &mut self,
        scheme: SchemeChoice,
        start: &[usize],
        share: f64,
    ) -> SearchResult {
        let own = self.trials.degree_case(scheme).base.space.elements();
        let goal = Goal { scheme, start, own: &own, accuracy: self.request.accuracy, share };
        match coarsest_grid(&mut self.trials, goal) {
            Ok(reached) => SearchResult::Found(reached),
            Err(error) => SearchResult::Failed(error),
        }
    }

    /// Unknowns of the grid that is expected to reach the accuracy.
    fn expected_unknowns(&self, tried: &(SchemeChoice, SearchResult)) -> f64 {
        match tried {
            (scheme, SearchResult::Found(reached)) => {
                let nodes = (scheme.degree + 1) as f64;
                cells(&reached.shape) * nodes.powi(reached.shape.len() as i32)
            }
            _ => f64::INFINITY,
        }
    }

    /// Whether no grid that was tried reaches the accuracy.
    fn misses_accuracy(&self, tried: &SearchResult) -> bool {
        match tried {
            SearchResult::Found(reached) => {
                let why_missed =
                    reached.error > DISCRETISATION * self.request.accuracy * (1.0 + ROUND_OFF);
                reached.known == Evidence::Extrapolated || why_missed
            }
            SearchResult::BudgetTooSmall(_) | SearchResult::Failed(_) => true,
        }
    }

    /// The report of the set-up `target` on the grid `reached`, without its cost.
    fn entry(&self, target: &Case, scheme: SchemeChoice, reached: &ReachedGrid) -> SetupReport {
        let settings = settings(self.case, self.trials.base(), target);
        SetupReport {
            name: self.name(target.method, scheme),
            method: target.method,
            interface: scheme.interface,
            limiter: scheme.limiter,
            degree: scheme.degree,
            flux: target.flux_of_elements(),
            shape: reached.shape.clone(),
            cells: cells(&target.space.shape()),
            computed_cells: cells(&self.trials.merged(target).space.shape()),
            tolerance: None,
            error: reached.error,
            known: reached.known,
            parts: ErrorParts::of_discretisation(reached.error, reached.part_of_space),
            order: reached.order.clone(),
            levels: reached.levels.clone(),
            moved_edges: self.trials.degree_case(scheme).grids.moved(&reached.shape),
            applications: 0.0,
            memory_bytes_per_rank: 0.0,
            seconds: None,
            seconds_measured: false,
            refused: vanished_region(target).or_else(|| self.why_missed(reached)),
            estimate: None,
            command: command(self.case, &settings),
            settings,
        }
    }

    /// Tries other fluxes between elements: for the set-up of least work by each method, unless its
    /// grid is extrapolated, on grids near its own. Collective.
    fn try_fluxes(&mut self, found: &[(SchemeChoice, ReachedGrid)]) -> Result<()> {
        self.share = 1.0;
        for method in [Method::Schrodingerized, Method::Classical] {
            let can = self.candidates.iter().map(|candidate| &candidate.entry);
            let can = can.filter(|e| e.method == method && e.refused.is_none());
            let best = can.min_by(|a, b| a.work().total_cmp(&b.work())).map(|e| e.name.clone());
            let is_best =
                |scheme: &SchemeChoice| best.as_ref() == Some(&self.name(method, *scheme));
            let Some((scheme, reached)) = found.iter().find(|(scheme, reached)| {
                is_best(scheme) && reached.known != Evidence::Extrapolated
            }) else {
                continue;
            };
            for scheme in scheme.other_fluxes(&self.trials.degree_case(*scheme).base) {
                self.try_flux(method, scheme, reached)?;
            }
        }
        Ok(())
    }

    /// Tries `scheme`, which differs by its flux from the scheme whose grid is `known`. Collective.
    fn try_flux(
        &mut self,
        method: Method,
        scheme: SchemeChoice,
        known: &ReachedGrid,
    ) -> Result<()> {
        let (start, accuracy) = (&known.shape, self.request.accuracy);
        let goal = Goal { scheme, start, own: start, accuracy, share: 1.0 };
        let why = match grid_near(&mut self.trials, goal, known) {
            Ok(Some(reached)) if method == Method::Classical => {
                return self.add_classical(scheme, &reached);
            }
            Ok(Some(reached)) => return self.add_schrodingerized(scheme, &reached),
            Ok(None) => "no grid that reaches it was found within the budget".to_owned(),
            Err(error) => error.to_string(),
        };
        self.left_out.push(format!("{}: {why}", self.name(method, scheme)));
        Ok(())
    }

    /// Why the grid `reached` does not reach the accuracy, if it does not.
    fn why_missed(&self, reached: &ReachedGrid) -> Option<String> {
        let (error, on) = (reached.error, shape_text(&reached.shape));
        if reached.order.pairs.is_empty() && reached.known == Evidence::Extrapolated {
            let why =
                "the budget does not hold two grids to compare; a longer --budget may allow it";
            return Some(why.to_owned());
        }
        if error <= DISCRETISATION * self.request.accuracy * (1.0 + ROUND_OFF) {
            return None;
        }
        Some(match (reached.order.falls(), reached.order.settled) {
            (true, _) => format!(
                "the error is {error:.1e} on {on}, and no finer grid was found that reaches it \
                 within --budget"
            ),
            (false, true) => format!("the error does not fall with the grid: {error:.1e} on {on}"),
            (false, false) => format!(
                "the error does not fall with the grid yet: {error:.1e} on {on}; a longer --budget \
                 compares finer grids"
            ),
        })
    }

    /// The plan of `target`; none if it cannot be run, and then its `entry` says why. Collective.
    fn plan(&self, entry: &mut SetupReport, target: &Case) -> Option<Plan> {
        if entry.refused.is_some() {
            return None;
        }
        let merged = self.trials.merged(target);
        let space = cells(&merged.space.shape()[..merged.space.dimension()]);
        if space > MOST_PLANNED_SPACE_CELLS || entry.computed_cells > MOST_CELLS {
            let [by_modes, classical] = BYTES;
            let each = match target.method {
                Method::Schrodingerized => by_modes,
                Method::Classical => classical,
            };
            let bytes = entry.computed_cells * each / self.world.group().size() as f64;
            entry.memory_bytes_per_rank = bytes;
            let grid = grid_text(&entry.shape, entry.degree);
            let mut why = format!("{}it takes {grid}", entry.not_settled_yet());
            if entry.cells <= MOST_SHOWN {
                why += &format!(", about {} a rank", bytes_text(bytes as u64));
            }
            entry.refused = Some(why);
            return None;
        }
        match planning::plan(self.world, target, &Resources::here(self.world)) {
            Ok(plan) => {
                entry.memory_bytes_per_rank = plan.memory() as f64;
                entry.computed_cells = plan.cells as f64;
                entry.applications = match &plan.warp {
                    Some(warp) => warp.applications as f64,
                    None => (plan.classical_steps * target.integrator.stages()) as f64,
                };
                Some(plan)
            }
            Err(error) => {
                let (open, grid) = (entry.not_settled_yet(), grid_text(&entry.shape, entry.degree));
                entry.refused = Some(format!("{open}on {grid}: {error}"));
                None
            }
        }
    }

    /// Adds `scheme` without Schrödingerization. Collective.
    fn add_classical(&mut self, scheme: SchemeChoice, reached: &ReachedGrid) -> Result<()> {
        let target = scheme.classical(&self.trials.degree_case(scheme).base, &reached.shape);
        let mut entry = self.entry(&target, scheme, reached);
        let plan = self.plan(&mut entry, &target);
        if plan.is_some() && self.trials.has_run(scheme, &reached.shape) {
            entry.seconds = Some(self.trials.run(scheme, &reached.shape)?.seconds);
            entry.seconds_measured = true;
        }
        self.candidates.push(SetupCandidate { entry, planned: plan.map(|plan| (target, plan)) });
        Ok(())
    }

    /// The grid on which tolerances are tried: the finest one but the last of the search on which a
    /// run by modes takes a small part of the budget. Collective.
    fn coarse(&self, scheme: SchemeChoice, reached: &ReachedGrid) -> Result<Vec<usize>> {
        let allowed = SCHRODINGERIZATION * self.request.accuracy;
        for level in reached.levels.iter().rev().skip(1) {
            let base = &self.trials.degree_case(scheme).base;
            let mut case = scheme.schrodingerized(base, &level.shape);
            case.tolerance = allowed.clamp(SMALLEST_TOLERANCE, LARGEST_TOLERANCE);
            let case = self.trials.merged(&case);
            let plan = Plan::provisional(&case, &Bounds::new(&case)?, &Resources::here(self.world));
            let is_small =
                |plan: Plan| (self.trials.budget).holds(mode_updates(&case, &plan), FOR_MODES);
            if plan.is_ok_and(is_small) {
                return Ok(level.shape.clone());
            }
        }
        let coarsest = reached.levels.first().map_or(&reached.shape, |level| &level.shape);
        Ok(coarsest.clone())
    }

    /// A tolerance with which Schrödingerization adds at most [`SCHRODINGERIZATION`] of the
    /// accuracy to the error on the grid `coarse`. Collective.
    fn tolerance(&mut self, scheme: SchemeChoice, coarse: &[usize]) -> Result<ToleranceTrial> {
        let allowed = SCHRODINGERIZATION * self.request.accuracy;
        let reference = self.trials.run(scheme, coarse)?;
        let (density, spread) = (reference.density.clone(), reference.spread);
        let guaranteed = matches!(self.case.data, Data::Density);
        // Level sets enter the density through a delta function as wide as a cell, without a bound:
        // begin at a tenth of what the field may have, and try it.
        let mut tolerance = if guaranteed { allowed / spread } else { 0.1 * allowed };
        let mut measured = None;
        let mut target = scheme.schrodingerized(&self.trials.degree_case(scheme).base, coarse);
        for _ in 0..MOST_TOLERANCES {
            tolerance = rounded_down(tolerance.clamp(SMALLEST_TOLERANCE, LARGEST_TOLERANCE));
            target.tolerance = tolerance;
            let plan = planning::plan(self.world, &target, &Resources::here(self.world))?;
            let updates = mode_updates(&target, &plan);
            if !self.trials.budget.allows(updates, FOR_TOLERANCES) {
                break;
            }
            let added = distance(&self.trials.measure(&target, updates)?.density, &density);
            measured = Some(added);
            if added <= allowed || tolerance <= SMALLEST_TOLERANCE {
                break;
            }
            tolerance *= 0.1;
        }
        let bound = guaranteed.then_some(tolerance * spread);
        Ok(ToleranceTrial { tolerance, measured, bound })
    }

    /// Adds `scheme` by Schrödingerization. Collective.
    fn add_schrodingerized(&mut self, scheme: SchemeChoice, reached: &ReachedGrid) -> Result<()> {
        let coarse = self.coarse(scheme, reached)?;
        let found = match self.tolerance(scheme, &coarse) {
            Ok(found) => found,
            Err(error) => {
                let name = self.name(Method::Schrodingerized, scheme);
                self.left_out.push(format!("{name} on {}: {error}", shape_text(&coarse)));
                return Ok(());
            }
        };
        let mut target =
            scheme.schrodingerized(&self.trials.degree_case(scheme).base, &reached.shape);
        target.tolerance = match found.bound {
            Some(_) => found.tolerance,
            None => {
                // The delta function gets narrower with the cells.
                let last = coarse.len() - 1;
                let narrower = (coarse[last] as f64 / reached.shape[last] as f64).min(1.0);
                rounded_down((found.tolerance * narrower).max(SMALLEST_TOLERANCE))
            }
        };
        let mut entry = self.entry(&target, scheme, reached);
        entry.tolerance = Some(target.tolerance);
        entry.parts.schrodingerization =
            found.measured.into_iter().chain(found.bound).reduce(f64::max);
        let plan = self.plan(&mut entry, &target);
        if let Some(plan) = &plan {
            self.try_by_modes(&mut entry, &target, scheme, plan)?;
        }
        self.candidates.push(SetupCandidate { entry, planned: plan.map(|plan| (target, plan)) });
        Ok(())
    }

    /// Runs `target` if the budget allows, and adds the error of Schrödingerization to that of its
    /// `entry`. Collective.
    fn try_by_modes(
        &mut self,
        entry: &mut SetupReport,
        target: &Case,
        scheme: SchemeChoice,
        plan: &Plan,
    ) -> Result<()> {
        let (trials, updates, share) = (&mut self.trials, mode_updates(target, plan), self.share);
        if trials.budget.allows(updates, share) && trials.affords(scheme, &entry.shape, share)? {
            match trials.measure(target, updates) {
                Ok(found) => {
                    entry.seconds = Some(found.seconds);
                    entry.seconds_measured = true;
                    let reference = trials.run(scheme, &entry.shape)?;
                    let added = distance(&found.density, &reference.density);
                    entry.parts.schrodingerization = Some(added);
                    match trials.error_of(scheme, &found, &entry.shape)? {
                        Some(error) => (entry.error, entry.known) = (error, Evidence::Measured),
                        None => entry.error += added,
                    }
                }
                Err(error) => entry.refused = Some(error.to_string()),
            }
        } else {
            entry.error += entry.parts.schrodingerization.unwrap_or(0.0);
        }
        if entry.refused.is_none() && entry.error > self.request.accuracy * (1.0 + ROUND_OFF) {
            let on = shape_text(&entry.shape);
            entry.refused = Some(format!("the error is {:.2e} on {on}", entry.error));
        }
        Ok(())
    }

    /// The error of the case as its file has it: of the discretisation by its own `scheme`, and of
    /// its solver; none if it cannot be estimated. Collective.
    fn given(&mut self, scheme: SchemeChoice, reached: &ReachedGrid) -> Result<Option<GivenCase>> {
        let shape = self.case.space.elements();
        let start = self.start(scheme);
        let tried = error_on(&mut self.trials, scheme, &shape, &reached.order, 1.0).unwrap_or(None);
        // An order that has not settled does not extrapolate.
        let extrapolated = || reached.extrapolated(&shape).filter(|_| reached.order.settled);
        let Some(DensityError { error, known }) = tried.or_else(extrapolated) else {
            return Ok(None);
        };
        let mut parts = ErrorParts::of_discretisation(error, reached.part_of_space_on(&shape));
        let rough = self.trials.run(scheme, &start)?;
        let (density, spread) = (rough.density.clone(), rough.spread);
        if self.case.method == Method::Schrodingerized && matches!(self.case.data, Data::Density) {
            match self.case.propagator.method.order() {
                0 => parts.schrodingerization = Some(self.case.tolerance * spread),
                _ => parts.step = self.error_of_step(scheme, &start, &density),
            }
        }
        if let Some(readout) = &self.case.readout
            && let MeasurementEffort::Accuracy(accuracy) = readout.effort
        {
            let mean = density.iter().map(|rho| rho.abs()).sum::<f64>() / density.len() as f64;
            parts.readout = Some(accuracy / mean);
        }
        let added = [parts.schrodingerization, parts.step, parts.readout];
        let error = error + added.into_iter().flatten().sum::<f64>();
        Ok(Some(GivenCase { degree: scheme.degree, shape, error, known, parts }))
    }

    /// The error of the density by the time step of the case's implicit propagator, on the grid
    /// `start`, whose semi-discrete `density` is given. It is nearly all of the solver's error.
    /// Collective.
    fn error_of_step(
        &mut self,
        scheme: SchemeChoice,
        start: &[usize],
        density: &[f64],
    ) -> Option<f64> {
        let own = final_fields_only(&scheme.schrodingerized(self.case, start));
        let own = Case { exact: None, verify: false, ..own };
        let updates = planning::plan(self.world, &own, &Resources::here(self.world))
            .map_or(f64::INFINITY, |plan| mode_updates(&own, &plan));
        if !self.trials.budget.allows(updates, 1.0) {
            return None;
        }
        let found = self.trials.measure(&own, updates).ok()?;
        Some(distance(&found.density, density))
    }

    /// The advice: all set-ups, quickest first, with the best one by modes.
    fn advised(&mut self, given: Option<GivenCase>) -> Result<AdviceReport> {
        let candidates = std::mem::take(&mut self.candidates);
        let left_out = std::mem::take(&mut self.left_out);
        let Self { world, case, request, trials, .. } = self;
        let settled = |SetupCandidate { mut entry, planned }: SetupCandidate| {
            let predicted = planned.map(|(target, plan)| trials.seconds(&target, &plan));
            entry.seconds = entry.seconds.or(predicted);
            entry.estimate = entry.not_settled(LONGEST_ADVISED);
            entry
        };
        let mut entries: Vec<SetupReport> = candidates.into_iter().map(settled).collect();
        let warnings = warnings(case, &entries);
        mark_unsettled_expensive(&mut entries);
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
            return Err(out_of_reach(case, request.accuracy, &entries));
        }
        let [best, best_classical] =
            best.map(|name| name.and_then(|name| entries.iter().position(|e| e.name == name)));
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

/// The error of an accuracy that none of `entries` reaches: with one reason, that of the set-up of
/// fewest cells.
fn out_of_reach(case: &Case, accuracy: f64, entries: &[SetupReport]) -> Error {
    let one_grid = |e: &SetupReport| e.known == Evidence::Extrapolated && e.order.pairs.is_empty();
    let verdict = match entries.iter().any(one_grid) {
        true => "is not settled within this budget",
        false => "is out of reach",
    };
    let fewest = entries.iter().min_by(|a, b| a.cells.total_cmp(&b.cells));
    let reason = fewest.map_or(String::new(), |e| {
        format!("{}: {}", e.name, e.refused.as_deref().unwrap_or_default())
    });
    Error::Input(format!(
        "{}: --accuracy {accuracy:e} of the density {verdict}. With the fewest cells, {reason}",
        case.name
    ))
}

/// Why `target` is refused, if a region of `V` holds no cell centre of its grid. Grids of more than
/// [`MOST_SEARCHED`] elements of space are not searched: regions between their cells are tiny.
fn vanished_region(target: &Case) -> Option<String> {
    if target.space.by_elements().space_cells() > MOST_SEARCHED {
        return None;
    }
    let region = overlooked(target).empty.into_iter().next()?;
    let grid = shape_text(&target.space.elements());
    Some(format!("potential.{region} is not there on {grid}: its where holds at no cell's centre"))
}
