//! A semi-discrete problem with its exact solution `exp(AT) f(0)`. Recoveries from any series in
//! `p`, planned or not, are compared to it.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, ProfileChoice, Propagation, RecoveryMethod, Shift};
use crate::propagate::classical::{Classical, ClassicalSpan, EXACT};
use crate::run::fields;
use crate::run::norms::{FieldNorms, volumes_of};
use crate::schrodingerization::profile::series::Series;
use crate::schrodingerization::recovery::Reading;
use crate::solve::prepared::Prepared;
use crate::study::trial::plan_series;

/// Relative error of a mode: far below every error that a panel shows.
const MODE_TOLERANCE: f64 = 1e-16;
/// Tolerance of the plan that determines the process mesh; its value does not matter.
const TOLERANCE: f64 = 1e-6;

/// The problem on this rank, and its exact fields at `T`.
pub struct ReferenceProblem {
    /// The assembled case, its bounds with the measured growth.
    pub prepared: Prepared,
    resources: Resources,
    /// `f(T)` of each field, on this rank's share.
    exact: Vec<Vec<f64>>,
    /// Largest `‖ũ(0)‖/‖f(T)‖` over the fields.
    pub ratio: f64,
}

impl ReferenceProblem {
    /// The problem of `case` by Schrödingerization, with its weights, interface and inflow, which
    /// must not depend on time. Its settings of `p` are ignored. Collective.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    pub fn new(world: &World, case: &Case) -> Result<Self> {
        let mut case = Case { tolerance: TOLERANCE, ..case.clone() };
        case.output.recovery_points = 1;
        let delta = case.warp.delta;
        plan_series(&mut case.warp);
        case.warp.delta = delta;
        (case.warp.profile, case.warp.shift) = (ProfileChoice::Planned, Shift::Given(0.0));
        case.warp.recovery_method = RecoveryMethod::Point;
        case.propagator = Propagation::default();
        let resources = Resources::here(world);
        let mut prepared = Prepared::new(world, &case, &resources)?;
        let resources = resources.on_mesh(&prepared.plan.layout.mesh);
        prepared.plan.bounds = prepared.bounds.clone();
        let mut reference = Self { prepared, resources, exact: Vec::new(), ratio: 0.0 };
        reference.propagate(case.duration());
        Ok(reference)
    }

    /// Computes `f(T)` of each field and the largest ratio. Collective.
    fn propagate(&mut self, time: f64) {
        let Prepared { system, communicator, rank_cells, bounds, .. } = &mut self.prepared;
        for mut state in system.states.clone() {
            let before = system.norm(communicator, &state);
            let (exchange, span) =
                (&mut system.exchange, ClassicalSpan { rate: bounds.rate, time });
            Classical::new(&system.matrix).exponential(exchange, &mut state, span, EXACT);
            let after = system.field_norm(communicator, &state);
            if after > 0.0 {
                self.ratio = self.ratio.max(before / after);
            }
            self.exact.push(system.weights.own_field(&rank_cells.mine, &state));
        }
    }

    /// Updates of unknowns that propagating `series` takes: applications times unknowns.
    ///
    /// # Errors
    /// As [`Plan::with_series`].
    pub fn updates(&self, series: &Series) -> Result<f64> {
        let plan = self.with_series(series.clone(), Vec::new())?;
        let applications = plan.warp.map_or(0, |w| w.applications);
        Ok(applications as f64 * self.prepared.case.space.cells() as f64)
    }

    /// The plan that propagates `series`.
    fn with_series(&self, series: Series, readings: Vec<Reading>) -> Result<Plan> {
        let Prepared { case, plan, .. } = &self.prepared;
        plan.with_series(case, series, readings, MODE_TOLERANCE, &self.resources)
    }

    /// Relative l2 distance to `f(T)` of the readings from `series` at each of the `points`, the
    /// largest over the fields. Collective.
    ///
    /// # Errors
    /// As [`Plan::with_series`] and [`crate::solve::modes::run`].
    pub fn errors(&mut self, series: &Series, points: &[f64]) -> Result<Vec<f64>> {
        let at = |&point: &f64| Reading { method: RecoveryMethod::Point, point, width: 0.0 };
        self.prepared.plan = self.with_series(series.clone(), points.iter().map(at).collect())?;
        let found = fields::solve_silently(&mut self.prepared)?;
        let volumes = volumes_of(&self.prepared);
        let mut worst = vec![0.0f64; points.len()];
        for (readings, exact) in found.fields.iter().zip(&self.exact) {
            for (worst, f) in worst.iter_mut().zip(readings.each()) {
                let error = FieldNorms::new(&self.prepared, &volumes, f).distance(exact);
                if !error.is_nan() {
                    *worst = worst.max(error);
                }
            }
        }
        Ok(worst)
    }
}
