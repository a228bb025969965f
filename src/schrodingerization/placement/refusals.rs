//! What a placement refuses: a tolerance, an interval or a recovery point that no profile meets,
//! and too many modes. An interval that is too short for the guaranteed plan only is accepted with
//! a warning.
//!
//! Uses requirements, profile, base (errors).

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, LARGEST_TOLERANCE};
use crate::problem::limits::MOST_MODES;
use crate::schrodingerization::placement::requirements::shift;
use crate::schrodingerization::profile::{PlacedProfile, Profile, ProfileRequirements};

/// The error that a profile has more modes than a run may have.
pub(super) fn too_many_modes(case: &Case, profile: String, modes: f64) -> Error {
    Error::Modes { profile, modes, limit: MOST_MODES, tolerance: case.tolerance }
}

/// The plan if the guaranteed one does not fit into the interval given by hand: for the decay of
/// the transport alone, with a warning. Or the reason why there is none.
pub(super) fn relaxed(
    case: &Case,
    bounds: &Bounds,
    ratio: f64,
    requirements: &ProfileRequirements,
    warnings: &mut Vec<String>,
) -> Result<PlacedProfile<Profile>> {
    let choice = &case.warp.choice();
    let growth = requirements.growth;
    let open = requirements.in_any_interval();
    let Some(guaranteed) = Profile::plan(choice, &open) else {
        return Err(no_profile(case, ratio, &open));
    };
    let transport =
        requirements.with_decay(bounds.dissipation * case.duration() + shift(case, bounds));
    if let Some(planned) = Profile::plan(choice, &transport) {
        warnings.push(format!(
            "solver.warp.interval has a length of {:.4}; {:.4} guarantees the tolerance, with the \
            decay x time of at most {:.4} \
             that follows from a growth x time of at most {growth:.4}; without that growth it is \
             long enough",
            length(requirements),
            guaranteed.window.period,
            requirements.decay
        ));
        return Ok(planned);
    }
    // The state at the start, with its auxiliary unknowns, may be far larger than the field at the
    // end. Then an error relative to the state may be large relative to the field.
    let of_state = transport.with_tolerance(requirements.tolerance * ratio);
    if let Some(planned) = Profile::plan(choice, &of_state) {
        warnings.push(format!(
            "solver.warp.interval has a length of {:.4}: long enough for the tolerance relative \
            to the state at the start, {ratio:.3e} times \
             as large as the field at the end; relative to the field {:.4} guarantees it",
            length(requirements),
            guaranteed.window.period
        ));
        return Ok(planned);
    }
    // A sufficient interval for the refusal's message: its ends for the decay of the transport
    // alone, relative to the state.
    let open = of_state.in_any_interval();
    let placed = Profile::plan(choice, &open).unwrap_or(guaranteed);
    Err(too_short(case, requirements, &open, &placed))
}

/// The refusal of the interval of `requirements`, with that of `placed`, which meets `open`.
fn too_short(
    case: &Case,
    requirements: &ProfileRequirements,
    open: &ProfileRequirements,
    PlacedProfile { profile, window }: &PlacedProfile<Profile>,
) -> Error {
    let [lower, upper] = profile.ends(open, window);
    Error::Interval {
        place: case.places.interval.clone(),
        given: requirements.interval.unwrap_or_default(),
        needed: window.period,
        ends: [(lower * 1e3).floor() / 1e3, (upper * 1e3).ceil() / 1e3],
        point: window.point,
        tolerance: case.tolerance,
    }
}

/// Why no profile meets `requirements`, whatever the interval.
fn no_profile(case: &Case, ratio: f64, requirements: &ProfileRequirements) -> Error {
    let (growth, share) = (requirements.growth, case.warp.share);
    match case.warp.recovery {
        Some(point) if !requirements.keeps_digits(point) => Error::Recovery {
            point,
            highest: requirements.highest_point(),
            tolerance: case.tolerance,
        },
        _ => match Profile::smallest_tolerance(&case.warp.choice(), requirements) {
            Some(smallest) if smallest * ratio / share <= LARGEST_TOLERANCE => Error::Tolerance {
                place: case.places.tolerance.clone(),
                tolerance: case.tolerance,
                smallest: round_up(smallest * ratio / share),
                ratio,
                growth,
            },
            _ => Error::Growth { ratio, growth },
        },
    }
}

fn length(requirements: &ProfileRequirements) -> f64 {
    requirements.interval.map_or(0.0, |[lower, upper]| upper - lower)
}

/// `x > 0` rounded up to two digits.
fn round_up(x: f64) -> f64 {
    let unit = 10f64.powi(x.log10().floor() as i32 - 1);
    (x / unit * (1.0 + 1e-9)).ceil() * unit
}
