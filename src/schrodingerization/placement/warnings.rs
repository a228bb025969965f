//! The warnings of a placement about settings given by hand: they cause much growth, leave out too
//! many modes, or read where the profile is not `e^{−p}`.
//!
//! Uses requirements, profile, scheme (whether a law may grow).

use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Delta};
use crate::scheme::interface::law_of;
use crate::schrodingerization::placement::requirements::SAMPLED_TRUNCATION;
use crate::schrodingerization::profile::{ProfileRequirements, ProfileShape, Window};
use std::f64::consts::PI;

/// Growth over the run beyond which a warning names its remedy: an amplification by e.
const MUCH_GROWTH: f64 = 1.0;

/// A warning about large growth that the case causes: no weights although particles graze, or a
/// small `δ`.
pub(super) fn much_growth(case: &Case, bounds: &Bounds) -> Option<String> {
    let growth = bounds.growth * case.duration();
    if growth <= MUCH_GROWTH {
        return None;
    }
    let grazes = bounds.jumps && law_of(case.scheme.interface).may_grow() && !case.warp.weights;
    let (key, instead) = match case.warp.delta {
        _ if grazes => (
            "solver.warp.weights = \"none\"".to_owned(),
            "\"dissipative\", or scheme.interface = \"conservative\", keeps it small",
        ),
        Delta::Given(delta) if bounds.inflow => (
            format!("solver.warp.delta = {delta:e}"),
            "a larger one, or none given by hand, keeps it small",
        ),
        Delta::Largest if bounds.inflow => {
            ("solver.warp.delta = \"max\"".to_owned(), "none given by hand keeps it small")
        }
        _ => return None,
    };
    Some(format!(
        "{key}: growth x time may be up to {growth:.3}, where {MUCH_GROWTH} is much; what is \
        wrong with a mode is read up to {:.1e} times as \
         large; {instead}",
        growth.exp()
    ))
}

/// The warning for a number of points that is too small for the tolerance. It is no error, since
/// studies of convergence in `N_p` need such runs.
pub(super) fn too_few(
    requirements: &ProfileRequirements,
    shape: &dyn ProfileShape,
    window: &Window,
    period: f64,
    points: usize,
) -> Option<String> {
    // The omitted modes and, for samples, their aliases; relative to the state.
    let folded = if requirements.sampled { 0.5 / SAMPLED_TRUNCATION } else { 1.0 };
    let tail = shape.tail(PI * points as f64 / period, window.distance.max(0.0));
    let bound = folded * window.point.exp() * tail;
    let needed = 2.0 * (0.5 * window.cutoff * period / PI).ceil();
    (bound > requirements.tolerance).then(|| {
        format!(
            "solver.warp.points = {points}: the modes left out may add {bound:.1e} of the state, \
            the tolerance allows {:.1e}; \
             {needed} points do",
            requirements.tolerance
        )
    })
}

/// The warning of a recovery point given by hand below that of the plan.
pub(super) fn recovery_is_low(window: &Window, growth: f64) -> String {
    format!(
        "solver.warp.recovery = {} is below {:.4}, which growth x time = {growth:.4} asks for: \
         where S grows that much, what is read there comes from where the profile is not exp(-p)",
        window.point,
        window.point - window.distance
    )
}
