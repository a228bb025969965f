//! Runs on trial grids, each done once, and their densities' errors.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::problem::case::{Case, Exact, Limiter};
use crate::problem::grid::averaged;
use crate::problem::grid::{Axis, Part};
use crate::run::exact::velocities::first_points;
use crate::scheme::reduce::reduced;
use crate::study::advise::density::{density_of, distance, exact_density, spread};
use crate::study::advise::scheme::Scheme;
use crate::study::budget::Budget;
use crate::study::cost::{CostModel, Seconds, planned_updates, planned_work};
use crate::study::grids::{Grids, of_degree};
use crate::study::trial::trial;
use std::collections::BTreeMap;

/// An application of a mode counts as so much of an update: eight modes go through memory together.
pub const MODE: f64 = 0.25;
/// Points of an element's rule along an axis, more than nodes, at which exact values are taken.
const MORE_POINTS: usize = 4;
/// Assembling a matrix and what else a run begins and ends with count as so many updates a cell.
const PREPARING: f64 = 80.0;
/// An exact value counts as so many updates: particles are traced back over slopes and jumps.
const EXACT_VALUE: f64 = 200.0;

/// The result of a trial.
pub struct Found {
    /// The density on all of space, averaged over equal cells: as many as unknowns.
    pub density: Vec<f64>,
    /// Of elements its relative L1 error, by integrals over them, where an exact solution is known.
    error: Option<f64>,
    /// Seconds it took, the longest of the ranks.
    pub seconds: f64,
    /// See [`spread`].
    pub spread: f64,
}

/// The case with elements of one degree.
pub struct Scene {
    /// By Schrödingerization as it is planned, with no output but the fields at its end.
    pub plain: Case,
    /// Grids over its box.
    pub grids: Grids,
}

/// All trials of a case.
pub struct Trials<'a> {
    world: &'a World,
    /// By degree; that of the case's own degree is the case.
    scenes: BTreeMap<usize, Scene>,
    own_degree: usize,
    exact: Option<Exact>,
    /// The axes of the `2n` that runs merge to one cell.
    merged: Vec<bool>,
    /// The time of the study, counted in updates so that the same is tried on every machine and on
    /// any ranks.
    pub budget: Budget,
    cost: CostModel,
    done: BTreeMap<(Scheme, Vec<usize>), Found>,
    exact_densities: BTreeMap<Vec<usize>, Vec<f64>>,
}

impl<'a> Trials<'a> {
    /// Of `plain`, compared with `exact`, for about so many seconds. Collective.
    ///
    /// # Errors
    /// As [`reduced`].
    pub fn new(world: &'a World, plain: Case, exact: Option<Exact>, seconds: f64) -> Result<Self> {
        let budget = Budget::new(world, seconds);
        let needed = reduced(&world.group(), &plain)?;
        let is_merged = |axis: &Axis| matches!(axis.part, Part::Merged { .. });
        let merged: Vec<bool> = needed.space.axes().map(is_merged).collect();
        let own_degree = plain.space.degree();
        let grids = Grids::new(&plain).with_merged(merged.clone());
        Ok(Self {
            world,
            scenes: BTreeMap::from([(own_degree, Scene { plain, grids })]),
            own_degree,
            exact,
            merged,
            budget,
            cost: CostModel::default(),
            done: BTreeMap::new(),
            exact_densities: BTreeMap::new(),
        })
    }

    /// Prepares elements of `degree`.
    ///
    /// # Errors
    /// As [`of_degree`].
    pub fn prepare(&mut self, degree: usize) -> Result<()> {
        if !self.scenes.contains_key(&degree) {
            let plain = of_degree(self.plain(), degree, &self.merged)?;
            let grids = Grids::new(&plain).with_merged(self.merged.clone());
            self.scenes.insert(degree, Scene { plain, grids });
        }
        Ok(())
    }

    /// Whether elements of `degree` were prepared.
    pub fn is_prepared(&self, degree: usize) -> bool {
        self.scenes.contains_key(&degree)
    }

    /// The case as its file has it, by Schrödingerization as it is planned.
    pub fn plain(&self) -> &Case {
        &self.scenes[&self.own_degree].plain
    }

    /// The case with elements of the degree of `scheme`, which was prepared.
    pub fn scene(&self, scheme: Scheme) -> &Scene {
        &self.scenes[&scheme.degree]
    }

    /// `case` as its runs merge it: explicit steps keep the grid.
    pub fn merged(&self, case: &Case) -> Case {
        let mut case = case.clone();
        if case.limiter == Limiter::None {
            let space = &mut case.space;
            let axes = space.x.iter_mut().chain(&mut space.v);
            for (axis, merged) in axes.zip(&self.merged) {
                if *merged && axis.cells > 1 {
                    *axis = axis.merged();
                }
            }
        }
        case
    }

    /// Whether there is an exact solution.
    pub fn has_exact(&self) -> bool {
        self.exact.is_some()
    }

    /// Updates that `scheme` on `shape` counts as; infinitely many for a grid so large that one of
    /// each of its cells is beyond the budget.
    fn updates(&mut self, scheme: Scheme, shape: &[usize]) -> Result<f64> {
        let case = self.merged(&scheme.classical(&self.scene(scheme).plain, shape));
        let cells = all_cells(&case);
        match self.budget.holds(cells, 1.0) {
            true => Ok((self.cost.work(&case)? + PREPARING) * cells),
            false => Ok(f64::INFINITY),
        }
    }

    /// Updates that comparing a density on `shape` with the exact one counts as. Of degree 0 the
    /// exact density is computed once a grid; of elements with each trial, at more points than
    /// nodes.
    fn updates_to_compare(&self, scheme: Scheme, shape: &[usize]) -> f64 {
        if self.exact.is_none() {
            return 0.0;
        }
        if scheme.degree == 0 {
            return match self.exact_densities.contains_key(shape) {
                true => 0.0,
                false => {
                    let case = scheme.schrodingerized(&self.scene(scheme).plain, shape);
                    EXACT_VALUE * first_points(&case)
                }
            };
        }
        if self.has_run(scheme, shape) {
            return 0.0;
        }
        let points = (scheme.degree + 1 + MORE_POINTS) as f64;
        EXACT_VALUE * cells(shape) * points.powi(shape.len() as i32)
    }

    /// Whether a run of `scheme` on `shape` counts as no more than this part of the budget.
    ///
    /// # Errors
    /// As [`CostModel::work`].
    pub fn is_cheap(&mut self, scheme: Scheme, shape: &[usize], part: f64) -> Result<bool> {
        let updates = self.updates(scheme, shape)? + self.updates_to_compare(scheme, shape);
        Ok(self.budget.holds(updates, part))
    }

    /// Whether `scheme` on `shape` was tried, or may be with this part of the budget. Collective.
    ///
    /// # Errors
    /// As [`CostModel::work`].
    pub fn may(&mut self, scheme: Scheme, shape: &[usize], part: f64) -> Result<bool> {
        let mut updates = self.updates_to_compare(scheme, shape);
        if self.has_run(scheme, shape) {
            return Ok(updates == 0.0 || self.budget.allows(updates, part));
        }
        updates += self.updates(scheme, shape)?;
        Ok(self.budget.allows(updates, part))
    }

    /// Whether `scheme` on `shape` was tried.
    pub fn has_run(&self, scheme: Scheme, shape: &[usize]) -> bool {
        self.done.contains_key(&(scheme, shape.to_vec()))
    }

    /// Tries `scheme` on `shape` classically, if it was not. Collective.
    ///
    /// # Errors
    /// As [`Trials::measure`].
    pub fn run(&mut self, scheme: Scheme, shape: &[usize]) -> Result<&Found> {
        let key = (scheme, shape.to_vec());
        if !self.done.contains_key(&key) {
            let case = scheme.classical(&self.scene(scheme).plain, shape);
            let merged = self.merged(&case);
            let mut updates = (self.cost.work(&merged)? + PREPARING) * all_cells(&merged);
            if scheme.degree > 0 {
                updates += self.updates_to_compare(scheme, shape);
            }
            let found = self.measure(&case, updates)?;
            self.done.insert(key.clone(), found);
        }
        Ok(&self.done[&key])
    }

    /// Runs `case`, which counts as so many updates. Collective.
    ///
    /// # Errors
    /// As [`trial`] and [`density_of`].
    pub fn measure(&mut self, case: &Case, updates: f64) -> Result<Found> {
        self.budget.count(updates);
        let exact = self.exact.clone().filter(|_| case.space.degree() > 0);
        let found = trial(self.world, &Case { exact, ..case.clone() })?;
        let group = self.world.group();
        let density = density_of(&group, &case.space, &found)?;
        let [result, solve] = [found.seconds, found.summary.solve_seconds].map(|s| group.max(s));
        let seconds = Seconds { result, solve, total: result };
        self.cost.learn(&self.merged(case), &found.plan, seconds);
        let spread = spread(&group, &case.space, &found, &density);
        let error = found.summary.error_density_l1_relative;
        Ok(Found { density, error, seconds: result, spread })
    }

    /// Seconds that a run of `case` as `plan` has it is expected to take, by the trials so far.
    pub fn seconds(&self, case: &Case, plan: &Plan) -> f64 {
        let merged = self.merged(case);
        self.cost.seconds(&merged, planned_work(&merged, plan))
    }

    /// The relative L1 error of the density of `scheme` on `shape`; `None` where no exact solution
    /// is known. Collective.
    ///
    /// # Errors
    /// As [`Trials::run`] and [`exact_density`].
    pub fn error(&mut self, scheme: Scheme, shape: &[usize]) -> Result<Option<f64>> {
        let found = self.run(scheme, shape)?;
        if scheme.degree > 0 {
            return Ok(found.error);
        }
        let density = found.density.clone();
        self.error_of_cells(scheme, &density, shape)
    }

    /// As [`error`](Self::error), of what was found on `shape`. Collective.
    ///
    /// # Errors
    /// As [`exact_density`].
    pub fn error_of(
        &mut self,
        scheme: Scheme,
        found: &Found,
        shape: &[usize],
    ) -> Result<Option<f64>> {
        match scheme.degree {
            0 => self.error_of_cells(scheme, &found.density, shape),
            _ => Ok(found.error),
        }
    }

    /// The error of a density of degree 0. Collective.
    fn error_of_cells(
        &mut self,
        scheme: Scheme,
        density: &[f64],
        shape: &[usize],
    ) -> Result<Option<f64>> {
        let Some(exact) = &self.exact else {
            return Ok(None);
        };
        if !self.exact_densities.contains_key(shape) {
            let case = scheme.schrodingerized(&self.scene(scheme).plain, shape);
            self.budget.count(self.updates_to_compare(scheme, shape));
            let found = exact_density(self.budget.group(), &case, exact)?;
            self.exact_densities.insert(shape.to_vec(), found);
        }
        Ok(Some(distance(density, &self.exact_densities[shape])))
    }

    /// The relative L1 distance of the densities of `scheme` on two grids, the second one finer.
    /// Collective.
    ///
    /// # Errors
    /// As [`Trials::run`].
    pub fn distance(&mut self, scheme: Scheme, coarse: &[usize], fine: &[usize]) -> Result<f64> {
        let space = &self.scene(scheme).plain.space;
        let cells = |shape: &[usize]| -> Vec<usize> {
            space.x.iter().zip(shape).map(|(axis, n)| n * axis.nodes.count()).collect()
        };
        let (few, many) = (cells(coarse), cells(fine));
        let finer = averaged(&self.run(scheme, fine)?.density, &many, &few);
        Ok(distance(&self.run(scheme, coarse)?.density, &finer))
    }
}

/// Updates that a run of `case` by modes counts as.
pub fn mode_updates(case: &Case, plan: &Plan) -> f64 {
    MODE * planned_updates(case, plan)
}

/// The product of `shape`; more than an integer holds, maybe.
pub fn cells(shape: &[usize]) -> f64 {
    shape.iter().map(|&n| n as f64).product()
}

fn all_cells(case: &Case) -> f64 {
    cells(&case.space.shape())
}
