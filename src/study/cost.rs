//! The work of runs, and a model of the seconds that they take.
//!
//! Work is counted in applications of the matrix over all modes and fields: a linear solve or a
//! step with slopes counts as several. With the cells of the grid,
//!
//! ```text
//! seconds = a + b · cells + rate · work · cells
//! ```
//!
//! The rate of a kind of work is that of the longest trial of it so far. The overhead
//! `a + b · cells` (matrix, weights, plan, comparisons) follows from the quickest trials of the
//! coarsest and of the finest grid.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::plan::{ASSUMED_RATIO, Plan};
use crate::problem::case::{Case, Limiter, Method};
use crate::propagate::classical::classical_steps;
use crate::propagate::descriptor;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::study::choices::row_choices;
use std::collections::BTreeMap;

/// Seconds a cell of an application before anything is measured, on a slow machine.
const RATE: f64 = 5e-9;
/// Seconds a cell of the overhead, before anything is measured.
const OVERHEAD: f64 = 3e-6;
/// Factor on a rate from a smaller grid, for vectors that may no longer fit into the cache.
const OUT_OF_CACHE: f64 = 2.0;
/// Seconds of a trial that may be start-up, while only one grid was tried.
const START_UP: f64 = 0.2;
/// Applications that a step with slopes counts as, per stage.
const SLOPES: f64 = 8.0;
/// The degree of elements whose unknowns take twice the time of those of degree 0: where a force
/// acts, as `make bench` measures it. Without a force it is above 8.
const TWICE: f64 = 6.0;

/// Cost per unknown of an application with elements of `degree`, relative to degree 0. With slopes
/// it is the cost of a stage of a step.
pub fn application_weight(degree: usize, limiter: Limiter) -> f64 {
    if limiter == Limiter::None { 1.0 + degree as f64 / TWICE } else { SLOPES }
}

/// Cost of a unit of the work of `case`, in applications of degree 0.
fn unit_weight(case: &Case) -> f64 {
    let applications = WorkKind::of(case).applications as f64;
    application_weight(case.space.degree(), case.scheme.limiter) * applications
}

/// Work of which each unit takes about the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct WorkKind {
    by_modes: bool,
    /// Degree of the elements.
    degree: usize,
    /// Whether a unit is a stage with slopes.
    slopes: bool,
    /// Applications that a unit has.
    applications: usize,
    /// Whether a unit solves a linear system with sparse factors.
    solves: bool,
}

impl WorkKind {
    fn of(case: &Case) -> Self {
        let by_modes = case.method == Method::Schrodingerized;
        let method = descriptor(case.propagator.method);
        Self {
            by_modes,
            degree: case.space.degree(),
            slopes: case.scheme.limiter != Limiter::None,
            applications: if by_modes { method.applications_per_work() } else { 1 },
            solves: by_modes && case.propagator.method.order() > 0,
        }
    }

    /// Growth of a unit's time per cell with the number of cells, relative to a small grid. It is
    /// that of sparse factors.
    fn growth(self, cells: f64) -> f64 {
        if self.solves { (cells / 1024.0).sqrt() } else { 1.0 }
    }
}

/// Work of a classical run of `case`, whose matrix has these `bounds`.
fn classical_work(case: &Case, bounds: &Bounds) -> f64 {
    let steps: usize = classical_steps(case, bounds).iter().sum();
    let stages = case.classical.integrator.stages();
    unit_weight(case) * (stages * steps * case.fields.len()) as f64
}

/// Work of a run of `case` as `plan` has it.
pub fn planned_work(case: &Case, plan: &Plan) -> f64 {
    match &plan.warp {
        Some(warp) => unit_weight(case) * (warp.applications + warp.solves) as f64,
        None => classical_work(case, &plan.bounds),
    }
}

/// Updates of unknowns of a run of `case` as `plan` has it: what a
/// [`Budget`](crate::study::budget::Budget) counts.
pub fn planned_updates(case: &Case, plan: &Plan) -> f64 {
    planned_work(case, plan) * plan.cells as f64
}

/// The grid of a case with a given potential, and the choices that determine what is kept by this
/// key.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct GridKey {
    shape: Vec<usize>,
    /// The choices, in words.
    pub choices: String,
}

impl GridKey {
    /// The grid of `case` and these choices.
    pub fn new(case: &Case, choices: String) -> Self {
        Self { shape: case.space.shape(), choices }
    }

    /// The key of the matrix: rows, weights and embedding.
    fn of_matrix(case: &Case) -> Self {
        let warp = &case.warp;
        let embedding = (warp.weights, warp.inflow, warp.delta);
        Self::new(case, format!("{} {embedding:?} {:?}", row_choices(case), warp.shift))
    }

    /// Number of cells of the grid.
    pub fn cells(&self) -> usize {
        self.shape.iter().product()
    }
}

/// The properties of a case that the seconds of its comparisons and preparation depend on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct OverheadKey {
    by_modes: bool,
    verified: bool,
}

impl OverheadKey {
    fn of(case: &Case) -> Self {
        Self { by_modes: case.method == Method::Schrodingerized, verified: case.verify }
    }
}

/// A measured rate, and the size of the trial that it is from.
#[derive(Clone, Copy, Debug)]
struct MeasuredRate {
    /// Seconds per application and cell.
    seconds_per_cell: f64,
    cells: f64,
    seconds: f64,
}

/// Seconds of a trial.
#[derive(Clone, Copy, Debug)]
pub struct TrialSeconds {
    /// Seconds without comparisons with other results.
    pub result: f64,
    /// Seconds of the solution alone.
    pub solve: f64,
    /// Seconds of the whole trial.
    pub total: f64,
}

/// Bounds of a case's matrix, and how far norms fall.
#[derive(Clone, Debug)]
struct NormBounds {
    bounds: Bounds,
    /// `‖ũ(0)‖/‖f(t)‖`.
    ratio: f64,
}

/// A model of the seconds of runs of a case, learnt from its trials.
#[derive(Debug, Default)]
pub struct CostModel {
    rates: BTreeMap<WorkKind, MeasuredRate>,
    /// Least seconds of the overhead, by number of cells.
    overheads: BTreeMap<OverheadKey, BTreeMap<usize, f64>>,
    /// Bounds without a measurement; the flag tells runs by modes from classical ones.
    unmeasured: BTreeMap<(GridKey, bool), Bounds>,
    measured: BTreeMap<GridKey, NormBounds>,
}

impl CostModel {
    /// Predicts the work of `case`, from a plan of some of its modes.
    ///
    /// # Errors
    /// As [`WarpPlan::forecast`], where it cannot be planned.
    pub fn work(&mut self, case: &Case) -> Result<f64> {
        match case.method {
            Method::Schrodingerized => {
                let NormBounds { bounds, ratio } = self.bounds(case)?;
                Ok(unit_weight(case) * WarpPlan::forecast(case, &bounds, ratio)?)
            }
            Method::Classical => Ok(classical_work(case, &self.unmeasured(case)?)),
        }
    }

    /// Bounds and the ratio of norms of the case's matrix: as measured; or with the growth measured
    /// on the nearest grid, in proportion to the cells along an axis.
    fn bounds(&mut self, case: &Case) -> Result<NormBounds> {
        let own = GridKey::of_matrix(case);
        if let Some(known) = self.measured.get(&own) {
            return Ok(known.clone());
        }
        let found = self.unmeasured(case)?;
        let cells = own.cells();
        let nearest = (self.measured.iter())
            .filter(|(key, _)| key.choices == own.choices)
            .min_by_key(|(key, _)| key.cells().abs_diff(cells));
        let Some((key, NormBounds { bounds: known, ratio })) = nearest else {
            return Ok(NormBounds { bounds: found.expected(), ratio: ASSUMED_RATIO });
        };
        let finer = (cells as f64 / key.cells() as f64).powf(1.0 / key.shape.len() as f64);
        let growth = if found.growth.is_finite() {
            found.growth
        } else {
            known.growth.max(0.0) * finer.max(1.0)
        };
        let bounds =
            Bounds { growth, decay: 2.0 * found.rate + growth, stages: known.stages, ..found };
        Ok(NormBounds { bounds, ratio: *ratio })
    }

    /// Bounds of the case's matrix without a measurement; each is computed once.
    fn unmeasured(&mut self, case: &Case) -> Result<Bounds> {
        let key = (GridKey::of_matrix(case), case.method == Method::Schrodingerized);
        if let Some(known) = self.unmeasured.get(&key) {
            return Ok(known.clone());
        }
        let found = Bounds::new(case)?;
        self.unmeasured.insert(key, found.clone());
        Ok(found)
    }

    /// Whether the bounds of the case's matrix were measured: its predicted work is then the
    /// plan's.
    pub fn is_measured(&self, case: &Case) -> bool {
        case.method == Method::Classical || self.measured.contains_key(&GridKey::of_matrix(case))
    }

    /// Seconds of a trial of `case` with this work, comparisons included.
    pub fn seconds(&self, case: &Case, work: f64) -> f64 {
        let (kind, cells) = (WorkKind::of(case), case.space.cells() as f64);
        let measured = (self.rates.get_key_value(&kind)).or_else(|| self.rates.last_key_value());
        let rate = measured.map_or(RATE, |(of, rate)| {
            let beyond = cells > 2.0 * rate.cells;
            let slower = if beyond { OUT_OF_CACHE } else { 1.0 };
            let larger = kind.growth(cells) / of.growth(rate.cells);
            rate.seconds_per_cell * slower * larger
        });
        self.overhead(case, cells) + rate * work * cells
    }

    /// Seconds of the overhead of a trial of `case` on `cells` cells.
    pub fn overhead(&self, case: &Case, cells: f64) -> f64 {
        let key = OverheadKey::of(case);
        let differs = |of: &OverheadKey| {
            let verified = of.verified != key.verified;
            (of.by_modes != key.by_modes, verified)
        };
        let nearest = self.overheads.iter().min_by_key(|(of, _)| differs(of));
        nearest.map_or(OVERHEAD * cells, |(_, known)| {
            fitted_overhead(known, cells, case.space.shape().len())
        })
    }

    /// Learns from a trial of `case` with this plan.
    pub fn learn(&mut self, case: &Case, plan: &Plan, seconds: TrialSeconds) {
        let cells = case.space.cells();
        let (work, TrialSeconds { solve, total, .. }) = (planned_work(case, plan), seconds);
        if work > 0.0 && solve > 0.0 {
            let rate = MeasuredRate {
                seconds_per_cell: solve / (work * cells as f64),
                cells: cells as f64,
                seconds: solve,
            };
            let known = self.rates.entry(WorkKind::of(case)).or_insert(rate);
            if rate.seconds >= known.seconds {
                *known = rate;
            }
        }
        let overhead = (total - solve).max(0.0);
        let known = self.overheads.entry(OverheadKey::of(case)).or_default();
        let least = known.entry(cells).or_insert(overhead);
        *least = least.min(overhead);
        if let Some(warp) = &plan.warp {
            let found = NormBounds { bounds: plan.bounds.clone(), ratio: warp.ratio };
            self.measured.insert(GridKey::of_matrix(case), found);
        }
    }
}

/// `a + b · cells` through the `known` seconds of the fewest and of the most cells. `b` is at least
/// [`OVERHEAD`], unless this alone exceeds the known seconds. Beyond the largest known grid the
/// time grows faster: the steps of a comparison increase with the cells along an axis.
fn fitted_overhead(known: &BTreeMap<usize, f64>, cells: f64, axes: usize) -> f64 {
    let ends = known.first_key_value().zip(known.last_key_value());
    let Some(((&few, &little), (&many, &much))) = ends else { return OVERHEAD * cells };
    let (few, many) = (few as f64, many as f64);
    let fixed = if many > few {
        little - (much - little) / (many - few) * few
    } else {
        (little - OVERHEAD * few).min(START_UP)
    };
    let fixed = fixed.clamp(0.0, little.min(much));
    let each = ((much - fixed) / many).max(OVERHEAD.min(much / many));
    let longer = (cells / many).powf(1.0 / axes.max(1) as f64).max(1.0);
    fixed + each * cells * longer
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overheads_grow_with_the_cells_and_starting_up_does_not() {
        // A slow start on 16 x 16 says little about 64 x 64.
        let noisy = BTreeMap::from([(256, 0.13)]);
        let found = fitted_overhead(&noisy, 4096.0, 2);
        assert!((0.13..0.3).contains(&found), "{found}");
        // Two grids give both parts back.
        let both = BTreeMap::from([(100, 0.05 + 100.0 * 1e-4), (400, 0.05 + 400.0 * 1e-4)]);
        assert!((fitted_overhead(&both, 200.0, 2) - 0.07).abs() < 1e-12);
        for known in [noisy, both, BTreeMap::from([(100, 0.4), (400, 0.1)])] {
            let all = [100.0, 400.0, 1600.0, 6400.0].map(|cells| fitted_overhead(&known, cells, 2));
            assert!(all.windows(2).all(|two| two[0] < two[1]), "{all:?}");
        }
    }
}
