//! The `δ`, profile, parameter, recovery point and access to `H` with the least [`cost`]
//! (`phasewarp resources`, and `--optimise`, which shows what it was compared with).
//!
//! [`cost`]: crate::quantum::cost
//!
//! The two factors conflict. A profile with few modes has a low `‖H‖_max` and a small probability
//! of the solution. A large `δ` fills the state with auxiliary unknowns, a small one couples them
//! strongly. Every choice is planned to the tolerance that a run would have, but for its cost on a
//! quantum computer: a long period is nearly free there, a high wavenumber is not. The parameter of
//! every profile is searched over all values that a case file may have, together with the distance
//! of the recovery point from where the profile is first `e^{−p}`: on a grid, then on finer grids
//! about the best. That is within a few per cent of the cheapest; the constants of the cost model
//! are not known as well.
//!
//! **The scheme** is the conservative interface where the degree is 0, because it needs no weights
//! ([`scheme_of`]). Weights are a table as large as phase space, which a query cannot compute.

pub mod candidate;
pub mod pricing;
pub mod ranking;
#[cfg(test)]
mod tests;

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::problem::case::{
    Alpha, Case, DEFAULT_ALPHA, DEFAULT_BETA, DEFAULT_ORDER, Delta, EndFlux, Interface, Limiter,
    Method, ProfileChoice,
};
use crate::problem::limits::{ALPHAS, BETAS, LOW_SOMMA_POINTS, MOST_ORDER, SIGMAS};
use crate::quantum::optimise::candidate::{CostedChoice, ProfileCandidate, System, candidate_case};
use crate::quantum::optimise::pricing::{cheapest, choice};
use crate::scheme::interface::law_of;
use crate::schrodingerization::placement::takes_one_mode;

/// The default profiles of a run, for comparison.
const DEFAULTS: [ProfileChoice; 8] = [
    ProfileChoice::Designed,
    ProfileChoice::Gaussian { sigma: None },
    ProfileChoice::LowSomma { c: None },
    ProfileChoice::Acl { beta: DEFAULT_BETA },
    ProfileChoice::Smooth { order: DEFAULT_ORDER },
    ProfileChoice::Smooth { order: 2 },
    ProfileChoice::Exponential { alpha: Alpha::Constant(DEFAULT_ALPHA) },
    ProfileChoice::Exponential { alpha: Alpha::Constant(10.0) },
];
/// The furthest that `p◇` is moved beyond where the profile is first `e^{−p}`: there the
/// probability is `e^{−4}` times as large.
const FURTHEST: f64 = 2.0;

/// `case` with the scheme that is taken on a quantum computer: in place of an interface law that
/// needs weights the conservative one, which is stable without them.
pub fn scheme_of(case: &Case) -> Case {
    let mut case = case.clone();
    if law_of(case.interface).may_grow() {
        (case.interface, case.warp.weights) = (Interface::Conservative, false);
    }
    case
}

/// `case` with the scheme whose flow is unitary: the central flux and closed ends.
///
/// # Errors
/// [`Error::Input`] where something enters or is reflected in part: then there is none.
pub fn unitary_of(case: &Case) -> Result<Case> {
    let wrong = |what: &str| Err(Error::Input(format!("{}: {what}", case.name)));
    if case.embeds() {
        return wrong("something enters (inflow.value), and the norm is not kept");
    }
    if case.reflects() {
        return wrong("potential.reflection mixes two traces into two, and is no isometry");
    }
    Ok(with_unitary_scheme(case))
}

/// `case` with that scheme, which is unitary if nothing enters or is reflected in part.
pub fn with_unitary_scheme(case: &Case) -> Case {
    let mut case = Case { flux: 0.0, ends: EndFlux::Closed, ..case.clone() };
    (case.interface, case.warp.weights) = (Interface::Conservative, false);
    (case.limiter, case.method) = (Limiter::None, Method::Schrodingerized);
    case
}

/// Values of `δ` that are tried where something enters, `largest` being the largest inflow.
pub fn deltas(case: &Case, largest: f64) -> Vec<Delta> {
    if !case.enters() {
        return vec![case.warp.delta];
    }
    vec![Delta::Planned, Delta::Largest, Delta::Given(2.0 * largest), Delta::Given(8.0 * largest)]
}

/// The profile of a constant `α`.
fn exponential(alpha: f64) -> ProfileChoice {
    ProfileChoice::Exponential { alpha: Alpha::Constant(alpha) }
}

/// A profile with a parameter, and the search over it.
struct ProfileFamily {
    of: fn(f64) -> ProfileChoice,
    /// The least and the largest value of the parameter.
    limits: [f64; 2],
    /// Steps of the first grid between them, by equal ratios.
    steps: i32,
    /// Whether the recovery point is searched as well. It is not where it follows from the
    /// parameter, or where moving it changes nothing.
    free_point: bool,
}

impl ProfileFamily {
    /// All profiles that have a parameter.
    fn all() -> [Self; FAMILIES] {
        let family = |of, limits, steps, free_point| Self { of, limits, steps, free_point };
        let gaussian = |sigma| ProfileChoice::Gaussian { sigma: Some(sigma) };
        let smooth = |order: f64| ProfileChoice::Smooth { order: order.round() as usize };
        [
            family(gaussian, SIGMAS, 144, false),
            family(|c| ProfileChoice::LowSomma { c: Some(c) }, LOW_SOMMA_POINTS, 144, false),
            family(|beta| ProfileChoice::Acl { beta }, BETAS, 8, true),
            family(exponential, ALPHAS, 12, true),
            family(smooth, [1.0, MOST_ORDER as f64], 8, true),
        ]
    }

    /// The candidates of the family: each of these values, read at each of these recovery points.
    fn candidates(&self, values: &[f64], beyond_edge: &[Option<f64>]) -> Vec<ProfileCandidate> {
        let of =
            |value, beyond_edge| ProfileCandidate { profile: (self.of)(value), beyond_edge, value };
        values.iter().flat_map(|&v| beyond_edge.iter().map(move |&f| of(v, f))).collect()
    }

    /// The cheapest on a grid over all values and recovery points, then on ever finer grids about
    /// the best, each twice as fine as the one before. Collective.
    fn cheapest(&self, system: &System<'_>) -> CostedChoice {
        /// Steps of the first grid along the recovery point.
        const POINTS: i32 = 4;
        /// Finer grids.
        const ZOOMS: i32 = 5;
        /// Steps of a finer grid on either side of the best.
        const STEPS: i32 = 2;
        let [least, most] = self.limits;
        let ratio = (most / least).powf(f64::from(self.steps).recip());
        let point_step = FURTHEST / f64::from(POINTS);
        let values: Vec<f64> =
            (0..=self.steps).map(|i| (least * ratio.powi(i)).min(most)).collect();
        let points = (0..=POINTS).map(|i| Some(point_step * f64::from(i)));
        let points = if self.free_point { points.collect() } else { vec![None] };
        let first = self.candidates(&values, &points);
        let Some(mut found) = cheapest(system, &first, f64::INFINITY) else {
            return choice(system, &first[0]);
        };
        for zoom in 1..=ZOOMS {
            let parts = (-STEPS..=STEPS).map(|i| f64::from(i) * 0.5f64.powi(zoom));
            let ProfileCandidate { value, beyond_edge, .. } = found.candidate;
            let of_value = |part: f64| (value * ratio.powf(part)).clamp(least, most);
            let of_point = |part: f64| {
                beyond_edge.map(|point| (point + point_step * part).clamp(0.0, FURTHEST))
            };
            let values: Vec<f64> = parts.clone().map(of_value).collect();
            let mut points: Vec<Option<f64>> = parts.map(of_point).collect();
            points.dedup();
            let next = self.candidates(&values, &points);
            found = cheapest(system, &next, found.least_cost()).unwrap_or(found);
        }
        found
    }
}

/// Families of profiles with a parameter.
const FAMILIES: usize = 5;
/// Units of progress of [`choices`]: one a family, and one for the defaults.
pub const UNITS: usize = FAMILIES + 1;

/// The cheapest set-up of every profile for one system, the profiles with their default parameters,
/// and the case's own profile if it is given by a formula. A set-up that cannot be planned has the
/// reason. Advances `progress` by [`UNITS`]. Collective.
pub fn choices(system: &System<'_>, progress: &mut Progress) -> Vec<CostedChoice> {
    // With S = 0 one mode suffices for any profile. It is the field, and no profile is cheaper.
    let one = ProfileCandidate::planned(ProfileChoice::Planned);
    let one_case = candidate_case(system.case, system.bounds, &one);
    let mut found = if takes_one_mode(&one_case, system.bounds) {
        progress.advance(FAMILIES);
        vec![choice(system, &one)]
    } else {
        let cheapest = |family: ProfileFamily| {
            let found = family.cheapest(system);
            progress.advance(1);
            found
        };
        ProfileFamily::all().map(cheapest).into()
    };
    let own = &system.case.warp.profile;
    let formula = matches!(own, ProfileChoice::Exponential { alpha: Alpha::Formula(_) });
    let defaults = DEFAULTS.into_iter().chain(formula.then(|| own.clone()));
    found.extend(defaults.map(|profile| choice(system, &ProfileCandidate::planned(profile))));
    progress.advance(1);
    found
}
