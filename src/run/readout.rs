//! `[readout]`: the result as a quantum computer would measure it.

use crate::problem::case::Case;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::readout::reader::ReadoutSource;
use crate::quantum::readout::{Readout, refused};
use crate::results::summary::Summary;
use crate::solve::prepared::Prepared;

/// Reads from `field`, the first one of `case`, on this rank's share, with what the summary has of
/// it so far. Collective.
pub(crate) fn readout(
    prepared: &Prepared,
    case: &Case,
    field: &[f64],
    summary: &Summary,
) -> Readout {
    let place = &prepared.place;
    let probabilities = match (refused(case), &summary.probabilities) {
        (None, Some(probabilities)) => probabilities,
        (why, _) => {
            return Readout::unavailable(case, why.unwrap_or("there is no plan of modes"));
        }
    };
    // Implicit steps leave an error of their own.
    let state_error = match (case.propagator.method.order(), summary.error_estimate) {
        (0, _) => LabelledNumber::bound(case.tolerance),
        (_, Some(error)) => LabelledNumber::estimate(error, "the error estimate of the run"),
        (_, None) => LabelledNumber::unavailable("there is no error estimate of the run"),
    };
    // The points of the window have errors of their own.
    let window = probabilities.window_error.unwrap_or(1.0).max(1.0);
    let state_error =
        state_error.value().map_or(state_error.clone(), |x| state_error.with(x * window));
    let source = ReadoutSource {
        share: &place.share,
        field,
        pi: &prepared.system.weights.pi[place.mine.clone()],
        least: summary.minimum,
        probabilities,
        state_error,
    };
    Readout::new(&prepared.communicator.world, case, &source)
}
