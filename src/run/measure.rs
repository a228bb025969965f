//! `[readout]`: what a quantum computer would tell of the result.

use super::Place;
use crate::case::Case;
use crate::communicator::Communicator;
use crate::observables::power_sum;
use crate::plan::Plan;
use crate::problem::Problem;
use crate::propagate::order;
use crate::quantum::Figure;
use crate::quantum::probability::{Norms, Probabilities};
use crate::quantum::readout::{Readout, Source, refused};

/// Reads from `field` on this rank's share, `least` its smallest value over all ranks, `estimate` that of its relative error. Collective.
pub(super) fn readout(
    case: &Case,
    plan: &Plan,
    problem: &Problem,
    communicator: &Communicator,
    place: &Place,
    (field, least, estimate): (&[f64], f64, Option<f64>),
) -> Readout {
    if let Some(why) = refused(case) {
        return Readout::unavailable(case, why);
    }
    let Some(warp) = &plan.warp else {
        return Readout::unavailable(case, "nothing is planned by modes");
    };
    let world = &communicator.world;
    let pi = &problem.weights.pi[place.mine.clone()];
    let norm = |term: &dyn Fn(usize) -> f64| {
        power_sum(world, case.space.velocity_cells(), field.len(), 2, term).sqrt()
    };
    let start = &problem.states[0];
    let norms = Norms {
        start: problem.norm(communicator, start, false),
        weighted: norm(&|i| pi[i].sqrt() * field[i]),
        auxiliary: problem.norms_of_parts(communicator, start)[1],
        field: norm(&|i| field[i]),
    };
    let known = (&plan.bounds, warp, case.end);
    let probabilities = Probabilities::new(known, norms, &|x| {
        Figure::estimate(x, "from the recovered field, within its tolerance")
    });
    // Implicit steps leave an error of their own.
    let state_error = match (order(case.propagator.method), estimate) {
        (0, _) => Figure::bound(case.tolerance),
        (_, Some(error)) => Figure::estimate(error, "the error estimate of the run"),
        (_, None) => Figure::unavailable("there is no error estimate of the run"),
    };
    let source = Source {
        share: &place.share,
        field,
        pi,
        norm: norms.field,
        least,
        probabilities: &probabilities,
        state_error,
    };
    Readout::new(world, case, &source)
}
