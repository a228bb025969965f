//! Results on the user's grid: fields, moments, totals, and their distance to the exact solution.

use crate::base::error::Result;
use crate::matrix::observables::{CellVolumes, Moments, Totals, moments};
use crate::parallel::communicator::Group;
use crate::problem::case::Case;
use crate::problem::potential::nodal_values;
use crate::results::dataset::{EarlyResult, ExactSolution, slices};
use crate::results::result_grid::ResultGrid;
use crate::results::summary::{GridErrors, Summary};
use crate::run::errors::{self, ResultOnShare};
use crate::run::exact::ExactRun;
use crate::run::norms::FieldNorms;
use crate::run::positive;
use crate::run::solved::SolvedFields;
use crate::solve::prepared::Prepared;
use std::ops::Range;
use std::time::Instant;

/// Fields and moments on this rank's share of the user's grid.
pub struct ExpandedResults {
    /// The fields at `T`, row-major over the share's space cells, then the velocities.
    pub fields: Vec<Vec<f64>>,
    /// Moments at `T`.
    pub moments: Moments,
    /// `V` on the share's space cells.
    pub potential: Vec<f64>,
    /// Mass and energies in all of space.
    pub totals: Totals,
    /// The output times before the end.
    pub early: Vec<EarlyResult>,
    /// Seconds that the distance to the exact solution took.
    pub exact_seconds: f64,
}

/// Expands `solution` to the user's grid `result_grid`, and puts its ranges, totals and errors into
/// `summary`. A rank that `prints` reports the progress of the errors. Collective.
///
/// # Errors
/// If `V` is not finite.
pub(crate) fn expand(
    prepared: &Prepared,
    solution: SolvedFields,
    result_grid: &ResultGrid,
    exact: &ExactRun,
    summary: &mut Summary,
    prints: bool,
) -> Result<ExpandedResults> {
    let share = &prepared.rank_cells.share;
    let mut fields: Vec<Vec<f64>> = (solution.fields.into_iter())
        .map(|readings| result_grid.field(share, readings.into_first()))
        .collect();
    let early = (solution.early.into_iter()).map(|early| result_grid.early(share, early)).collect();
    let (world, case) = (&prepared.communicator.world, &result_grid.case);
    let volumes = CellVolumes::new(&case.space, &result_grid.share(share));
    if case.output.positive {
        let norms = FieldNorms { world, volumes: &volumes, f: &fields[0] };
        let [minimum, _] = norms.range();
        summary.minimum_before_limiting = Some(minimum);
        positive::limit(&case.space, &result_grid.share(share), &mut fields[0]);
    }
    for (field, summary) in fields.iter().zip(&mut summary.fields) {
        let norms = FieldNorms { world, volumes: &volumes, f: field };
        [summary.minimum, summary.maximum] = norms.range();
    }
    let moments = moments(world, case, &result_grid.share(share), &slices(&fields));
    let potential = nodal_values(case, &result_grid.share(share));
    let totals = volumes.totals(world, &moments, &potential);
    (summary.mass, summary.kinetic_energy) = (totals.mass, totals.kinetic);
    summary.potential_energy = Some(totals.potential).filter(|energy| energy.is_finite());
    summary.minimum = summary.fields[0].minimum;
    summary.maximum = summary.fields[0].maximum;
    let began = Instant::now();
    let mut results =
        ExpandedResults { fields, moments, potential, totals, early, exact_seconds: 0.0 };
    let share = result_grid.share(share);
    results.on_share(world, case, &share, &volumes).set_errors(exact, summary, prints)?;
    if case.accuracy.is_some() {
        summary.accuracy.goal_error = summary.error_density_l1_relative;
    }
    results.exact_seconds = began.elapsed().as_secs_f64();
    Ok(results)
}

impl ExpandedResults {
    /// The first field and its moments, which are on this `share` of the space cells of `case` with
    /// these `volumes`.
    pub fn on_share<'a>(
        &'a self,
        world: &'a Group,
        case: &'a Case,
        share: &'a [Range<usize>],
        volumes: &'a CellVolumes,
    ) -> ResultOnShare<'a> {
        let (field, moments) = (&self.fields[0], &self.moments);
        ResultOnShare { world, case, share, volumes, field, moments }
    }
}

impl ResultOnShare<'_> {
    /// Puts the distances to the exact solution into `summary`, if there is one. Collective.
    ///
    /// # Errors
    /// If `V` is not finite.
    fn set_errors(&self, exact: &ExactRun, summary: &mut Summary, prints: bool) -> Result<()> {
        let (Some(solution), Some(moments)) = (&exact.exact, exact.moments.last()) else {
            return Ok(());
        };
        let Self { world, case, volumes, .. } = *self;
        let values = match solution {
            ExactSolution::Measure { .. } => {
                self.set_moment_errors(moments, summary);
                return Ok(());
            }
            ExactSolution::Field(values) => values,
        };
        let errors = match (&case.exact, case.space.whole_degree()) {
            (Some(kind), 1..) => errors::by_elements(self, kind, prints)?,
            _ => {
                let field = FieldNorms { world, volumes, f: self.field }.errors(values);
                errors::by_cells(self, field, moments)
            }
        };
        summary.set_errors(&errors);
        let values = |c: usize| [exact.density_errors[c], moments.density[c].abs()];
        let [error, size] = volumes.integrals(world, values);
        // A density that cancels has no relative error.
        let relative = Some(error / size).filter(|error| error.is_finite());
        summary.exact_density_error = summary.error_density_l1_relative.and(relative);
        Ok(())
    }

    /// Puts the distances of the moments of measure-valued data to the exact ones into `summary`.
    /// Collective.
    fn set_moment_errors(&self, exact: &Moments, summary: &mut Summary) {
        let Self { world, volumes, moments, .. } = *self;
        let density = errors::over_space(world, volumes, &[(&moments.density, &exact.density)]);
        summary.set_errors(&GridErrors { field: None, density, momentum: None, exact_mass: None });
        summary.error_velocity_l1 = Some(velocity_error(world, volumes, moments, exact));
    }
}

/// `Σ_a ∫ |u_a − u_exact,a| dx` over the cells that have an exact mean velocity. If the result has
/// none there, it counts as zero. Collective.
fn velocity_error(world: &Group, volumes: &CellVolumes, found: &Moments, exact: &Moments) -> f64 {
    let velocity = |c: usize| -> f64 {
        let pairs = found.velocity.iter().zip(&exact.velocity);
        let known = pairs.map(|(u, exact)| [u[c], exact[c]]).filter(|[_, exact]| !exact.is_nan());
        known.map(|[u, exact]| (if u.is_nan() { 0.0 } else { u } - exact).abs()).sum()
    };
    let [error] = volumes.integrals(world, |c| [velocity(c)]);
    error
}
