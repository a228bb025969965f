//! Moments and fields at the output times before the end, from what either method finds there.

use crate::matrix::observables::{MOMENTS, Moments, VelocityFactors, moments};
use crate::problem::legs::Leg;
use crate::problem::potential::nodal_values;
use crate::results::dataset::{EarlyResult, slices};
use crate::run::norms::volumes_of;
use crate::solve::field_readings::FieldHistory;
use crate::solve::prepared::Prepared;

/// Moments and fields at the output times before the end, from what was `recovered` of each field
/// there. Collective.
pub(super) fn history(prepared: &Prepared, mut recovered: Vec<FieldHistory>) -> Vec<EarlyResult> {
    let case = &prepared.case;
    let volumes = volumes_of(prepared);
    let potential = nodal_values(case, &prepared.rank_cells.share);
    let legs = Leg::all(case);
    let at_time = |t: usize| {
        let states = recovered.iter_mut().map(|field| std::mem::take(&mut field.times[t]));
        let found = states.collect();
        let time = &case.output.times[t];
        let (moments, fields) = if legs[t].moments_only {
            (moments_of_sums(prepared, found), Vec::new())
        } else {
            moments_of_fields(prepared, found, time.fields)
        };
        EarlyResult {
            time: time.time,
            totals: volumes.totals(&prepared.communicator.world, &moments, &potential),
            moments,
            fields,
        }
    };
    (0..case.output.times.len()).map(at_time).collect()
}

fn moments_of_sums(prepared: &Prepared, found: Vec<Vec<f64>>) -> Moments {
    let sums = found.concat();
    let (sums, _) = sums.as_chunks::<MOMENTS>();
    let factors = VelocityFactors::new(&prepared.case.space);
    Moments::of_sums(&prepared.communicator.world, &factors, sums.iter().copied())
}

/// Moments of `found`, and the fields themselves if `keep` is set.
fn moments_of_fields(
    prepared: &Prepared,
    found: Vec<Vec<f64>>,
    keep: bool,
) -> (Moments, Vec<Vec<f64>>) {
    let fields: Vec<Vec<f64>> = (found.into_iter()).map(|u| prepared.unweighted(u)).collect();
    let world = &prepared.communicator.world;
    let moments = moments(world, &prepared.case, &prepared.rank_cells.share, &slices(&fields));
    (moments, if keep { fields } else { Vec::new() })
}
