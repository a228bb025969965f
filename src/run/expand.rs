//! Results on the user's grid: fields, moments, totals, and their distance to the exact solution.

use crate::matrix::observables::{CellVolumes, Moments, moments};
use crate::results::dataset::{Early, ExactSolution, slices};
use crate::results::shown::Shown;
use crate::results::summary::Summary;
use crate::run::compare::{FieldNorms, moment_errors};
use crate::run::files::SolvedFields;
use crate::solve::prepared::Prepared;

/// Fields and moments on this rank's share of the user's grid.
pub struct Expanded {
    /// Every field at `T`: row-major over the share's space cells, then the velocities.
    pub fields: Vec<Vec<f64>>,
    /// Moments at `T`.
    pub moments: Moments,
    /// Mass and kinetic energy.
    pub totals: [f64; 2],
    /// The output times before the end.
    pub early: Vec<Early>,
}

/// Puts `solution` onto the user's grid `shown`, and its ranges, totals and errors into `summary`. Collective.
pub(crate) fn expand(
    prepared: &Prepared,
    solution: SolvedFields,
    shown: &Shown,
    exact: Option<&ExactSolution>,
    summary: &mut Summary,
) -> Expanded {
    let share = &prepared.place.share;
    let fields: Vec<Vec<f64>> = (solution.fields.into_iter())
        .map(|mut readings| shown.field(share, readings.swap_remove(0)))
        .collect();
    let early = (solution.early.into_iter()).map(|early| shown.early(share, early)).collect();
    let (world, case) = (&prepared.communicator.world, &shown.case);
    let volumes = CellVolumes::new(&case.space, &shown.share(share));
    let norms = |f| FieldNorms { world, volumes: volumes.clone(), f };
    for (field, summary) in fields.iter().zip(&mut summary.fields) {
        let norms = norms(field);
        summary.minimum = -norms.largest(|x| -x);
        summary.maximum = norms.largest(|x| x);
    }
    let moments = moments(world, case, &slices(&fields));
    let totals = volumes.totals(world, &moments);
    [summary.mass, summary.kinetic_energy] = totals;
    summary.minimum = summary.fields[0].minimum;
    summary.maximum = summary.fields[0].maximum;
    match exact {
        None => {}
        Some(ExactSolution::Field(exact)) => {
            let (found, exact) = (norms(&fields[0]), norms(exact));
            field_errors(&found, &exact, volumes.mean(), summary);
        }
        Some(ExactSolution::Moments(exact)) => {
            let [density, velocity] = moment_errors(world, &volumes, &moments, exact);
            summary.mass_exact = Some(volumes.integral(world, &exact.density));
            summary.error_density_l1 = Some(density);
            summary.error_velocity_l1 = Some(velocity);
        }
    }
    Expanded { fields, moments, totals, early }
}

/// `∫ |f − f_exact|` and `(∫ |f − f_exact|²)^½`, and the same of `f_exact`. Collective.
fn field_errors(
    found: &FieldNorms<'_>,
    exact: &FieldNorms<'_>,
    volume: f64,
    summary: &mut Summary,
) {
    let zero = vec![0.0; exact.f.len()];
    let l1 = |of: &FieldNorms<'_>, other: &[f64]| of.difference(other, 1) * volume;
    let l2 = |of: &FieldNorms<'_>, other: &[f64]| (of.difference(other, 2) * volume).sqrt();
    summary.error_l1 = Some(l1(found, exact.f));
    summary.error_l2 = Some(l2(found, exact.f));
    summary.exact_l1 = Some(l1(exact, &zero));
    summary.exact_l2 = Some(l2(exact, &zero));
}
