//! Set-ups on the grids that were found, classical and by modes: plans, tolerances, trials, errors.

use crate::base::error::Result;
use crate::base::text::{bytes_text, rounded_down, short};
use crate::plan::layout::Resources;
use crate::plan::{Plan, ProvisionalPlan};
use crate::problem::case::{Case, LARGEST_TOLERANCE, MeasurementEffort, Method};
use crate::problem::potential::resolution::{PotentialMismatch, unresolved_on_finer_grids};
use crate::problem::potential::unresolved_regions;
use crate::run::planning;
use crate::run::unresolved::narrow_data;
use crate::study::advise::grid_search::{DISCRETISATION, GridSearch, SearchGoal, error_on};
use crate::study::advise::reached_grid::{DensityError, Evidence, ReachedGrid};
use crate::study::advise::report::{MOST_SHOWN, grid_text};
use crate::study::advise::scheme::SchemeChoice;
use crate::study::advise::settings::{command, settings};
use crate::study::advise::setups::{ErrorParts, GivenCase, SetupReport, SkippedSetup};
use crate::study::advise::trials::mode_updates;
use crate::study::advise::{ROUND_OFF, SetupCandidate, Study};
use crate::study::budget::longer;
use crate::study::density::{distance, mean_size};
use crate::study::grids::{MOST_PLANNED_SPACE_CELLS, cells, shape_text};
use crate::study::trial::final_fields_only;

/// Largest part of the accuracy that the error of Schrödingerization may take.
const SCHRODINGERIZATION: f64 = 0.1;
/// Largest part of the budget that a run by modes may take on the grid where tolerances are tried.
const FOR_MODES: f64 = 0.05;
/// Part of the budget up to which tolerances are tried on that grid.
const FOR_TOLERANCES: f64 = 0.8;
/// The smallest tolerance that is advised.
const SMALLEST_TOLERANCE: f64 = 1e-12;
/// Largest number of tolerances that are tried.
const MOST_TOLERANCES: usize = 4;
/// Grids of more elements of space than this are not searched for regions of `V` without a cell.
const MOST_SEARCHED: usize = 1 << 17;
/// Largest number of cells for which a plan is made.
const MOST_CELLS: f64 = 1e11;
/// Bytes a cell of runs by modes and of classical runs, for grids without a plan.
const BYTES: [f64; 2] = [340.0, 70.0];

/// A tolerance of Schrödingerization, tried on a coarse grid.
struct ToleranceTrial {
    tolerance: f64,
    /// Relative L1 error of the density that Schrödingerization adds on that grid, if it was tried.
    measured: Option<f64>,
    /// A bound on that error, if one is known.
    bound: Option<f64>,
}

impl Study<'_> {
    /// The report of the set-up `target` on the grid `reached`, without its cost.
    fn entry(&mut self, target: &Case, reached: &ReachedGrid) -> SetupReport {
        let scheme = reached.scheme;
        let is_measured = self.trials.has_exact();
        let hidden = || (!is_measured).then(|| hidden_variation(target)).flatten();
        let narrow = || narrow_data(target, Some(self.request.accuracy));
        let unseen = vanished_region(target).or_else(hidden).or_else(narrow);
        let is_open = unseen.is_none() && reached.is_open();
        let wanted_budget = self.wanted.get(&scheme).copied().filter(|_| is_open);
        let without_order = wanted_budget.filter(|_| reached.order.pairs.is_empty());
        let refused = unseen
            .or_else(|| without_order.map(|budget| not_compared(reached, budget)))
            .or_else(|| self.why_missed(reached, wanted_budget));
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
            error: reached.error,
            known: reached.known,
            parts: ErrorParts::of_discretisation(reached.error, reached.part_of_space),
            order: reached.order.clone(),
            grids: reached.grids.clone(),
            moved_edges: self.trials.degree_case(scheme).grids.moved(&reached.shape),
            wanted_budget,
            refused,
            command: command(self.case, &settings),
            settings,
            ..SetupReport::default()
        }
    }

    /// The reason why the grid `reached` does not reach the accuracy; `None` if it does. The next
    /// grid may fit into the `wanted` budget.
    fn why_missed(&self, reached: &ReachedGrid, wanted: Option<f64>) -> Option<String> {
        let (error, on) = (reached.error, shape_text(&reached.shape));
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
                "the error does not fall with the grid yet: {error:.1e} on {on}; {} compares finer \
                 grids",
                longer(wanted.unwrap_or(f64::INFINITY))
            ),
        })
    }

    /// The plan of `target`. `None` if it cannot be run; the reason is put into `entry`.
    /// Collective.
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
        match self.plan_of(target) {
            Ok(plan) => {
                entry.memory_bytes_per_rank = plan.memory() as f64;
                entry.computed_cells = plan.cells as f64;
                entry.applications = match &plan.warp {
                    Some(warp) => warp.applications as f64,
                    None => (plan.classical_steps * target.classical.integrator.stages()) as f64,
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

    /// The plan of `case` on all ranks. Collective.
    fn plan_of(&self, case: &Case) -> Result<Plan> {
        planning::plan(self.world, case, &Resources::here(self.world))
    }

    /// Adds the classical set-up on the grid `reached`. Collective.
    pub(super) fn add_classical(&mut self, reached: &ReachedGrid) -> Result<()> {
        let scheme = reached.scheme;
        let target = scheme.classical(&self.trials.degree_case(scheme).base, &reached.shape);
        let mut entry = self.entry(&target, reached);
        let plan = self.plan(&mut entry, &target);
        if plan.is_some() && self.trials.has_run(scheme, &reached.shape) {
            entry.seconds = Some(self.trials.run(scheme, &reached.shape)?.seconds);
            entry.seconds_measured = true;
        }
        self.candidates.push(SetupCandidate { entry, planned: plan.map(|plan| (target, plan)) });
        Ok(())
    }

    /// The grid on which tolerances are tried: of all grids of the search but the last, the finest
    /// one on which a run by modes takes a small part of the budget. Collective.
    fn grid_for_tolerance(&self, reached: &ReachedGrid) -> Vec<usize> {
        let allowed = SCHRODINGERIZATION * self.request.accuracy;
        let base = &self.trials.degree_case(reached.scheme).base;
        for grid in reached.grids.iter().rev().skip(1) {
            let mut case = reached.scheme.schrodingerized(base, &grid.shape);
            case.tolerance = allowed.clamp(SMALLEST_TOLERANCE, LARGEST_TOLERANCE);
            let case = self.trials.merged(&case);
            let found = ProvisionalPlan::new(&case, &Resources::here(self.world));
            let is_small =
                |plan: Plan| (self.trials.budget).fits_count(mode_updates(&case, &plan), FOR_MODES);
            if found.map(|found| found.plan).is_ok_and(is_small) {
                return grid.shape.clone();
            }
        }
        reached.first().to_vec()
    }

    /// A tolerance with which Schrödingerization adds at most [`SCHRODINGERIZATION`] of the
    /// accuracy to the error on the grid `coarse`. Collective.
    fn tolerance(&mut self, scheme: SchemeChoice, coarse: &[usize]) -> Result<ToleranceTrial> {
        let allowed = SCHRODINGERIZATION * self.request.accuracy;
        let reference = self.trials.run(scheme, coarse)?;
        let (density, spread) = (reference.density.clone(), reference.spread);
        let guaranteed = !self.case.is_measure_valued();
        // Level sets enter the density through a delta function as wide as a cell, without a bound.
        // So begin with a tenth of the allowed error, and measure.
        let mut tolerance = if guaranteed { allowed / spread } else { 0.1 * allowed };
        let mut measured = None;
        let mut target = scheme.schrodingerized(&self.trials.degree_case(scheme).base, coarse);
        let valid =
            |tolerance: f64| rounded_down(tolerance.clamp(SMALLEST_TOLERANCE, LARGEST_TOLERANCE));
        tolerance = valid(tolerance);
        for _ in 0..MOST_TOLERANCES {
            target.tolerance = tolerance;
            let plan = self.plan_of(&target)?;
            let updates = mode_updates(&target, &plan);
            let found = self.trials.run_by_modes(scheme, &target, updates, FOR_TOLERANCES)?;
            let Some(found) = found else { break };
            let added = distance(&found.density, &density);
            measured = Some(added);
            if added <= allowed || tolerance <= SMALLEST_TOLERANCE {
                break;
            }
            tolerance = valid(0.1 * tolerance);
            // The error is proportional to the tolerance, if a bound is.
            measured = measured.map(|added| if guaranteed { 0.1 * added } else { added });
        }
        let bound = guaranteed.then_some(tolerance * spread);
        Ok(ToleranceTrial { tolerance, measured, bound })
    }

    /// Adds the set-up by Schrödingerization on the grid `reached`. Collective.
    pub(super) fn add_schrodingerized(&mut self, reached: &ReachedGrid) -> Result<()> {
        let scheme = reached.scheme;
        let coarse = self.grid_for_tolerance(reached);
        let found = match self.tolerance(scheme, &coarse) {
            Ok(found) => found,
            Err(error) => {
                let name = self.name(Method::Schrodingerized, scheme);
                self.left_out
                    .push(SkippedSetup { grid: Some(coarse), ..SkippedSetup::new(name, error) });
                return Ok(());
            }
        };
        let mut target =
            scheme.schrodingerized(&self.trials.degree_case(scheme).base, &reached.shape);
        target.tolerance = match found.bound {
            Some(_) => found.tolerance,
            None => {
                // The delta function gets narrower with the cells.
                let velocities = self.case.space.dimension()..coarse.len();
                let ratios = velocities.map(|k| coarse[k] as f64 / reached.shape[k] as f64);
                let narrower = ratios.fold(1.0, f64::min);
                rounded_down((found.tolerance * narrower).max(SMALLEST_TOLERANCE))
            }
        };
        let mut entry = self.entry(&target, reached);
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
        let (trials, shape, share) = (&mut self.trials, &entry.shape, self.share);
        let found = if trials.affords(scheme, shape, share)? {
            trials.run_by_modes(scheme, target, mode_updates(target, plan), share)
        } else {
            Ok(None)
        };
        match found {
            Ok(Some(found)) => {
                entry.seconds = Some(found.seconds);
                entry.seconds_measured = true;
                let added = distance(&found.density, &trials.run(scheme, shape)?.density);
                entry.parts.schrodingerization = Some(added);
                if let Some(error) = trials.error(scheme, shape)? {
                    (entry.error, entry.known) = (error, Evidence::Measured);
                }
            }
            Ok(None) => {}
            Err(error) => entry.refused = Some(error.to_string()),
        }
        entry.error += entry.parts.schrodingerization.unwrap_or(0.0);
        if entry.refused.is_none() && entry.error > self.request.accuracy * (1.0 + ROUND_OFF) {
            let on = shape_text(&entry.shape);
            entry.refused = Some(format!("the error is {:.2e} on {on}", entry.error));
        }
        Ok(())
    }

    /// Tries other fluxes between elements for the set-up of least work by each method, on grids
    /// near its own, unless that grid is extrapolated. Collective.
    pub(super) fn try_fluxes(&mut self, found: &[ReachedGrid]) -> Result<()> {
        self.share = 1.0;
        for method in [Method::Schrodingerized, Method::Classical] {
            let can = self.candidates.iter().map(|candidate| &candidate.entry);
            let can = can.filter(|e| e.method == method && e.refused.is_none());
            let best = can.min_by(|a, b| a.work().total_cmp(&b.work())).map(|e| e.name.clone());
            let is_best = |of: &&ReachedGrid| best.as_ref() == Some(&self.name(method, of.scheme));
            let mut tried = found.iter().filter(|of| of.known != Evidence::Extrapolated);
            let Some(reached) = tried.find(is_best) else { continue };
            let own = self.trials.degree_case(reached.scheme).base.scheme.flux;
            for scheme in reached.scheme.other_fluxes(own) {
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
        let goal = SearchGoal { accuracy: self.request.accuracy, share: 1.0 };
        let search = GridSearch::new(&mut self.trials, scheme, goal);
        let why = match search.near(known) {
            Ok(Some(reached)) if method == Method::Classical => {
                return self.add_classical(&reached);
            }
            Ok(Some(reached)) => return self.add_schrodingerized(&reached),
            Ok(None) => "no grid that reaches it was found within the budget".to_owned(),
            Err(error) => error.to_string(),
        };
        self.left_out.push(SkippedSetup::new(self.name(method, scheme), why));
        Ok(())
    }

    /// The case as its file has it, with two errors: that of the discretisation on its own grid by
    /// its own scheme, whose grid is `reached`, and that of its solver. `None` if they cannot be
    /// estimated. Collective.
    pub(super) fn given_case(&mut self, reached: &ReachedGrid) -> Result<Option<GivenCase>> {
        let scheme = reached.scheme;
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
        if self.case.method == Method::Schrodingerized && !self.case.is_measure_valued() {
            match self.case.propagator.method.order() {
                0 => parts.schrodingerization = Some(self.case.tolerance * spread),
                _ => parts.step = self.error_of_step(scheme, &start, &density),
            }
        }
        if let Some(readout) = &self.case.readout
            && let MeasurementEffort::Accuracy(accuracy) = readout.effort
        {
            parts.readout = Some(accuracy / mean_size(&density));
        }
        let added = [parts.schrodingerization, parts.step, parts.readout];
        let error = error + added.into_iter().flatten().sum::<f64>();
        Ok(Some(GivenCase { degree: scheme.degree, shape, error, known, parts }))
    }

    /// The error of the density due to the time step of the case's implicit propagator, on the grid
    /// `start`, where `density` is the semi-discrete one. It is nearly the whole error of the
    /// solver. Collective.
    fn error_of_step(
        &mut self,
        scheme: SchemeChoice,
        start: &[usize],
        density: &[f64],
    ) -> Option<f64> {
        let own = final_fields_only(&scheme.schrodingerized(self.case, start));
        let own = Case { exact: None, verify: false, ..own };
        let updates = self.plan_of(&own).map_or(f64::INFINITY, |plan| mode_updates(&own, &plan));
        if !self.trials.budget.fits(updates, 1.0) {
            return None;
        }
        let found = self.trials.measure(&own, updates).ok()?;
        Some(distance(&found.density, density))
    }
}

/// The reason why a set-up is refused whose grids show no order, and of which a longer `budget` may
/// hold the next grid.
fn not_compared(reached: &ReachedGrid, budget: f64) -> String {
    let what = if reached.grids.is_empty() {
        "does not hold two grids to compare"
    } else {
        "does not hold a third grid, which shows an order"
    };
    format!("the budget {what}; {} may allow it", longer(budget))
}

/// The reason why `target` is refused, if a region of `V` holds no cell centre of its grid. Grids
/// of more than [`MOST_SEARCHED`] elements of space are not searched: only tiny regions could
/// vanish there.
fn vanished_region(target: &Case) -> Option<String> {
    if target.space.by_elements().space_cells() > MOST_SEARCHED {
        return None;
    }
    let region = unresolved_regions(target).empty.into_iter().next()?;
    let grid = shape_text(&target.space.elements());
    Some(format!("potential.{region} vanishes on {grid}: its where holds at no cell's centre"))
}

/// The reason why `target` is refused where errors are not measured, if its grid does not resolve
/// `V`: runs on finer grids do not show what that does.
fn hidden_variation(target: &Case) -> Option<String> {
    let PotentialMismatch { region, written, taken, .. } = unresolved_on_finer_grids(target)?;
    Some(format!(
        "{}: {} does not resolve V: at a point it is {} as written, and {} as the scheme takes it. \
         Trials on finer grids do not show what that does. Jumps need a region of their own with \
         where, narrow features more cells, or [exact] measures errors",
        target.potential_key(region),
        shape_text(&target.space.elements()),
        short(written),
        short(taken)
    ))
}
