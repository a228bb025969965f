//! What a case asks of its profile: tolerance, growth and decay, the shift, the width that readings
//! need.
//!
//! Uses profile (the requirements that it meets), propagate (round-off), matrix (bounds).

use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Coefficients, RecoveryMethod, Warp};
use crate::propagate;
use crate::schrodingerization::profile::ProfileRequirements;

/// Distance in `p` of the second recovery point from the first.
pub(super) const SECOND_POINT: f64 = 1.0;
/// Width in `p` of the window of an integral or least-squares recovery.
const WINDOW: f64 = 1.0;
/// Part of the tolerance that truncated modes may take where coefficients come from samples: the
/// truncated modes are aliased to the wavenumbers that are kept.
pub(super) const SAMPLED_TRUNCATION: f64 = 0.2;

/// `σT` of the spectral shift.
pub(super) fn shift(case: &Case, bounds: &Bounds) -> f64 {
    case.warp.shift.of(bounds.growth) * case.duration()
}

/// The requirements on the profile. All effects share the tolerance. If the interval is given by
/// hand, any one effect may take the whole tolerance, and the second reading may be worse.
pub(super) fn requirements(case: &Case, bounds: &Bounds, ratio: f64) -> ProfileRequirements {
    let (warp, time) = (&case.warp, case.duration());
    // Spectral shift: u = e^{σt} ũ, ũ' = (A − σ) ũ, planned for.
    let shift = shift(case, bounds);
    let growth = (bounds.growth * time - shift).max(0.0);
    let decay = bounds.decay * time + shift;
    let tolerance = warp.share * case.tolerance / ratio * libm::exp(-shift.max(0.0));
    let width = width(warp);
    let second = if case.output.recovery_points > 1 { SECOND_POINT } else { 0.0 };
    let mut requirements = ProfileRequirements::new(tolerance, growth, decay, width + second);
    requirements.round_off = propagate::round_off(propagate::steps(&case.propagator, time));
    requirements.recovery = warp.recovery;
    requirements.interval = warp.interval;
    requirements.sampled = warp.coefficients == Coefficients::Sampled;
    if requirements.sampled {
        requirements.truncation = SAMPLED_TRUNCATION;
    }
    if requirements.interval.is_some() {
        requirements.images = 1.0;
        requirements.reach = width;
    }
    requirements
}

/// Width in `p` that the readings need above `p◇`.
pub(super) fn width(warp: &Warp) -> f64 {
    match warp.recovery_method {
        RecoveryMethod::Point => 0.0,
        RecoveryMethod::Integral | RecoveryMethod::LeastSquares => WINDOW,
    }
}
