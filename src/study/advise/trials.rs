//! Runs on trial grids, each done once, and their densities' errors.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::{Group, World};
use crate::parallel::partition::split;
use crate::problem::case::{Case, Exact, Integrator, Interface, Limiter, Method};
use crate::problem::exact::Tracer;
use crate::problem::exact::sheet::exact_moments;
use crate::problem::grid::{Axis, Part, PhaseSpace, for_each_cell};
use crate::propagate::classical::classical_steps;
use crate::scheme::reduce::reduced;
use crate::study::grids::shape_text;
use crate::study::grids::{Grids, averaged};
use crate::study::trial::{Trial, trial};
use serde::Serialize;
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Instant;

/// Updates of a cell that count as a second of the budget: a third of what a core does or less. Counted rather than timed, so that
/// the same is tried on every machine and on any ranks.
const UPDATES: f64 = 2e7;
/// An update with slopes counts as so many.
const WITH_SLOPES: f64 = 8.0;
/// The exact density is averaged over at most so many points of phase space, where the cells themselves are no more.
const MOST_POINTS: usize = 200_000;
/// An exact value counts as so many updates: particles are traced back over slopes and jumps.
const EXACT_VALUE: f64 = 200.0;
/// And so many along an axis of each cell.
const MOST_PARTS: usize = 8;

/// A semi-discrete scheme.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Scheme {
    /// Interface rows.
    pub interface: Interface,
    /// Slopes.
    pub limiter: Limiter,
}

impl Scheme {
    /// `case` on `shape` cells by this scheme, without Schrödingerization.
    pub fn classical(self, case: &Case, shape: &[usize]) -> Case {
        Case {
            method: Method::Classical,
            limiter: self.limiter,
            integrator: match self.limiter {
                Limiter::None => Integrator::Exponential,
                _ => Integrator::SspRk3,
            },
            ..self.schrodingerized(case, shape)
        }
    }

    /// `case` on `shape` cells by this scheme's interface.
    pub fn schrodingerized(self, case: &Case, shape: &[usize]) -> Case {
        let mut case = case.clone();
        let space = &mut case.space;
        for (axis, cells) in space.x.iter_mut().chain(&mut space.v).zip(shape) {
            axis.cells = *cells;
        }
        case.interface = self.interface;
        case
    }
}

/// What a trial gave.
pub struct Found {
    /// The density on all of space.
    pub density: Vec<f64>,
    /// Seconds it took, the longest of the ranks.
    pub seconds: f64,
    /// Updates of a cell that it counted as.
    pub updates: f64,
    /// `(V ∫f²)^½ / ∫|ρ|` with `V` the volume of the phase-space box: by at most so much is the relative L1 distance of densities more than the
    /// relative l2 distance of fields (Cauchy and Schwarz).
    pub spread: f64,
}

/// All trials of a case.
pub struct Trials<'a> {
    world: &'a World,
    /// The case without all that is not needed on trial grids, by Schrödingerization with what is planned.
    pub plain: Case,
    exact: Option<Exact>,
    /// Grids over its box.
    pub grids: Grids,
    started: Instant,
    seconds: f64,
    spent: f64,
    done: BTreeMap<(Interface, Limiter, Vec<usize>), Found>,
    densities: BTreeMap<Vec<usize>, Vec<f64>>,
    /// Seconds and updates of all runs by modes.
    by_modes: [f64; 2],
}

impl<'a> Trials<'a> {
    /// Of `plain`, compared with `exact`, for about so many seconds. Collective.
    ///
    /// # Errors
    /// As [`reduced`].
    pub fn new(world: &'a World, plain: Case, exact: Option<Exact>, seconds: f64) -> Result<Self> {
        let needed = reduced(&world.group(), &plain)?;
        let merged = |axis: &Axis| matches!(axis.part, Part::Merged { .. });
        Ok(Self {
            world,
            grids: Grids::new(&plain).with_merged(needed.space.axes().map(merged).collect()),
            plain,
            exact,
            started: Instant::now(),
            seconds,
            spent: 0.0,
            done: BTreeMap::new(),
            densities: BTreeMap::new(),
            by_modes: [0.0; 2],
        })
    }

    /// `case` as its runs merge it: explicit steps keep the grid.
    pub fn merged(&self, case: &Case) -> Case {
        let mut case = case.clone();
        if case.limiter == Limiter::None {
            let space = &mut case.space;
            let axes = space.x.iter_mut().chain(&mut space.v);
            for (axis, merged) in axes.zip(self.grids.merged()) {
                if *merged && axis.cells > 1 {
                    *axis = axis.merged();
                }
            }
        }
        case
    }

    /// All ranks.
    pub fn group(&self) -> Group {
        self.world.group()
    }

    /// Whether there is an exact solution.
    pub fn knows(&self) -> bool {
        self.exact.is_some()
    }

    /// Updates that a trial counts as; infinitely many for a grid so large that one of each of its cells is beyond the budget.
    fn updates(&self, case: &Case) -> Result<f64> {
        let case = &self.merged(case);
        let cells: f64 = case.space.axes().map(|a| a.cells as f64).product();
        if cells > self.seconds * UPDATES {
            return Ok(f64::INFINITY);
        }
        Ok(updates_of(case, &Bounds::new(case)?))
    }

    /// Whether so many updates more may be tried, with a share of what the budget holds. By count, and by rank 0's clock should that be much slower
    /// than counted on. Collective.
    pub fn allows(&self, updates: f64, share: f64) -> bool {
        let rank_zero = self.group().rank() == 0;
        let mine = if rank_zero { self.started.elapsed().as_secs_f64() } else { 0.0 };
        let late = self.group().max(mine) > self.seconds;
        !late && self.spent + updates <= share * self.seconds * UPDATES
    }

    /// Updates that comparing a density on `shape` with the exact one counts as, which is computed once.
    fn updates_to_compare(&self, shape: &[usize]) -> f64 {
        if self.exact.is_none() || self.densities.contains_key(shape) {
            return 0.0;
        }
        let cells: f64 = shape.iter().map(|&n| n as f64).product();
        EXACT_VALUE * cells.max(MOST_POINTS as f64 / 4.0)
    }

    /// Whether so many updates are no more than this part of the budget.
    pub fn is_small(&self, updates: f64, part: f64) -> bool {
        updates <= part * self.seconds * UPDATES
    }

    /// Whether a run of `scheme` on `shape` counts as no more than this part of the budget.
    pub fn is_cheap(&self, scheme: Scheme, shape: &[usize], part: f64) -> Result<bool> {
        let updates = self.updates(&scheme.classical(&self.plain, shape))?;
        Ok(self.is_small(updates + self.updates_to_compare(shape), part))
    }

    /// Whether `scheme` on `shape` was tried or may be.
    pub fn may(&self, scheme: Scheme, shape: &[usize], share: f64) -> Result<bool> {
        let known = self.knows_run(scheme, shape);
        let compare = self.updates_to_compare(shape);
        let updates = self.updates(&scheme.classical(&self.plain, shape))?;
        let allowed = self.allows(if known { compare } else { compare + updates }, share);
        Ok(allowed || (known && compare == 0.0))
    }

    /// Whether `scheme` on `shape` was tried.
    pub fn knows_run(&self, scheme: Scheme, shape: &[usize]) -> bool {
        self.done.contains_key(&key(scheme, shape))
    }

    /// Tries `scheme` on `shape` classically, if it was not. Collective.
    ///
    /// # Errors
    /// As [`trial`].
    pub fn run(&mut self, scheme: Scheme, shape: &[usize]) -> Result<&Found> {
        let key = key(scheme, shape);
        if !self.done.contains_key(&key) {
            let case = scheme.classical(&self.plain, shape);
            let merged = self.merged(&case);
            let updates = updates_of(&merged, &Bounds::new(&merged)?);
            let found = self.measure(&case, updates)?;
            self.done.insert(key.clone(), found);
        }
        Ok(&self.done[&key])
    }

    /// Runs `case`, which counts as so many updates. Collective.
    ///
    /// # Errors
    /// As [`trial`]; [`Error::Input`] where the density is zero everywhere.
    pub fn measure(&mut self, case: &Case, updates: f64) -> Result<Found> {
        self.spent += updates;
        let found = trial(self.world, case)?;
        let group = self.group();
        let density = whole(&group, &case.space, &found.share, &found.moments.density);
        refuse_nothing(&density, &case.space)?;
        let seconds = group.max(found.seconds);
        if case.method == Method::Schrodingerized {
            self.by_modes[0] += seconds;
            self.by_modes[1] += updates;
        }
        Ok(Found {
            seconds,
            updates,
            spread: spread(&group, &case.space, &found, &density),
            density,
        })
    }

    /// The relative L1 error of the density of `scheme` on `shape`; `None` where no exact solution is known. Collective.
    ///
    /// # Errors
    /// As [`trial`], and where the exact solution is not finite.
    pub fn error(&mut self, scheme: Scheme, shape: &[usize]) -> Result<Option<f64>> {
        let density = self.run(scheme, shape)?.density.clone();
        self.error_of(&density, shape)
    }

    /// As [`error`](Self::error), of a density on `shape`. Collective.
    ///
    /// # Errors
    /// Where the exact solution is not finite.
    pub fn error_of(&mut self, density: &[f64], shape: &[usize]) -> Result<Option<f64>> {
        let Some(exact) = &self.exact else {
            return Ok(None);
        };
        if !self.densities.contains_key(shape) {
            let case = Scheme { interface: self.plain.interface, limiter: Limiter::None }
                .schrodingerized(&self.plain, shape);
            self.spent += self.updates_to_compare(shape);
            let found = exact_density(&self.group(), &case, exact)?;
            refuse_nothing(&found, &case.space)?;
            self.densities.insert(shape.to_vec(), found);
        }
        Ok(Some(distance(density, &self.densities[shape])))
    }

    /// The relative L1 distance of the densities of `scheme` on two grids, the second one finer. Collective.
    ///
    /// # Errors
    /// As [`trial`].
    pub fn distance(&mut self, scheme: Scheme, coarse: &[usize], fine: &[usize]) -> Result<f64> {
        let n = coarse.len() / 2;
        let finer = &self.run(scheme, fine)?.density;
        let finer = averaged(finer, &fine[..n], &coarse[..n]);
        Ok(distance(&self.run(scheme, coarse)?.density, &finer))
    }

    /// Seconds of an update by modes: all runs together, so that what takes less work is not said to take longer.
    pub fn rate_by_modes(&self) -> Option<f64> {
        let [seconds, updates] = self.by_modes;
        (updates > 0.0).then_some(seconds / updates)
    }

    /// Seconds of an update of `scheme`, from the largest trial.
    pub fn rate(&self, scheme: Scheme) -> Option<f64> {
        (self.done.iter())
            .filter(|((interface, limiter, _), _)| {
                (*interface, *limiter) == (scheme.interface, scheme.limiter)
            })
            .max_by(|a, b| a.1.updates.total_cmp(&b.1.updates))
            .map(|(_, found)| found.seconds / found.updates)
    }
}

/// Updates that a classical run of a case with these bounds takes, those with slopes counted for what they are.
pub fn updates_of(case: &Case, bounds: &Bounds) -> f64 {
    let cells: f64 = case.space.axes().map(|a| a.cells as f64).product();
    let steps: usize = classical_steps(case, bounds).iter().sum();
    let each = match case.limiter {
        Limiter::None => 1.0,
        // Three stages a step.
        Limiter::Minmod | Limiter::VanLeer => 3.0 * WITH_SLOPES,
    };
    each * steps as f64 * cells * case.fields.len() as f64
}

fn key(scheme: Scheme, shape: &[usize]) -> (Interface, Limiter, Vec<usize>) {
    (scheme.interface, scheme.limiter, shape.to_vec())
}

/// An error relative to nothing is none.
fn refuse_nothing(density: &[f64], space: &PhaseSpace) -> Result<()> {
    let size: f64 = density.iter().map(|rho| rho.abs()).sum();
    if size > 0.0 && size.is_finite() {
        return Ok(());
    }
    let what = if size == 0.0 { "zero" } else { "not finite" };
    Err(Error::Input(format!(
        "the density is {what}: a relative error has no meaning (at the end, on {} cells)",
        shape_text(&space.shape())
    )))
}

/// `Σ |a − b| / Σ |b|`.
pub fn distance(a: &[f64], b: &[f64]) -> f64 {
    let difference: f64 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
    let size: f64 = b.iter().map(|b| b.abs()).sum();
    if difference == 0.0 { 0.0 } else { difference / size }
}

/// See [`Found::spread`]. Collective.
fn spread(group: &Group, space: &PhaseSpace, trial: &Trial, density: &[f64]) -> f64 {
    let squares: Vec<f64> = (trial.fields[0].chunks(space.velocity_cells()))
        .map(|cells| cells.iter().map(|f| f * f).sum())
        .collect();
    let square = group.sum_terms(&squares) * space.cell_volume();
    let box_volume: f64 = space.axes().map(|a| a.upper - a.lower).product();
    let cell = space.cell_volume() / space.velocity_volume();
    let mass = density.iter().map(|rho| rho.abs()).sum::<f64>() * cell;
    (box_volume * square).sqrt() / mass
}

/// Values on this rank's share of space, put together on all ranks. Collective.
fn whole(group: &Group, space: &PhaseSpace, share: &[Range<usize>], mine: &[f64]) -> Vec<f64> {
    // As integers, zero elsewhere: a sum over the ranks leaves every bit.
    let mut bits = vec![0i64; space.space_cells()];
    let mut values = mine.iter();
    for_each_cell(share, |i| {
        let index = (space.x.iter().zip(i)).fold(0, |k, (axis, i)| k * axis.cells + i);
        if let Some(value) = values.next() {
            bits[index] = value.to_bits() as i64;
        }
    });
    group.sum_integers(&mut bits);
    bits.into_iter().map(|b| f64::from_bits(b as u64)).collect()
}

/// Averages of the exact density over the space cells of `case`. `f` is taken at the centres of parts of each cell: its own `f(0)` taken at the centres of cells is
/// part of what a discretisation makes wrong. Collective.
///
/// # Errors
/// Where the exact solution is not finite.
fn exact_density(group: &Group, case: &Case, exact: &Exact) -> Result<Vec<f64>> {
    if let Some(moments) = group.agree(exact_moments(case))? {
        return Ok(moments.density);
    }
    let n = case.space.dimension() as u32;
    let fits = |&parts: &usize| case.space.cells().saturating_mul(parts.pow(2 * n)) <= MOST_POINTS;
    let parts = (1..=MOST_PARTS).rev().find(fits).unwrap_or(1);
    let mut fine = case.clone();
    for axis in fine.space.x.iter_mut().chain(&mut fine.space.v) {
        axis.cells *= parts;
    }
    let tracer = match exact {
        Exact::Characteristics => Some(Tracer::new(&fine)),
        Exact::Formula(_) => None,
    };
    let tracer = group.agree(tracer.transpose())?;
    let value = |point: &[f64; 6]| match (&tracer, exact) {
        (Some(tracer), _) => tracer.value(point, case.end),
        (None, Exact::Formula(f)) => {
            let [x, y, z, vx, vy, vz] = *point;
            f.eval(&[x, y, z, vx, vy, vz, case.end])
        }
        (None, Exact::Characteristics) => f64::NAN,
    };
    let points = fine.space.space_cells();
    let mine = split(&(0..points), group.size(), group.rank());
    let velocities = fine.space.velocity_cells();
    let mut failure = None;
    let mut density = vec![0.0; points];
    for point in mine {
        for cell in point * velocities..(point + 1) * velocities {
            let at = fine.space.point(&fine.space.cell(cell));
            let f = value(&at);
            if !f.is_finite() && failure.is_none() {
                let place = crate::problem::grid::describe_point(n as usize, &at);
                let formula = match exact {
                    Exact::Formula(formula) => formula,
                    Exact::Characteristics => &case.fields[0].initial,
                };
                failure = Some(formula.undefined(f, place));
            }
            density[point] += f * fine.space.velocity_volume();
        }
    }
    group.agree(failure.map_or(Ok(()), Err))?;
    let mut bits: Vec<i64> = density.iter().map(|rho| rho.to_bits() as i64).collect();
    group.sum_integers(&mut bits);
    let density: Vec<f64> = bits.into_iter().map(|b| f64::from_bits(b as u64)).collect();
    let cells = |space: &PhaseSpace| space.x.iter().map(|a| a.cells).collect::<Vec<_>>();
    Ok(averaged(&density, &cells(&fine.space), &cells(&case.space)))
}
