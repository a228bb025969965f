//! `[readout]`: simulates measurements of the result on a quantum computer.

use crate::problem::case::Case;
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::purpose::CasePurpose;
use crate::quantum::readout::Readout;
use crate::quantum::readout::reader::ReadoutSource;
use crate::results::summary::Summary;
use crate::solve::prepared::Prepared;

/// The readout of `field`, the first one of `case`, on this rank's share. It uses probabilities,
/// error and minimum from `summary`. Collective.
pub(crate) fn readout(
    prepared: &Prepared,
    case: &Case,
    field: &[f64],
    summary: &Summary,
) -> Readout {
    let rank_cells = &prepared.rank_cells;
    let probabilities = match (CasePurpose::Readout.why_not(case), &summary.probabilities) {
        (None, Some(probabilities)) => probabilities,
        (why, _) => {
            return Readout::unavailable(
                case,
                why.as_deref().unwrap_or("there is no plan of modes"),
            );
        }
    };
    // The error of implicit steps may exceed the tolerance.
    let state_error = match (case.propagator.method.order(), summary.error_estimate) {
        (0, _) => LabelledNumber::bound(case.tolerance),
        (_, Some(error)) => LabelledNumber::estimate(error, "the error estimate of the run"),
        (_, None) => LabelledNumber::unavailable("there is no error estimate of the run"),
    };
    // Other points of the window may have larger errors.
    let window = probabilities.window_error.unwrap_or(1.0).max(1.0);
    let state_error =
        state_error.value().map_or(state_error.clone(), |x| state_error.with(x * window));
    let source = ReadoutSource {
        share: &rank_cells.share,
        field,
        pi: &prepared.system.weights.pi[rank_cells.mine.clone()],
        holds_volumes: prepared.system.weights.are_volumes,
        least: summary.minimum,
        probabilities,
        norm_is_known: prepared.bounds.keeps_norm(),
        state_error,
    };
    Readout::new(&prepared.communicator.world, case, &source)
}
