//! `phasewarp advise`: the coarsest grid and the cheapest set-up whose density is as exact as asked
//! for.
//!
//! The error is `∫|ρ − ρ_exact| dx / ∫|ρ_exact| dx` at the end, `ρ_exact` averaged over the cells.
//! Schemes are tried on coarse grids without Schrödingerization, each grid twice as fine as the one
//! before. Without `[exact]` the error is that of Richardson: from the distance `d` to a grid twice
//! as fine, `e = d/(1 − 2^{−q})`. The order `q` is measured and not assumed: discontinuous
//! solutions have about 1/2. The grid that reaches the accuracy lies between two that were tried,
//! or follows from the order; it is tried itself where the budget allows (`reach`).
//! Schrödingerization adds at most a tenth of the accuracy: its tolerance follows from the norms of
//! `f` ([`density::spread`]) and is tried on a coarse grid.
//!
//! Counted work decides what is tried; rank 0's clock only stops what takes far longer than counted
//! ([`crate::study::budget`]). Where nothing is found, or only what takes longer than the search
//! did, more is tried: as much as this machine can in the time that is left.

pub mod density;
pub mod entry;
pub mod order;
pub mod reach;
pub mod report;
pub mod scheme;
pub mod settings;
pub mod trials;

use crate::base::error::{Error, Result};
use crate::base::text::{bytes_text, rounded_down};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Data, Effort, LARGEST_TOLERANCE, Limiter, Method};
use crate::problem::potential::overlooked;
use crate::run::planning;
use crate::study::advise::density::distance;
use crate::study::advise::entry::{Advised, Entry, Given, Parts, doubt_the_dearest};
use crate::study::advise::reach::{
    DISCRETISATION, Goal, Known, KnownError, Reach, look, near, reach,
};
use crate::study::advise::report::{MOST_SHOWN, grid_text, warnings};
use crate::study::advise::scheme::Scheme;
use crate::study::advise::settings::{command, plain, settings};
use crate::study::advise::trials::{Trials, cells, mode_updates};
use crate::study::budget::refuse_long_look;
use crate::study::grids::shape_text;
use crate::study::trial::final_fields_only;

/// Most of the accuracy that Schrödingerization may take.
const SCHRODINGERIZATION: f64 = 0.1;
/// Part of the budget for grids.
const FOR_GRIDS: f64 = 0.7;
/// Part of the budget for a first run by modes, on a coarse grid.
const FOR_MODES: f64 = 0.05;
/// Part of the budget up to which tolerances are tried there.
const FOR_TOLERANCES: f64 = 0.8;
/// Part of the budget up to which schemes run by modes; the rest is for other fluxes of the best.
const FOR_SCHEMES: f64 = 0.85;
/// Part of the budget, at most, for the case as it stands.
const FOR_CASE: f64 = 0.1;
/// More trials are made where a run of what is advised counts as more than this part of the budget.
const DEAR: f64 = 0.25;
/// What is expected to take more seconds than these, 30 days, is an estimate and no advice.
const LONGEST: f64 = 30.0 * 86400.0;
/// The smallest tolerance that is advised.
const SMALLEST_TOLERANCE: f64 = 1e-12;
/// Most tolerances that are tried.
const MOST_TOLERANCES: usize = 4;
/// More cells than this in space are not planned for.
const MOST_SPACE_CELLS: f64 = 4e6;
/// Grids of more elements of space than this are not searched for regions of `V`.
const MOST_LOOKED_AT: usize = 1 << 17;
/// More cells than this are not planned for.
const MOST_CELLS: f64 = 1e11;
/// Bytes a cell of a run, by modes and classical, where none is planned.
const BYTES: [f64; 2] = [340.0, 70.0];
/// An error may exceed what is wanted by so much round-off.
const ROUND_OFF: f64 = 1e-9;

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Relative L1 error of the density.
    pub accuracy: f64,
    /// Seconds for all trials, about.
    pub budget: f64,
}

/// Finds the set-ups of `case` that are as exact as `wanted`. Collective; the same on all ranks.
///
/// # Errors
/// [`Error::Input`] where nothing reaches the accuracy, and for a case that starts from a warped
/// field; the error of a trial where none succeeds.
pub fn advise(world: &World, case: &Case, wanted: Wanted) -> Result<Advised> {
    if let Some(start) = &case.start {
        let what = "advice takes other grids, and the file holds one; give initial.f";
        return Err(Error::Input(format!("{}: {what}", start.place)));
    }
    if let Some(start) = &case.start_field {
        let what = "advice takes other grids, and the file holds f on one; leave it out, with \
                    time.start";
        return Err(Error::Input(format!("{}: {what}", start.place)));
    }
    refuse_long_look(world, case, wanted.budget)?;
    let mut study = Study::new(world, case, wanted)?;
    let mut advised = study.search();
    while study.is_dear(&advised) && study.trials.budget.count_anew() {
        advised = study.search();
    }
    advised
}

/// A set-up, and its case and plan where it can be run.
struct Candidate {
    entry: Entry,
    planned: Option<(Case, Plan)>,
}

/// A tolerance of Schrödingerization, tried on a coarse grid.
struct Tolerance {
    tolerance: f64,
    /// What Schrödingerization adds to the error there, where it was tried.
    measured: Option<f64>,
    /// What it adds at most, where that is known.
    bound: Option<f64>,
}

/// What the search for the grid of a scheme came to.
enum Tried {
    /// A grid.
    Found(Reach),
    /// The budget does not hold a run on this grid, the first.
    NotWithin(Vec<usize>),
    /// A trial failed.
    Failed(Error),
}

/// What is found on the way to advice.
struct Study<'a> {
    world: &'a World,
    case: &'a Case,
    wanted: Wanted,
    /// Whether `V` jumps.
    jumps: bool,
    trials: Trials<'a>,
    /// Part of the budget up to which runs by modes are tried.
    share: f64,
    left_out: Vec<String>,
    candidates: Vec<Candidate>,
    /// Whether the search came to an end, and did not fail at a trial.
    ended: bool,
}

impl<'a> Study<'a> {
    fn new(world: &'a World, case: &'a Case, wanted: Wanted) -> Result<Self> {
        let plain = plain(case)?;
        refuse_hopeless_here(world, &plain)?;
        let trials = Trials::new(world, plain, case.exact.clone(), wanted.budget)?;
        Ok(Self {
            world,
            case,
            wanted,
            jumps: Bounds::new(case)?.jumps,
            trials,
            share: FOR_SCHEMES,
            left_out: Vec::new(),
            candidates: Vec::new(),
            ended: false,
        })
    }

    /// Searches within what the budget allows; trials that were made are not made again.
    /// Collective.
    ///
    /// # Errors
    /// As [`advise`].
    fn search(&mut self) -> Result<Advised> {
        (self.share, self.candidates, self.ended) = (FOR_SCHEMES, Vec::new(), false);
        self.left_out = match self.case.varies() && !self.case.is_galerkin() {
            true => {
                vec!["slopes (scheme.limiter): not with an inflow that depends on time".to_owned()]
            }
            false => Vec::new(),
        };
        self.try_as_it_stands()?;
        let found = self.reach_by_schemes()?;
        for (scheme, reach) in &found {
            self.add_classical(*scheme, reach)?;
            if scheme.limiter == Limiter::None {
                self.add_schrodingerized(*scheme, reach)?;
            }
        }
        self.try_fluxes(&found)?;
        let given = match found.iter().find(|(scheme, _)| *scheme == Scheme::of(self.case)) {
            Some((scheme, reach)) => self.given(*scheme, reach)?,
            None => None,
        };
        self.ended = true;
        self.advised(given)
    }

    /// Whether a search that came to its end advised nothing, or what counts as more than a
    /// [`DEAR`] part of the budget and is expected to take longer than the search did: more trials
    /// may find something cheaper. Collective.
    fn is_dear(&self, advised: &Result<Advised>) -> bool {
        let best = advised.as_ref().ok().and_then(|advised| advised.best_of(self.case.method));
        let Some(best) = best else { return self.ended };
        let budget = &self.trials.budget;
        let is_long = best.seconds.is_none_or(|seconds| seconds > budget.elapsed());
        !budget.holds(best.updates(), DEAR) && budget.decide(is_long)
    }

    fn name(&self, method: Method, scheme: Scheme) -> String {
        scheme.name(method, self.jumps)
    }

    /// Tries the case's own grid first where that is cheap, so that its error is not extrapolated.
    /// Collective.
    fn try_as_it_stands(&mut self) -> Result<()> {
        let (scheme, own) = (Scheme::of(self.case), self.case.space.elements());
        let trials = &mut self.trials;
        if trials.is_cheap(scheme, &own, FOR_CASE)? {
            let twice = trials.scene(scheme).grids.twice(&own);
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

    /// The grid that trials of `scheme` begin with: the coarsest, or the case's own where a coarse
    /// one sees nothing, as data are narrow. Collective.
    fn start(&mut self, scheme: Scheme) -> Vec<usize> {
        let scene = self.trials.scene(scheme);
        let own = scene.plain.space.elements();
        let coarsest = scene.grids.coarsest(&own);
        match self.trials.has_run(scheme, &own) && self.trials.run(scheme, &coarsest).is_err() {
            true => own,
            false => coarsest,
        }
    }

    /// The schemes that can be tried. Elements are left out once for all degrees.
    fn schemes(&mut self) -> Vec<Scheme> {
        let mut schemes = Scheme::candidates(self.case, self.jumps);
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
    fn reach_by_schemes(&mut self) -> Result<Vec<(Scheme, Reach)>> {
        let schemes = self.schemes();
        // The first scheme is tried in any case.
        let first = self.start(schemes[0]);
        let mut found: Vec<(Scheme, Tried)> = Vec::new();
        for (k, &scheme) in schemes.iter().enumerate() {
            // Each scheme has its share of the budget for grids; the rest is for what is advised.
            let share = FOR_GRIDS * (k + 1) as f64 / schemes.len() as f64;
            let tried = match k {
                0 => self.reach_from(scheme, &first, share),
                _ => self.reach_by(scheme, share)?,
            };
            found.push((scheme, tried));
        }
        // Where none that modes can take reaches it, what some left of theirs is for the others
        // until one does, those first that expect the fewest unknowns.
        let by_modes = |scheme: &Scheme| scheme.limiter == Limiter::None;
        if found.iter().all(|(scheme, tried)| !by_modes(scheme) || self.is_open(tried)) {
            found.sort_by(|a, b| self.expects(a).total_cmp(&self.expects(b)));
            for (scheme, tried) in &mut found {
                let more = match tried {
                    Tried::Failed(_) => continue,
                    _ if !by_modes(scheme) => continue,
                    _ => self.reach_by(*scheme, FOR_GRIDS)?,
                };
                // What was found within less stays.
                if matches!(more, Tried::Found(_)) {
                    *tried = more;
                }
                if !self.is_open(tried) {
                    break;
                }
            }
        }
        let (mut reached, mut failure) = (Vec::new(), None);
        for (scheme, tried) in found {
            let name = self.name(Method::Classical, scheme);
            match tried {
                Tried::Found(reach) => reached.push((scheme, reach)),
                Tried::NotWithin(start) => {
                    let grid = shape_text(&start);
                    self.left_out.push(format!("{name}: the budget does not hold {grid} of them"));
                }
                Tried::Failed(error) => {
                    self.left_out.push(format!("{name}: {error}"));
                    failure = Some(error);
                }
            }
        }
        match reached.is_empty() {
            true => Err(failure.unwrap_or_else(|| Error::Input("nothing to try".to_owned()))),
            false => Ok(reached),
        }
    }

    /// The coarsest grid of `scheme` that reaches the accuracy, within this part of the budget.
    /// Collective.
    fn reach_by(&mut self, scheme: Scheme, share: f64) -> Result<Tried> {
        let start = self.start(scheme);
        match self.trials.may(scheme, &start, share)? {
            true => Ok(self.reach_from(scheme, &start, share)),
            false => Ok(Tried::NotWithin(start)),
        }
    }

    /// As [`reach_by`](Self::reach_by), from the grid `start` on. Collective.
    fn reach_from(&mut self, scheme: Scheme, start: &[usize], share: f64) -> Tried {
        let own = self.trials.scene(scheme).plain.space.elements();
        let goal = Goal { scheme, start, own: &own, accuracy: self.wanted.accuracy, share };
        match reach(&mut self.trials, goal) {
            Ok(reach) => Tried::Found(reach),
            Err(error) => Tried::Failed(error),
        }
    }

    /// Unknowns of the grid that is expected to reach the accuracy.
    fn expects(&self, tried: &(Scheme, Tried)) -> f64 {
        match tried {
            (scheme, Tried::Found(reach)) => {
                let nodes = (scheme.degree + 1) as f64;
                cells(&reach.shape) * nodes.powi(reach.shape.len() as i32)
            }
            _ => f64::INFINITY,
        }
    }

    /// Whether no grid that was tried reaches the accuracy.
    fn is_open(&self, tried: &Tried) -> bool {
        match tried {
            Tried::Found(reach) => {
                let misses =
                    reach.error > DISCRETISATION * self.wanted.accuracy * (1.0 + ROUND_OFF);
                reach.known == Known::Extrapolated || misses
            }
            Tried::NotWithin(_) | Tried::Failed(_) => true,
        }
    }

    /// The set-up `target` on the grid of `reach`, before its cost is known.
    fn entry(&self, target: &Case, scheme: Scheme, reach: &Reach) -> Entry {
        let settings = settings(self.case, self.trials.plain(), target);
        Entry {
            name: self.name(target.method, scheme),
            method: target.method,
            interface: scheme.interface,
            limiter: scheme.limiter,
            degree: scheme.degree,
            flux: target.flux_of_elements(),
            shape: reach.shape.clone(),
            cells: cells(&target.space.shape()),
            computed_cells: cells(&self.trials.merged(target).space.shape()),
            tolerance: None,
            error: reach.error,
            known: reach.known,
            parts: Parts::of_discretisation(reach.error, reach.part_of_space),
            order: reach.order.clone(),
            levels: reach.levels.clone(),
            moved_edges: self.trials.scene(scheme).grids.moved(&reach.shape),
            applications: 0.0,
            memory_bytes_per_rank: 0.0,
            seconds: None,
            seconds_measured: false,
            refused: vanished(target).or_else(|| self.misses(reach)),
            estimate: None,
            command: command(self.case, &settings),
            settings,
        }
    }

    /// Other fluxes between elements, for what has the least work by each method and is no
    /// extrapolation: on grids near its own. Collective.
    fn try_fluxes(&mut self, found: &[(Scheme, Reach)]) -> Result<()> {
        self.share = 1.0;
        for method in [Method::Schrodingerized, Method::Classical] {
            let can = self.candidates.iter().map(|candidate| &candidate.entry);
            let can = can.filter(|e| e.method == method && e.refused.is_none());
            let best = can.min_by(|a, b| a.work().total_cmp(&b.work())).map(|e| e.name.clone());
            let is_best = |scheme: &Scheme| best.as_ref() == Some(&self.name(method, *scheme));
            let Some((scheme, reach)) = found
                .iter()
                .find(|(scheme, reach)| is_best(scheme) && reach.known != Known::Extrapolated)
            else {
                continue;
            };
            for scheme in scheme.other_fluxes(&self.trials.scene(*scheme).plain) {
                self.try_flux(method, scheme, reach)?;
            }
        }
        Ok(())
    }

    /// Tries `scheme`, whose flux differs from that of which `known` is found. Collective.
    fn try_flux(&mut self, method: Method, scheme: Scheme, known: &Reach) -> Result<()> {
        let (start, accuracy) = (&known.shape, self.wanted.accuracy);
        let goal = Goal { scheme, start, own: start, accuracy, share: 1.0 };
        let why = match near(&mut self.trials, goal, known) {
            Ok(Some(reach)) if method == Method::Classical => {
                return self.add_classical(scheme, &reach);
            }
            Ok(Some(reach)) => return self.add_schrodingerized(scheme, &reach),
            Ok(None) => "no grid that reaches it was found within the budget".to_owned(),
            Err(error) => error.to_string(),
        };
        self.left_out.push(format!("{}: {why}", self.name(method, scheme)));
        Ok(())
    }

    /// Why the grid of `reach` does not reach the accuracy, if it does not.
    fn misses(&self, reach: &Reach) -> Option<String> {
        let (error, on) = (reach.error, shape_text(&reach.shape));
        if reach.order.pairs.is_empty() && reach.known == Known::Extrapolated {
            let why =
                "the budget does not hold two grids to compare; a longer --budget may allow it";
            return Some(why.to_owned());
        }
        if error <= DISCRETISATION * self.wanted.accuracy * (1.0 + ROUND_OFF) {
            return None;
        }
        Some(match (reach.order.falls(), reach.order.settled) {
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

    /// Plans `target`, or says in its `entry` why it cannot be run. Collective.
    fn plan(&self, entry: &mut Entry, target: &Case) -> Option<Plan> {
        if entry.refused.is_some() {
            return None;
        }
        let merged = self.trials.merged(target);
        let space = cells(&merged.space.shape()[..merged.space.dimension()]);
        if space > MOST_SPACE_CELLS || entry.computed_cells > MOST_CELLS {
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
    fn add_classical(&mut self, scheme: Scheme, reach: &Reach) -> Result<()> {
        let target = scheme.classical(&self.trials.scene(scheme).plain, &reach.shape);
        let mut entry = self.entry(&target, scheme, reach);
        let plan = self.plan(&mut entry, &target);
        if plan.is_some() && self.trials.has_run(scheme, &reach.shape) {
            entry.seconds = Some(self.trials.run(scheme, &reach.shape)?.seconds);
            entry.seconds_measured = true;
        }
        self.candidates.push(Candidate { entry, planned: plan.map(|plan| (target, plan)) });
        Ok(())
    }

    /// The finest grid tried, but for the last, on which a run by modes is a small part of the
    /// budget. Collective.
    fn coarse(&self, scheme: Scheme, reach: &Reach) -> Result<Vec<usize>> {
        let allowed = SCHRODINGERIZATION * self.wanted.accuracy;
        for level in reach.levels.iter().rev().skip(1) {
            let plain = &self.trials.scene(scheme).plain;
            let mut case = scheme.schrodingerized(plain, &level.shape);
            case.tolerance = allowed.clamp(SMALLEST_TOLERANCE, LARGEST_TOLERANCE);
            let case = self.trials.merged(&case);
            let plan = Plan::provisional(&case, &Bounds::new(&case)?, &Resources::here(self.world));
            let is_small =
                |plan: Plan| (self.trials.budget).holds(mode_updates(&case, &plan), FOR_MODES);
            if plan.is_ok_and(is_small) {
                return Ok(level.shape.clone());
            }
        }
        let coarsest = reach.levels.first().map_or(&reach.shape, |level| &level.shape);
        Ok(coarsest.clone())
    }

    /// A tolerance by which Schrödingerization adds no more to the error on the grid `coarse` than
    /// it may. Collective.
    fn tolerance(&mut self, scheme: Scheme, coarse: &[usize]) -> Result<Tolerance> {
        let allowed = SCHRODINGERIZATION * self.wanted.accuracy;
        let reference = self.trials.run(scheme, coarse)?;
        let (density, spread) = (reference.density.clone(), reference.spread);
        let guaranteed = matches!(self.case.data, Data::Density);
        // Level sets enter the density through a delta function as wide as a cell: a tenth of what
        // a field may have, and it is tried.
        let mut tolerance = if guaranteed { allowed / spread } else { 0.1 * allowed };
        let mut measured = None;
        let mut target = scheme.schrodingerized(&self.trials.scene(scheme).plain, coarse);
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
        Ok(Tolerance { tolerance, measured, bound })
    }

    /// Adds `scheme` by Schrödingerization. Collective.
    fn add_schrodingerized(&mut self, scheme: Scheme, reach: &Reach) -> Result<()> {
        let coarse = self.coarse(scheme, reach)?;
        let found = match self.tolerance(scheme, &coarse) {
            Ok(found) => found,
            Err(error) => {
                let name = self.name(Method::Schrodingerized, scheme);
                self.left_out.push(format!("{name} on {}: {error}", shape_text(&coarse)));
                return Ok(());
            }
        };
        let mut target = scheme.schrodingerized(&self.trials.scene(scheme).plain, &reach.shape);
        target.tolerance = match found.bound {
            Some(_) => found.tolerance,
            None => {
                // The delta function gets narrower with the cells.
                let last = coarse.len() - 1;
                let narrower = (coarse[last] as f64 / reach.shape[last] as f64).min(1.0);
                rounded_down((found.tolerance * narrower).max(SMALLEST_TOLERANCE))
            }
        };
        let mut entry = self.entry(&target, scheme, reach);
        entry.tolerance = Some(target.tolerance);
        entry.parts.schrodingerization =
            found.measured.into_iter().chain(found.bound).reduce(f64::max);
        let plan = self.plan(&mut entry, &target);
        if let Some(plan) = &plan {
            self.try_by_modes(&mut entry, &target, scheme, plan)?;
        }
        self.candidates.push(Candidate { entry, planned: plan.map(|plan| (target, plan)) });
        Ok(())
    }

    /// Runs `target` where the budget allows, and adds what Schrödingerization makes wrong to the
    /// error of its `entry`. Collective.
    fn try_by_modes(
        &mut self,
        entry: &mut Entry,
        target: &Case,
        scheme: Scheme,
        plan: &Plan,
    ) -> Result<()> {
        let (trials, updates, share) = (&mut self.trials, mode_updates(target, plan), self.share);
        if trials.budget.allows(updates, share) && trials.may(scheme, &entry.shape, share)? {
            match trials.measure(target, updates) {
                Ok(found) => {
                    entry.seconds = Some(found.seconds);
                    entry.seconds_measured = true;
                    let reference = trials.run(scheme, &entry.shape)?;
                    let added = distance(&found.density, &reference.density);
                    entry.parts.schrodingerization = Some(added);
                    match trials.error_of(scheme, &found, &entry.shape)? {
                        Some(error) => (entry.error, entry.known) = (error, Known::Measured),
                        None => entry.error += added,
                    }
                }
                Err(error) => entry.refused = Some(error.to_string()),
            }
        } else {
            entry.error += entry.parts.schrodingerization.unwrap_or(0.0);
        }
        if entry.refused.is_none() && entry.error > self.wanted.accuracy * (1.0 + ROUND_OFF) {
            let on = shape_text(&entry.shape);
            entry.refused = Some(format!("the error is {:.2e} on {on}", entry.error));
        }
        Ok(())
    }

    /// The case as it stands: the discretisation by `scheme`, which is its own, and what its solver
    /// adds. Collective.
    fn given(&mut self, scheme: Scheme, reach: &Reach) -> Result<Option<Given>> {
        let shape = self.case.space.elements();
        let start = self.start(scheme);
        let looked = look(&mut self.trials, scheme, &shape, &reach.order, 1.0).unwrap_or(None);
        // An order that has not settled tells nothing of a grid that was not tried.
        let extrapolated = || reach.extrapolated(&shape).filter(|_| reach.order.settled);
        let Some(KnownError { error, known }) = looked.or_else(extrapolated) else {
            return Ok(None);
        };
        let mut parts = Parts::of_discretisation(error, reach.part_of_space_on(&shape));
        let rough = self.trials.run(scheme, &start)?;
        let (density, spread) = (rough.density.clone(), rough.spread);
        if self.case.method == Method::Schrodingerized && matches!(self.case.data, Data::Density) {
            match self.case.propagator.method.order() {
                0 => parts.schrodingerization = Some(self.case.tolerance * spread),
                _ => parts.step = self.error_of_step(scheme, &start, &density),
            }
        }
        if let Some(readout) = &self.case.readout
            && let Effort::Accuracy(accuracy) = readout.effort
        {
            let mean = density.iter().map(|rho| rho.abs()).sum::<f64>() / density.len() as f64;
            parts.readout = Some(accuracy / mean);
        }
        let added = [parts.schrodingerization, parts.step, parts.readout];
        let error = error + added.into_iter().flatten().sum::<f64>();
        Ok(Some(Given { degree: scheme.degree, shape, error, known, parts }))
    }

    /// The error that the step of the case's implicit propagator makes on the coarsest grid, where
    /// `density` is exact: nearly all that its solver adds. Collective.
    fn error_of_step(&mut self, scheme: Scheme, start: &[usize], density: &[f64]) -> Option<f64> {
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
    fn advised(&mut self, given: Option<Given>) -> Result<Advised> {
        let candidates = std::mem::take(&mut self.candidates);
        let left_out = std::mem::take(&mut self.left_out);
        let Self { world, case, wanted, trials, .. } = self;
        let settled = |Candidate { mut entry, planned }: Candidate| {
            let predicted = planned.map(|(target, plan)| trials.seconds(&target, &plan));
            entry.seconds = entry.seconds.or(predicted);
            entry.estimate = entry.not_settled(LONGEST);
            entry
        };
        let mut entries: Vec<Entry> = candidates.into_iter().map(settled).collect();
        let warnings = warnings(case, &entries);
        doubt_the_dearest(&mut entries);
        // By work, which no clock counts; the case's own interface where it is the same.
        let best = [Method::Schrodingerized, Method::Classical].map(|method| {
            (entries.iter())
                .filter(|e| e.refused.is_none() && e.estimate.is_none() && e.method == method)
                .min_by(|a, b| a.work().total_cmp(&b.work()))
                .map(|e| e.name.clone())
        });
        entries.sort_by(|a, b| {
            let seconds = |e: &Entry| e.seconds.unwrap_or(f64::INFINITY);
            let refused = a.refused.is_some().cmp(&b.refused.is_some());
            refused.then(seconds(a).total_cmp(&seconds(b)))
        });
        if entries.iter().all(|e| e.refused.is_some()) {
            // One reason: that of the fewest cells.
            let is_open = |e: &Entry| e.known == Known::Extrapolated && e.order.pairs.is_empty();
            let verdict = match entries.iter().any(is_open) {
                true => "is not settled within this budget",
                false => "is out of reach",
            };
            let nearest = (entries.iter()).min_by(|a, b| a.cells.total_cmp(&b.cells));
            let reason = nearest.map_or(String::new(), |e| {
                format!("{}: {}", e.name, e.refused.as_deref().unwrap_or_default())
            });
            return Err(Error::Input(format!(
                "{}: --accuracy {:e} of the density {verdict}. With the fewest cells, {}",
                case.name, wanted.accuracy, reason
            )));
        }
        let [best, best_classical] =
            best.map(|name| name.and_then(|name| entries.iter().position(|e| e.name == name)));
        Ok(Advised {
            title: case.title.clone(),
            accuracy: wanted.accuracy,
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

/// That a region of `V` is not there on the grid of `target`. Very fine grids are not looked at:
/// their edges are on faces, or nearly.
fn vanished(target: &Case) -> Option<String> {
    if target.space.by_elements().space_cells() > MOST_LOOKED_AT {
        return None;
    }
    let region = overlooked(target).empty.into_iter().next()?;
    let grid = shape_text(&target.space.elements());
    Some(format!("potential.{region} is not there on {grid}: its where holds at no cell's centre"))
}
