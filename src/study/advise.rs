//! `phasewarp advise`: the coarsest grid and the cheapest set-up whose density is as exact as asked for.
//!
//! The error is `∫|ρ − ρ_exact| dx / ∫|ρ_exact| dx` at the end, `ρ_exact` averaged over the cells. Schemes are tried on coarse grids
//! without Schrödingerization, each grid twice as fine as the one before; without `[exact]` the error is that of Richardson: from the distance `d` to a grid
//! twice as fine, `e = d/(1 − 2^{−q})`. The order `q` is measured and not assumed: discontinuous solutions have about 1/2. The grid that
//! reaches the accuracy lies between two that were tried, or follows from the order; it is tried itself where the budget allows.
//! Schrödingerization adds at most a tenth of the accuracy: its tolerance follows from the norms of `f` (`crate::study::advise::trials::Found::spread`) and is tried on a coarse grid.
//!
//! What is tried is decided by counted work; of the clock only so much that rank 0 stops what takes far longer than counted on.

pub mod entry;
pub mod order;
pub mod reach;
pub mod report;
pub mod trials;

use crate::base::error::{Error, Result};
use crate::base::text::{bytes_text, word};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::here::{memory_per_rank, refuse_hopeless_here};
use crate::plan::layout::Resources;
use crate::problem::case::{
    Case, Data, Effort, Integrator, Interface, LARGEST_TOLERANCE, Limiter, Method,
};
use crate::run::planning;
use crate::study::advise::entry::{Advised, Entry, Given, Parts};
use crate::study::advise::reach::{DISCRETISATION, Known, Reach, look, reach};
use crate::study::advise::trials::{Scheme, Trials, distance, updates_of};
use crate::study::grids::shape_text;

/// Most of the accuracy that Schrödingerization may take.
const SCHRODINGERIZATION: f64 = 0.1;
/// Part of the budget for grids.
const FOR_GRIDS: f64 = 0.7;
/// Part of the budget for a first run by modes, on a coarse grid.
const FOR_MODES: f64 = 0.05;
/// Part of the budget, at most, for the case as it stands.
const FOR_CASE: f64 = 0.1;
/// What is expected to take more seconds than these, 30 days, is an estimate and no advice.
const LONGEST: f64 = 30.0 * 86400.0;
/// The smallest tolerance that is advised.
const SMALLEST_TOLERANCE: f64 = 1e-12;
/// More cells than this in space are not planned for.
const MOST_SPACE_CELLS: f64 = 4e6;
/// More cells than this are not planned for.
const MOST_CELLS: f64 = 1e11;
/// Bytes a cell of a run, by modes and classical, where none is planned.
const BYTES: [f64; 2] = [340.0, 70.0];
/// An application of a mode counts as so much of an update: eight modes go through memory together.
const MODE: f64 = 0.25;
/// A solve of an implicit step counts as so many updates.
const SOLVE: f64 = 20.0;

/// What is asked for.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Relative L1 error of the density.
    pub accuracy: f64,
    /// Seconds for all trials, about.
    pub budget: f64,
}

/// Finds what reaches `wanted` on `case`. Collective; the same on all ranks.
///
/// # Errors
/// [`Error::Input`] where nothing reaches it, and for a case that starts from a warped field; the error of a trial where none succeeds.
pub fn advise(world: &World, case: &Case, wanted: Wanted) -> Result<Advised> {
    if let Some(start) = &case.start {
        let what = "advice takes other grids, and the file holds one; give initial.f";
        return Err(Error::Input(format!("{}: {what}", start.place)));
    }
    let plain = plain(case)?;
    refuse_hopeless_here(world, &Case { exact: None, ..plain.clone() })?;
    let exact = case.exact.clone();
    let mut trials = Trials::new(world, plain, exact, wanted.budget)?;
    let start = trials.grids.coarsest(&case.space.shape());
    let bounds = Bounds::new(case)?;
    let mut study = Study { world, case, wanted, start, left_out: Vec::new(), entries: Vec::new() };
    let schemes = study.schemes(bounds.jumps);
    let own = own_scheme(case);
    let own_shape = case.space.shape();
    let mut failure = None;
    // The case as it stands before anything else, so that its error is not extrapolated where it is had for little.
    if trials.is_cheap(own, &own_shape, FOR_CASE)? {
        let twice = trials.grids.twice(&own_shape);
        let known = match trials.error(own, &own_shape) {
            Ok(None) if trials.is_cheap(own, &twice, FOR_CASE)? => {
                trials.run(own, &twice).map(|_| ())
            }
            other => other.map(|_| ()),
        };
        if let Err(error) = known {
            study.left_out.push(format!(
                "{} as it stands: {error}",
                name(Method::Classical, own, bounds.jumps)
            ));
        }
    }
    // A coarse grid may see nothing where data are narrow.
    if trials.knows_run(own, &own_shape) && trials.run(own, &study.start).is_err() {
        study.start.clone_from(&own_shape);
    }
    let mut found: Vec<(Scheme, Reach)> = Vec::new();
    for (k, &scheme) in schemes.iter().enumerate() {
        // Most of the budget is for grids, each scheme its share of it; the rest for what is advised.
        let share = FOR_GRIDS * (k + 1) as f64 / schemes.len() as f64;
        let grids = (&study.start[..], &own_shape[..]);
        match reach(&mut trials, scheme, grids, wanted.accuracy, share) {
            Ok(reach) => found.push((scheme, reach)),
            Err(error) => {
                study
                    .left_out
                    .push(format!("{}: {error}", name(Method::Classical, scheme, bounds.jumps)));
                failure = Some(error);
            }
        }
    }
    if found.is_empty() {
        return Err(failure.unwrap_or_else(|| Error::Input("nothing to try".to_owned())));
    }
    for (scheme, reach) in &found {
        study.classical(&mut trials, *scheme, reach, bounds.jumps)?;
        if scheme.limiter == Limiter::None {
            study.schrodingerized(&mut trials, *scheme, reach, bounds.jumps)?;
        }
    }
    let own = found.iter().find(|(scheme, _)| *scheme == own);
    let given = match own {
        Some((scheme, reach)) => study.given(&mut trials, *scheme, reach)?,
        None => None,
    };
    let mut entries = study.entries;
    for entry in &mut entries {
        if entry.method == Method::Schrodingerized
            && !entry.seconds_measured
            && let (Some(rate), true) = (trials.rate_by_modes(), entry.applications > 0.0)
        {
            entry.seconds = Some(rate * MODE * entry.applications * entry.computed_cells);
        }
        entry.estimate = estimate(entry);
    }
    let warnings = warnings(case, &entries);
    // By work, which no clock counts; the case's own interface where it is the same.
    let work = |e: &Entry| e.applications * e.computed_cells;
    let best = (entries.iter())
        .filter(|e| e.refused.is_none() && e.estimate.is_none())
        .filter(|e| e.method == Method::Schrodingerized)
        .min_by(|a, b| work(a).total_cmp(&work(b)))
        .map(|e| e.name.clone());
    let place = |e: &Entry| (e.refused.is_some(), e.seconds.unwrap_or(f64::INFINITY));
    entries.sort_by(|a, b| {
        let (a, b) = (place(a), place(b));
        a.0.cmp(&b.0).then(a.1.total_cmp(&b.1))
    });
    if entries.iter().all(|e| e.refused.is_some()) {
        // One reason: that of the fewest cells.
        let nearest = (entries.iter()).min_by(|a, b| a.cells.total_cmp(&b.cells));
        let reason = nearest.map_or(String::new(), |e| {
            format!("{}: {}", e.name, e.refused.as_deref().unwrap_or_default())
        });
        return Err(Error::Input(format!(
            "{}: --accuracy {:e} of the density is out of reach. With the fewest cells, {}",
            case.name, wanted.accuracy, reason
        )));
    }
    Ok(Advised {
        title: case.title.clone(),
        accuracy: wanted.accuracy,
        ranks: world.group().size(),
        exact: trials.knows(),
        given,
        best: best.and_then(|name| entries.iter().position(|e| e.name == name)),
        entries,
        left_out: study.left_out,
        warnings,
    })
}

/// The scheme of the case as it stands.
fn own_scheme(case: &Case) -> Scheme {
    Scheme {
        interface: case.interface,
        limiter: match case.method {
            Method::Classical => case.limiter,
            Method::Schrodingerized => Limiter::None,
        },
    }
}

/// The case with what is planned, and nothing but the field at its end.
fn plain(case: &Case) -> Result<Case> {
    let mut set = case.overrides.clone();
    set.extend(DEFAULTS.map(str::to_owned));
    Ok(Case {
        exact: None,
        readout: None,
        plateau: None,
        times: Vec::new(),
        ..Case::parse(&case.name, &case.text, &set)?
    })
}

/// A Schrödingerized run by what is planned.
const DEFAULTS: [&str; 6] = [
    "solver.method=schrodingerized",
    "scheme.limiter=none",
    "solver.verify=false",
    "solver.warp={}",
    "solver.propagator={}",
    "output.warped_field=false",
];

fn name(method: Method, scheme: Scheme, jumps: bool) -> String {
    let interface = match (jumps, scheme.interface) {
        (false, _) => "",
        (true, Interface::Hat) => ", hat interface",
        (true, Interface::Conservative) => ", conservative interface",
    };
    let what = match (method, scheme.limiter) {
        (Method::Schrodingerized, _) => "Schrödingerized",
        (Method::Classical, Limiter::None) => "classical, exponential",
        (Method::Classical, Limiter::Minmod) => "classical, SSP-RK3 with minmod slopes",
        (Method::Classical, Limiter::VanLeer) => "classical, SSP-RK3 with van Leer slopes",
    };
    let weights = match (method, scheme.interface) {
        (Method::Schrodingerized, Interface::Hat) if jumps => " and weights",
        _ => "",
    };
    format!("{what}{interface}{weights}")
}

/// Why what was found is an estimate and no advice.
fn estimate(entry: &Entry) -> Option<String> {
    if entry.refused.is_some() {
        return None;
    }
    if entry.known == Known::Extrapolated && entry.order.pairs.len() < 2 {
        return Some("not settled within this budget; a longer --budget does".to_owned());
    }
    match entry.seconds {
        Some(seconds) if seconds > LONGEST => {
            Some("not settled within this budget; it is expected to take more than 30 days on these ranks".to_owned())
        }
        _ => None,
    }
}

/// What the user should know.
fn warnings(case: &Case, entries: &[Entry]) -> Vec<String> {
    let mut warnings = Vec::new();
    let names = ["x", "y", "z"];
    let can = || entries.iter().filter(|e| e.refused.is_none());
    let unsettled: Vec<String> = can()
        .filter(|e| !e.order.settled && e.known == Known::Extrapolated)
        .map(|e| format!("{} ({})", e.name, crate::study::advise::report::pairs(&e.order)))
        .collect();
    if !unsettled.is_empty() {
        warnings.push(format!(
            "the order has not settled from grid to grid, the lower of the last two is counted on where errors fall, and the grid may be finer or coarser than it need be: {}",
            unsettled.join("; ")
        ));
    }
    for (axis, name) in names.iter().enumerate() {
        if can().any(|e| e.moved_edges.contains(&axis)) {
            warnings.push(format!(
                "no grid nearby has faces on all edges of V across {name}; they are moved to the nearest faces, which is part of the error"
            ));
        }
    }
    if case.readout.is_some() {
        warnings.push("readout.cells are cells of the case's own grid: on another they lie elsewhere, or nowhere".to_owned());
    }
    warnings
}

/// What is found on the way to advice.
struct Study<'a> {
    world: &'a World,
    case: &'a Case,
    wanted: Wanted,
    /// The coarsest grid.
    start: Vec<usize>,
    left_out: Vec<String>,
    entries: Vec<Entry>,
}

impl Study<'_> {
    /// The schemes that are tried.
    fn schemes(&mut self, jumps: bool) -> Vec<Scheme> {
        let own = self.case.interface;
        let first = |interface| Scheme { interface, limiter: Limiter::None };
        let mut schemes = vec![first(own)];
        if jumps {
            let other = match own {
                Interface::Hat => Interface::Conservative,
                Interface::Conservative => Interface::Hat,
            };
            schemes.push(first(other));
        }
        if self.case.varies() {
            self.left_out.push(
                "slopes (scheme.limiter): not with an inflow that depends on time".to_owned(),
            );
        } else {
            let slopes = [Limiter::Minmod, Limiter::VanLeer];
            schemes.extend(slopes.map(|limiter| Scheme { interface: own, limiter }));
        }
        schemes
    }

    fn resources(&self) -> Resources {
        let all = self.world.group();
        Resources { ranks: all.size(), ranks_x: None, memory_per_rank: Some(memory_per_rank(&all)) }
    }

    /// The set-up on the grid of `reach` before what it costs is known.
    fn entry(
        &self,
        trials: &Trials<'_>,
        target: &Case,
        scheme: Scheme,
        reach: &Reach,
        jumps: bool,
    ) -> Entry {
        let settings = settings(self.case, &trials.plain, target);
        let mut entry = Entry {
            name: name(target.method, scheme, jumps),
            method: target.method,
            interface: scheme.interface,
            limiter: scheme.limiter,
            shape: reach.shape.clone(),
            cells: reach.shape.iter().map(|&n| n as f64).product(),
            computed_cells: (trials.merged(target).space.axes()).map(|a| a.cells as f64).product(),
            tolerance: None,
            error: reach.error,
            known: reach.known,
            parts: parts(reach.error, reach.part_of_space),
            order: reach.order.clone(),
            levels: reach.levels.clone(),
            moved_edges: trials.grids.moved(&reach.shape),
            applications: 0.0,
            memory_bytes_per_rank: 0.0,
            seconds: None,
            seconds_measured: false,
            refused: None,
            estimate: None,
            command: command(self.case, &settings),
            settings,
        };
        let wanted = DISCRETISATION * self.wanted.accuracy;
        if reach.order.pairs.is_empty() && reach.known == Known::Extrapolated {
            entry.refused = Some(
                "the budget does not hold two grids to compare; a longer --budget does".to_owned(),
            );
        } else if entry.error.is_nan() || entry.error > wanted * (1.0 + 1e-9) {
            entry.refused = Some(if reach.order.falls() {
                format!(
                    "the error is {:.1e} on {}, and no finer grid was found that reaches it within --budget",
                    entry.error,
                    shape_text(&entry.shape)
                )
            } else {
                format!(
                    "the error does not fall with the grid: {:.1e} on {}",
                    entry.error,
                    shape_text(&entry.shape)
                )
            });
        }
        entry
    }

    /// Plans `target`, or says why it cannot be run. Collective.
    fn plan(&self, trials: &Trials<'_>, entry: &mut Entry, target: &Case) -> Option<Plan> {
        let merged = trials.merged(target);
        let space: f64 = merged.space.x.iter().map(|a| a.cells as f64).product();
        if entry.refused.is_some() {
            return None;
        }
        if space > MOST_SPACE_CELLS || entry.computed_cells > MOST_CELLS {
            let [by_modes, classical] = BYTES;
            let each = match target.method {
                Method::Schrodingerized => by_modes,
                Method::Classical => classical,
            };
            let bytes = entry.computed_cells * each / self.world.group().size() as f64;
            entry.memory_bytes_per_rank = bytes;
            entry.refused = Some(if entry.cells > crate::study::advise::report::MOST_SHOWN {
                format!("it takes {}", crate::study::advise::report::grid(&entry.shape))
            } else {
                format!(
                    "it takes {}, about {} a rank",
                    crate::study::advise::report::grid(&entry.shape),
                    bytes_text(bytes as u64)
                )
            });
            return None;
        }
        match planning::plan(self.world, target, &self.resources()) {
            Ok(plan) => {
                entry.memory_bytes_per_rank = plan.memory() as f64;
                entry.computed_cells = plan.cells as f64;
                entry.applications = match &plan.warp {
                    Some(warp) => warp.applications as f64,
                    None => {
                        plan.classical_steps as f64
                            * if entry.limiter == Limiter::None { 1.0 } else { 3.0 }
                    }
                };
                Some(plan)
            }
            Err(error) => {
                entry.refused = Some(format!(
                    "on {}: {error}",
                    crate::study::advise::report::grid(&entry.shape)
                ));
                None
            }
        }
    }

    /// Adds `scheme` without Schrödingerization. Collective.
    fn classical(
        &mut self,
        trials: &mut Trials<'_>,
        scheme: Scheme,
        reach: &Reach,
        jumps: bool,
    ) -> Result<()> {
        let target = scheme.classical(&trials.plain, &reach.shape);
        let mut entry = self.entry(trials, &target, scheme, reach, jumps);
        if self.plan(trials, &mut entry, &target).is_some() {
            let merged = trials.merged(&target);
            let updates = updates_of(&merged, &Bounds::new(&merged)?);
            entry.seconds_measured = trials.knows_run(scheme, &reach.shape);
            entry.seconds = if entry.seconds_measured {
                Some(trials.run(scheme, &reach.shape)?.seconds)
            } else {
                trials.rate(scheme).map(|rate| rate * updates)
            };
        }
        self.entries.push(entry);
        Ok(())
    }

    /// The finest grid tried, but for the last, on which a run by modes is a small part of the budget. Collective.
    fn coarse(
        &self,
        trials: &Trials<'_>,
        scheme: Scheme,
        reach: &Reach,
        tolerance: f64,
    ) -> Result<Vec<usize>> {
        for level in reach.levels.iter().rev().skip(1) {
            let mut case = scheme.schrodingerized(&trials.plain, &level.shape);
            case.tolerance = tolerance.clamp(SMALLEST_TOLERANCE, LARGEST_TOLERANCE);
            let case = trials.merged(&case);
            let bounds = Bounds::new(&case)?;
            let plan = Plan::provisional(&case, &bounds, &self.resources());
            if plan.is_ok_and(|plan| trials.is_small(mode_updates(&plan), FOR_MODES)) {
                return Ok(level.shape.clone());
            }
        }
        let coarsest = reach.levels.first().map_or(&reach.shape, |level| &level.shape);
        Ok(coarsest.clone())
    }

    /// Adds `scheme` by Schrödingerization. Collective.
    fn schrodingerized(
        &mut self,
        trials: &mut Trials<'_>,
        scheme: Scheme,
        reach: &Reach,
        jumps: bool,
    ) -> Result<()> {
        let allowed = SCHRODINGERIZATION * self.wanted.accuracy;
        let coarse = self.coarse(trials, scheme, reach, allowed)?;
        let reference = trials.run(scheme, &coarse)?;
        let (density, spread) = (reference.density.clone(), reference.spread);
        let guaranteed = matches!(self.case.data, Data::Density);
        // Level sets enter the density through a delta function as wide as a cell: a tenth of what a field may have, and it is tried.
        let mut tolerance = if guaranteed { allowed / spread } else { 0.1 * allowed };
        let mut target = scheme.schrodingerized(&trials.plain, &coarse);
        let mut measured: Option<f64> = None;
        let (resources, left_out) = (self.resources(), &mut self.left_out);
        let mut leave_out = |error: Error| {
            let what = name(Method::Schrodingerized, scheme, jumps);
            left_out.push(format!("{what} on {}: {error}", shape_text(&coarse)));
        };
        for _ in 0..4 {
            tolerance = rounded(tolerance.clamp(SMALLEST_TOLERANCE, LARGEST_TOLERANCE));
            target.tolerance = tolerance;
            let plan = match planning::plan(self.world, &target, &resources) {
                Ok(plan) => plan,
                Err(error) => {
                    leave_out(error);
                    return Ok(());
                }
            };
            let updates = mode_updates(&plan);
            if !trials.allows(updates, 0.8) {
                break;
            }
            let found = match trials.measure(&target, updates) {
                Ok(found) => found,
                Err(error) => {
                    leave_out(error);
                    return Ok(());
                }
            };
            let part = distance(&found.density, &density);
            measured = Some(part);
            if part <= allowed || tolerance <= SMALLEST_TOLERANCE {
                break;
            }
            tolerance *= 0.1;
        }
        if !guaranteed {
            // The delta function gets narrower with the cells.
            let narrower = coarse[coarse.len() - 1] as f64 / reach.shape[coarse.len() - 1] as f64;
            tolerance = rounded((tolerance * narrower.min(1.0)).max(SMALLEST_TOLERANCE));
        }
        target = scheme.schrodingerized(&trials.plain, &reach.shape);
        target.tolerance = tolerance;
        let mut entry = self.entry(trials, &target, scheme, reach, jumps);
        entry.tolerance = Some(tolerance);
        let bound = guaranteed.then_some(tolerance * spread);
        let mut part = measured.into_iter().chain(bound).reduce(f64::max);
        if let Some(plan) = self.plan(trials, &mut entry, &target) {
            let updates = mode_updates(&plan);
            let rate = trials.rate_by_modes().or_else(|| trials.rate(scheme));
            entry.seconds = rate.map(|rate| rate * updates);
            if trials.allows(updates, 1.0) && trials.may(scheme, &reach.shape, 1.0)? {
                match trials.measure(&target, updates) {
                    Ok(found) => {
                        entry.seconds = Some(found.seconds);
                        entry.seconds_measured = true;
                        let reference = trials.run(scheme, &reach.shape)?;
                        let on_the_grid = distance(&found.density, &reference.density);
                        part = Some(on_the_grid);
                        match trials.error_of(&found.density, &reach.shape)? {
                            Some(error) => (entry.error, entry.known) = (error, Known::Measured),
                            None => entry.error += on_the_grid,
                        }
                    }
                    Err(error) => entry.refused = Some(error.to_string()),
                }
            } else {
                entry.error += part.unwrap_or(0.0);
            }
            if entry.refused.is_none() && entry.error > self.wanted.accuracy * (1.0 + 1e-9) {
                entry.refused = Some(format!(
                    "the error is {:.2e} on {}",
                    entry.error,
                    shape_text(&entry.shape)
                ));
            }
        }
        entry.parts.schrodingerization = part;
        self.entries.push(entry);
        Ok(())
    }

    /// The case as it stands: the discretisation by `scheme`, which is its own, and what its solver adds. Collective.
    fn given(
        &self,
        trials: &mut Trials<'_>,
        scheme: Scheme,
        reach: &Reach,
    ) -> Result<Option<Given>> {
        let shape = self.case.space.shape();
        let looked = look(trials, scheme, &shape, &reach.order, 1.0).unwrap_or(None);
        let (error, known) = match (looked, reach.levels.last()) {
            (Some(looked), _) => looked,
            (None, Some(level)) => {
                // Each part of the error by its own axes' cells.
                let n = shape.len() / 2;
                let finer = |axes: std::ops::Range<usize>| {
                    let ratio = |k: usize| shape[k] as f64 / level.shape[k] as f64;
                    let product: f64 = axes.map(ratio).product();
                    product.powf(-reach.order.counted_on / n as f64)
                };
                let part = reach.part_of_space;
                let ratio = part * finer(0..n) + (1.0 - part) * finer(n..2 * n);
                (level.error * ratio, Known::Extrapolated)
            }
            (None, None) => return Ok(None),
        };
        let mut parts = parts(error, reach.part_of_space);
        let spread = trials.run(scheme, &self.start)?.spread;
        if self.case.method == Method::Schrodingerized && matches!(self.case.data, Data::Density) {
            if self.case.propagator.method.order() == 0 {
                parts.schrodingerization = Some(self.case.tolerance * spread);
            } else {
                let mut own = scheme.schrodingerized(self.case, &self.start);
                (own.exact, own.readout, own.plateau, own.verify) = (None, None, None, false);
                (own.times, own.warped_field) = (Vec::new(), false);
                let updates = planning::plan(self.world, &own, &self.resources())
                    .map_or(f64::INFINITY, |plan| mode_updates(&plan));
                if trials.allows(updates, 1.0)
                    && let Ok(found) = trials.measure(&own, updates)
                {
                    let reference = trials.run(scheme, &self.start)?;
                    // All that the solver makes wrong is mostly its step.
                    parts.step = Some(distance(&found.density, &reference.density));
                }
            }
        }
        if let Some(readout) = &self.case.readout
            && let Effort::Accuracy(accuracy) = readout.effort
        {
            let rough = trials.run(scheme, &self.start)?;
            let mean =
                rough.density.iter().map(|rho| rho.abs()).sum::<f64>() / rough.density.len() as f64;
            parts.readout = Some(accuracy / mean);
        }
        let added: f64 =
            [parts.schrodingerization, parts.step, parts.readout].into_iter().flatten().sum();
        Ok(Some(Given { shape, error: error + added, known, parts }))
    }
}

/// Discretisation by its two parts.
fn parts(error: f64, part_of_space: f64) -> Parts {
    Parts {
        space: error * part_of_space,
        velocity: error * (1.0 - part_of_space),
        schrodingerization: None,
        step: None,
        readout: None,
    }
}

/// Updates that a run by modes counts as.
fn mode_updates(plan: &Plan) -> f64 {
    let work = plan.warp.as_ref().map_or(0.0, |warp| {
        MODE * warp.applications as f64 + SOLVE * (warp.solves * plan.steps.max(1)) as f64
    });
    work * plan.cells as f64
}

/// The largest number of one digit that is not larger.
fn rounded(x: f64) -> f64 {
    let power = x.log10().floor() as i32;
    let unit = 10f64.powi(power);
    let digit = (x / unit * (1.0 + 1e-9)).floor().clamp(1.0, 9.0);
    // As it is written, so that the command has the same number.
    format!("{digit}e{power}").parse().unwrap_or(x)
}

/// What `--set` takes to make `target` of `case`; `plain` is the case by what is planned.
fn settings(case: &Case, plain: &Case, target: &Case) -> Vec<String> {
    let mut set = Vec::new();
    let space = [("x", &case.space.x, &target.space.x), ("v", &case.space.v, &target.space.v)];
    for a in 0..case.space.dimension() {
        for (key, own, new) in space {
            if own[a].cells != new[a].cells {
                set.push(format!("axis.{a}.{key}.cells={}", new[a].cells));
            }
        }
    }
    let mut word_of = |key: &str, differs: bool, value: String| {
        if differs {
            set.push(format!("{key}={value}"));
        }
    };
    word_of("solver.method", case.method != target.method, word(&target.method));
    word_of("scheme.interface", case.interface != target.interface, word(&target.interface));
    word_of("scheme.limiter", case.limiter != target.limiter, word(&target.limiter));
    match target.method {
        Method::Classical => {
            let integrator: Integrator = target.integrator;
            word_of(
                "solver.classical.integrator",
                case.integrator != integrator,
                word(&integrator),
            );
            word_of(
                "solver.verify",
                case.verify && target.limiter != Limiter::None,
                "false".to_owned(),
            );
            word_of("output.warped_field", case.warped_field, "false".to_owned());
        }
        Method::Schrodingerized => {
            word_of(
                "solver.tolerance",
                case.tolerance != target.tolerance,
                format!("{:e}", target.tolerance),
            );
            // A classical case does not show all that its tables hold.
            let hidden = case.method == Method::Classical
                && case.settings.keys().any(|key| key.starts_with("solver.warp"));
            word_of("solver.warp", hidden || case.warp != plain.warp, "{}".to_owned());
            word_of("solver.propagator", case.propagator != plain.propagator, "{}".to_owned());
        }
    }
    set
}

/// `phasewarp run` with them, to be pasted into a shell.
fn command(case: &Case, settings: &[String]) -> String {
    let key = |set: &str| set.split('=').next().unwrap_or_default().trim().to_owned();
    let replaced = |old: &&String| settings.iter().any(|new| key(new) == key(old));
    let kept = case.overrides.iter().filter(|old| !replaced(old));
    let mut text = format!("phasewarp run {}", quoted(&case.name));
    for set in kept.chain(settings) {
        text += &format!(" --set {}", quoted(set));
    }
    text
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', "'\\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tolerances_are_rounded_down_to_a_digit() {
        for (x, digit) in [(3.7e-4, 3e-4), (1e-3, 1e-3), (0.1, 0.1), (9.99e-5, 9e-5)] {
            assert_eq!(rounded(x), digit);
        }
    }

    #[test]
    fn settings_lead_from_a_case_to_the_target() {
        let text = r#"
            axis = [{ x = { lower = -1, upper = 1, cells = 20 }, v = { lower = -1, upper = 1, cells = 20 } }]
            potential = [{ where = "x < 0", value = "0.1" }, { value = "0" }]
            initial.f = "exp(-20*(x^2 + v^2))"
            time.end = 0.5
            solver.tolerance = 1e-5
            solver.warp = { profile = "smooth", order = 4 }
            solver.propagator = { method = "crank-nicolson", step = 0.1 }
        "#;
        let read = |set: &[String]| Case::parse("case.toml", text, set);
        let case = read(&["axis.0.v.cells=24".to_owned()]).unwrap();
        let plain = plain(&case).unwrap();
        for interface in [Interface::Hat, Interface::Conservative] {
            let scheme = Scheme { interface, limiter: Limiter::None };
            let mut target = scheme.schrodingerized(&plain, &[40, 36]);
            target.tolerance = 3e-4;
            let set = settings(&case, &plain, &target);
            let found = read(&set).unwrap();
            assert_eq!(found.space, target.space);
            assert_eq!((found.interface, found.tolerance), (interface, 3e-4));
            assert_eq!((found.warp, found.propagator), (plain.warp, plain.propagator));
            let command = command(&case, &set);
            assert!(command.contains("--set 'solver.warp={}'"), "{command}");
            assert!(!command.contains("cells=24"), "{command}");
        }
        let scheme = Scheme { interface: Interface::Hat, limiter: Limiter::VanLeer };
        let found = read(&settings(&case, &plain, &scheme.classical(&plain, &[40, 36]))).unwrap();
        assert_eq!(
            (found.method, found.limiter, found.integrator),
            (Method::Classical, Limiter::VanLeer, Integrator::SspRk3)
        );
    }

    #[test]
    fn shells_get_words() {
        assert_eq!(quoted("axis.0.x.cells=12"), "axis.0.x.cells=12");
        assert_eq!(quoted("initial.f=exp(-x*x)"), "'initial.f=exp(-x*x)'");
        assert_eq!(quoted("it's"), "'it'\\''s'");
    }
}
