//! `[readout]`: what a quantum computer would tell of the result.

use super::Place;
use crate::case::Case;
use crate::communicator::Group;
use crate::output::summary::Summary;
use crate::problem::Problem;
use crate::propagate::order;
use crate::quantum::Figure;
use crate::quantum::readout::{Readout, Source, refused};

/// Reads from `field`, the first one, on this rank's share, with what the summary says of it so far. Collective.
pub(super) fn readout(
    world: &Group,
    case: &Case,
    (problem, place): (&Problem, &Place),
    field: &[f64],
    summary: &Summary,
) -> Readout {
    let probabilities = match (refused(case), &summary.probabilities) {
        (None, Some(probabilities)) => probabilities,
        (why, _) => {
            return Readout::unavailable(case, why.unwrap_or("nothing is planned by modes"));
        }
    };
    // Implicit steps leave an error of their own.
    let state_error = match (order(case.propagator.method), summary.error_estimate) {
        (0, _) => Figure::bound(case.tolerance),
        (_, Some(error)) => Figure::estimate(error, "the error estimate of the run"),
        (_, None) => Figure::unavailable("there is no error estimate of the run"),
    };
    let source = Source {
        share: &place.share,
        field,
        pi: &problem.weights.pi[place.mine.clone()],
        least: summary.minimum,
        probabilities,
        state_error,
    };
    Readout::new(world, case, &source)
}
