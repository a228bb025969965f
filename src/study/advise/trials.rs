//! Runs on trial grids, each done once, and the errors of their densities.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::problem::case::{AllowedReductions, Case, Exact, Limiter, Method};
use crate::problem::exact::{CellLimits, Tracer, traced_cells_of_axis};
use crate::problem::grid::{Axis, AxisPart, averaged};
use crate::run::errors::exact_points;
use crate::run::exact::velocities::limits::expected_points_of_averages;
use crate::scheme::reduce::reduced;
use crate::study::advise::scheme::SchemeChoice;
use crate::study::budget::Budget;
use crate::study::cost::{CostModel, TrialSeconds, planned_updates, planned_work};
use crate::study::density::{density_of, distance, exact_density, spread};
use crate::study::grids::{Grids, cells, of_degree};
use crate::study::trial::{seconds_of_result, trial};
use std::collections::BTreeMap;

/// Updates that an application to an unknown of one mode counts as: eight modes pass through memory
/// together.
pub const UPDATES_PER_MODE: f64 = 0.25;
/// Updates a cell that all work of a run but its steps counts as, such as assembling `A`.
const UPDATES_TO_PREPARE: f64 = 80.0;
/// Updates a cell that the search for velocities that nothing reaches counts as.
const UPDATES_TO_REDUCE: f64 = 8.0;
/// Part of the budget that this search may take.
const FOR_REDUCTION: f64 = 0.25;
/// Updates that an exact value counts as: its formula, and each step of a path on which a particle
/// is traced back. A step takes 40 ns, an update at most 8 ns.
const UPDATES_PER_FORMULA: f64 = 8.0;
const UPDATES_PER_STEP: f64 = 5.0;
/// Cells for each node of an element over which densities are averaged to be compared.
pub const CELLS_PER_NODE: usize = 2;
/// Part of the budget that the integrals of the exact solution may take in a trial.
const FOR_EXACT: f64 = 0.25;

/// A trial: its scheme and its elements along each axis.
type TrialGrid = (SchemeChoice, Vec<usize>);

/// The result of a trial.
#[derive(Clone)]
pub struct TrialResult {
    /// The density on all of space, averaged over equal cells: along axes of a degree above 0,
    /// [`CELLS_PER_NODE`] for each node, as what an element misses between its nodes is an error,
    /// too.
    pub density: Vec<f64>,
    /// Relative L1 error by quadrature in the elements, with degree 1 and more, if an exact
    /// solution is known.
    error: Option<f64>,
    /// Seconds on the slowest rank.
    pub seconds: f64,
    /// The factor that [`spread`] gives.
    pub spread: f64,
}

/// The case with elements of one degree.
pub struct DegreeCase {
    /// The base of its trials: Schrödingerized, everything planned, no output but the final fields.
    pub base: Case,
    /// Grids over its box.
    pub grids: Grids,
    /// The paths of exact values, if these are not given by a formula.
    paths: Option<ExactPaths>,
}

/// The paths on which exact values are traced back, on the case's own grid.
#[derive(Clone, Copy)]
struct ExactPaths {
    /// Mean number of their steps.
    steps: f64,
    /// Whether `V` is approximated, so that a step is a cell of the tracer.
    is_approximate: bool,
}

impl DegreeCase {
    /// The case `base` with elements of one degree, whose runs merge the axes marked in `merged`.
    ///
    /// # Errors
    /// As [`ExactPaths::of`].
    fn new(base: Case, merged: &[bool], exact: Option<&Exact>) -> Result<Self> {
        let grids = Grids::new(&base).with_merged(merged.to_vec());
        let is_traced = matches!(exact, Some(Exact::Characteristics));
        let paths = is_traced.then(|| ExactPaths::of(&base)).transpose()?;
        Ok(Self { base, grids, paths })
    }

    /// Updates that an exact value counts as on the grid of `case`.
    fn updates_per_exact_value(&self, case: &Case) -> f64 {
        let Some(ExactPaths { steps, is_approximate }) = self.paths else {
            return UPDATES_PER_FORMULA;
        };
        let finer = if is_approximate {
            traced_cells_of_axis(case, CellLimits::EXACT)
                / traced_cells_of_axis(&self.base, CellLimits::ESTIMATES)
        } else {
            1.0
        };
        UPDATES_PER_FORMULA + UPDATES_PER_STEP * finer * steps
    }
}

impl ExactPaths {
    /// The paths of exact values of `case`.
    ///
    /// # Errors
    /// As [`Tracer::with_cells`].
    fn of(case: &Case) -> Result<Self> {
        let tracer = Tracer::with_cells(case, CellLimits::ESTIMATES)?;
        let steps = tracer.mean_steps(case.end);
        Ok(Self { steps, is_approximate: tracer.is_approximate })
    }
}

/// All trials of a case.
pub struct Trials<'a> {
    world: &'a World,
    /// The case with elements of each degree, by degree.
    degree_cases: BTreeMap<usize, DegreeCase>,
    own_degree: usize,
    exact: Option<Exact>,
    /// One flag for each of the `2n` axes: whether runs merge it to one cell.
    merged: Vec<bool>,
    /// The time of the study. It is counted in updates, so that every machine and any number of
    /// ranks makes the same trials.
    pub budget: Budget,
    cost: CostModel,
    done: BTreeMap<TrialGrid, TrialResult>,
    /// Trials by modes, by the bits of their tolerance too.
    by_modes: BTreeMap<(SchemeChoice, Vec<usize>, u64), TrialResult>,
    exact_densities: BTreeMap<Vec<usize>, Vec<f64>>,
}

impl<'a> Trials<'a> {
    /// No trials yet. `base` is the base case. Collective.
    ///
    /// # Errors
    /// As [`reduced`] and [`DegreeCase::new`].
    pub fn new(
        world: &'a World,
        base: Case,
        exact: Option<Exact>,
        mut budget: Budget,
    ) -> Result<Self> {
        let updates = UPDATES_TO_REDUCE * base.space.cells() as f64;
        let has_time = budget.fits_count(updates, FOR_REDUCTION);
        if has_time {
            budget.count(updates);
        }
        // Without the search an axis may be refined along which nothing moves, which costs time.
        let reduce =
            AllowedReductions { velocities: base.reduce.velocities && has_time, ..base.reduce };
        let needed = reduced(&world.group(), &Case { reduce, ..base.clone() })?;
        let is_merged = |axis: &Axis| matches!(axis.part, AxisPart::Merged { .. });
        let merged: Vec<bool> = needed.space.axes().map(is_merged).collect();
        let own_degree = base.space.degree();
        let own = DegreeCase::new(base, &merged, exact.as_ref())?;
        Ok(Self {
            world,
            degree_cases: BTreeMap::from([(own_degree, own)]),
            own_degree,
            exact,
            merged,
            budget,
            cost: CostModel::default(),
            done: BTreeMap::new(),
            by_modes: BTreeMap::new(),
            exact_densities: BTreeMap::new(),
        })
    }

    /// Prepares elements of `degree`.
    ///
    /// # Errors
    /// As [`of_degree`] and [`DegreeCase::new`].
    pub fn prepare(&mut self, degree: usize) -> Result<()> {
        if !self.degree_cases.contains_key(&degree) {
            let base = of_degree(self.base(), degree, &self.merged)?;
            let of_degree = DegreeCase::new(base, &self.merged, self.exact.as_ref())?;
            self.degree_cases.insert(degree, of_degree);
        }
        Ok(())
    }

    /// Whether elements of `degree` were prepared.
    pub fn is_prepared(&self, degree: usize) -> bool {
        self.degree_cases.contains_key(&degree)
    }

    /// The base case of the case's own degree.
    pub fn base(&self) -> &Case {
        &self.degree_cases[&self.own_degree].base
    }

    /// The case with elements of the degree of `scheme`, which was prepared.
    pub fn degree_case(&self, scheme: SchemeChoice) -> &DegreeCase {
        &self.degree_cases[&scheme.degree]
    }

    /// `case` with the axes that its runs merge; runs with slopes merge none.
    pub fn merged(&self, case: &Case) -> Case {
        let mut case = case.clone();
        if case.scheme.limiter == Limiter::None {
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

    /// Updates that a classical run of `scheme` on `shape` counts as; infinite for a grid with more
    /// cells than the budget has updates.
    fn updates(&mut self, scheme: SchemeChoice, shape: &[usize]) -> Result<f64> {
        let case = self.merged(&scheme.classical(&self.degree_case(scheme).base, shape));
        if self.budget.fits_count(cells(&case.space.shape()), 1.0) {
            self.updates_of_run(&case)
        } else {
            Ok(f64::INFINITY)
        }
    }

    /// Updates that a run of `case`, whose axes are merged, counts as.
    fn updates_of_run(&mut self, case: &Case) -> Result<f64> {
        Ok((self.cost.work(case)? + UPDATES_TO_PREPARE) * cells(&case.space.shape()))
    }

    /// Updates that a trial of `scheme` on `shape` counts as, with its comparison.
    ///
    /// # Errors
    /// As [`CostModel::work`].
    pub fn updates_to_try(&mut self, scheme: SchemeChoice, shape: &[usize]) -> Result<f64> {
        Ok(self.updates(scheme, shape)? + self.updates_to_compare(scheme, shape))
    }

    /// Updates that a comparison with the exact density on `shape` counts as. For degree 0 the
    /// exact density is computed once a grid; for higher degrees with each trial, at more points
    /// than nodes.
    fn updates_to_compare(&self, scheme: SchemeChoice, shape: &[usize]) -> f64 {
        let known = match scheme.degree {
            0 => self.exact_densities.contains_key(shape),
            _ => self.has_run(scheme, shape),
        };
        if known || self.exact.is_none() {
            return 0.0;
        }
        let of_degree = self.degree_case(scheme);
        let case = scheme.schrodingerized(&of_degree.base, shape);
        let points = match scheme.degree {
            0 => expected_points_of_averages(&self.merged(&case)),
            // Errors are integrated over the whole grid.
            _ => cells(&case.space.shape()) + exact_points(&case),
        };
        of_degree.updates_per_exact_value(&case) * points
    }

    /// Points that integrals of the exact solution may take in a trial of `scheme`, the run `case`.
    fn most_exact_points(&self, scheme: SchemeChoice, case: &Case) -> usize {
        let each = self.degree_case(scheme).updates_per_exact_value(case);
        (self.budget.updates(FOR_EXACT) / each) as usize
    }

    /// Whether a run of `scheme` on `shape` counts as no more than this part of the budget.
    ///
    /// # Errors
    /// As [`CostModel::work`].
    pub fn is_cheap(&mut self, scheme: SchemeChoice, shape: &[usize], part: f64) -> Result<bool> {
        let updates = self.updates_to_try(scheme, shape)?;
        Ok(self.budget.fits_count(updates, part))
    }

    /// Whether `scheme` on `shape` was tried, or may be with this part of the budget. Collective.
    ///
    /// # Errors
    /// As [`CostModel::work`].
    pub fn affords(&mut self, scheme: SchemeChoice, shape: &[usize], part: f64) -> Result<bool> {
        if self.has_run(scheme, shape) {
            let updates = self.updates_to_compare(scheme, shape);
            return Ok(updates == 0.0 || self.budget.fits(updates, part));
        }
        let updates = self.updates_to_try(scheme, shape)?;
        Ok(self.budget.fits(updates, part))
    }

    /// Whether `scheme` on `shape` was tried.
    pub fn has_run(&self, scheme: SchemeChoice, shape: &[usize]) -> bool {
        self.done.contains_key(&(scheme, shape.to_vec()))
    }

    /// Tries `scheme` on `shape` classically, if it was not. Collective.
    ///
    /// # Errors
    /// As [`Trials::measure`].
    pub fn run(&mut self, scheme: SchemeChoice, shape: &[usize]) -> Result<&TrialResult> {
        let key = (scheme, shape.to_vec());
        if !self.done.contains_key(&key) {
            let mut case = scheme.classical(&self.degree_case(scheme).base, shape);
            let mut updates = self.updates_of_run(&self.merged(&case))?;
            if scheme.degree > 0 {
                updates += self.updates_to_compare(scheme, shape);
            }
            case.study.most_exact_points = Some(self.most_exact_points(scheme, &case));
            let found = self.measure(&case, updates)?;
            self.done.insert(key.clone(), found);
        }
        Ok(&self.done[&key])
    }

    /// Runs `case`, which counts as this many `updates`. Only classical runs are compared with the
    /// exact solution: a run by modes is compared with the classical one. Collective.
    ///
    /// # Errors
    /// As [`trial`] and [`density_of`].
    pub fn measure(&mut self, case: &Case, updates: f64) -> Result<TrialResult> {
        self.budget.count(updates);
        let compared = case.method == Method::Classical && case.space.degree() > 0;
        let exact = self.exact.clone().filter(|_| compared);
        let found = trial(self.world, &Case { exact, ..case.clone() })?;
        let group = self.world.group();
        let density = density_of(&group, &case.space, &found, CELLS_PER_NODE)?;
        let mine = [seconds_of_result(&found.summary), found.summary.solve_seconds];
        let [result, solve] = mine.map(|seconds| group.max(seconds));
        let seconds = TrialSeconds { result, solve, total: result };
        self.cost.learn(&self.merged(case), &found.plan, seconds);
        let spread = spread(&group, &case.space, &found, &density);
        let error = found.summary.error_density_l1_relative;
        Ok(TrialResult { density, error, seconds: result, spread })
    }

    /// Tries `target`, which is `scheme` on `shape` by modes, and counts as this many `updates`, if
    /// it was not tried. `None` if the budget does not hold it up to its part `share`. Collective.
    ///
    /// # Errors
    /// As [`Trials::measure`].
    pub fn run_by_modes(
        &mut self,
        scheme: SchemeChoice,
        target: &Case,
        updates: f64,
        share: f64,
    ) -> Result<Option<TrialResult>> {
        let key = (scheme, target.space.elements(), target.tolerance.to_bits());
        if let Some(known) = self.by_modes.get(&key) {
            return Ok(Some(known.clone()));
        }
        if !self.budget.fits(updates, share) {
            return Ok(None);
        }
        let found = self.measure(target, updates)?;
        self.by_modes.insert(key, found.clone());
        Ok(Some(found))
    }

    /// Predicted seconds of a run of `case` by `plan`, from the trials so far.
    pub fn seconds(&self, case: &Case, plan: &Plan) -> f64 {
        let merged = self.merged(case);
        self.cost.seconds(&merged, planned_work(&merged, plan))
    }

    /// The relative L1 error of the density of `scheme` on `shape`; `None` where no exact solution
    /// is known. Collective.
    ///
    /// # Errors
    /// As [`Trials::run`] and [`exact_density`].
    pub fn error(&mut self, scheme: SchemeChoice, shape: &[usize]) -> Result<Option<f64>> {
        let found = self.run(scheme, shape)?.clone();
        if scheme.degree > 0 {
            return Ok(found.error);
        }
        let Some(exact) = &self.exact else { return Ok(None) };
        if !self.exact_densities.contains_key(shape) {
            let mut case = scheme.schrodingerized(&self.degree_case(scheme).base, shape);
            self.budget.count(self.updates_to_compare(scheme, shape));
            case.study.most_exact_points = Some(self.most_exact_points(scheme, &case));
            let density = exact_density(self.budget.group(), &case, exact)?;
            self.exact_densities.insert(shape.to_vec(), density);
        }
        Ok(Some(distance(&found.density, &self.exact_densities[shape])))
    }

    /// The relative L1 distance of the densities of `scheme` on two grids, the second one finer.
    /// Collective.
    ///
    /// # Errors
    /// As [`Trials::run`].
    pub fn distance(
        &mut self,
        scheme: SchemeChoice,
        coarse: &[usize],
        fine: &[usize],
    ) -> Result<f64> {
        for shape in [coarse, fine] {
            self.run(scheme, shape)?;
        }
        Ok(self.distance_of(&(scheme, coarse.to_vec()), &(scheme, fine.to_vec())))
    }

    /// The relative L1 distance of the density of `scheme` on `shape` to that of the finest trial
    /// of this scheme with any flux, or of a higher degree. `None` if none is finer along all axes,
    /// or if this one was not made.
    pub fn distance_to_finest(&self, scheme: SchemeChoice, shape: &[usize]) -> Option<f64> {
        let this = (scheme, shape.to_vec());
        if !self.done.contains_key(&this) {
            return None;
        }
        let nodes = self.nodes(&this);
        let finer = |other: &&TrialGrid| {
            let of_scheme = SchemeChoice { flux: scheme.flux, ..other.0 } == scheme;
            let others = self.nodes(other);
            (of_scheme || other.0.degree > scheme.degree)
                && others != nodes
                && others.iter().zip(&nodes).all(|(others, nodes)| others >= nodes)
        };
        let size = |other: &&TrialGrid| self.nodes(other).into_iter().product::<usize>();
        let finest = self.done.keys().filter(finer).max_by_key(size)?;
        Some(self.distance_of(&this, finest))
    }

    /// The numbers of nodes along each axis.
    fn nodes(&self, (scheme, shape): &TrialGrid) -> Vec<usize> {
        let axes = self.degree_case(*scheme).base.space.axes();
        axes.zip(shape).map(|(axis, elements)| elements * axis.nodes.count()).collect()
    }

    /// The distance of the densities of two trials that were made.
    fn distance_of(&self, coarse: &TrialGrid, fine: &TrialGrid) -> f64 {
        let cells = |trial: &TrialGrid| -> Vec<usize> {
            let axes = self.degree_case(trial.0).base.space.x.iter().zip(self.nodes(trial));
            let of_node = |axis: &Axis| if axis.nodes.degree > 0 { CELLS_PER_NODE } else { 1 };
            axes.map(|(axis, nodes)| of_node(axis) * nodes).collect()
        };
        let finer = averaged(&self.done[fine].density, &cells(fine), &cells(coarse));
        distance(&self.done[coarse].density, &finer)
    }
}

/// Updates that a run of `case` by modes counts as.
pub fn mode_updates(case: &Case, plan: &Plan) -> f64 {
    UPDATES_PER_MODE * planned_updates(case, plan)
}
