//! The `δ`, profile, parameter, recovery point and access to `H` with the least [`cost`]
//! (`phasewarp resources`, and `--optimise`, which shows what it was compared with).
//!
//! [`cost`]: crate::quantum::cost
//!
//! The two factors conflict. A profile with few modes has a low `‖H‖_max` and a small probability
//! of the solution. A large `δ` fills the state with auxiliary unknowns, a small one couples them
//! strongly. Every choice is planned to the tolerance that a run would have, but for its cost on a
//! quantum computer: a long period is nearly free there, a high wavenumber is not. The parameter of
//! every profile is scanned over all values that a case file may have, together with the distance
//! of the recovery point from where the profile is first `e^{−p}`.

pub mod candidate;
mod grid;
pub mod pricing;
pub mod ranking;
#[cfg(test)]
mod tests;

use crate::base::progress::Progress;
use crate::problem::case::{
    Alpha, Case, DEFAULT_ALPHA, DEFAULT_BETA, DEFAULT_ORDER, Delta, ProfileChoice,
};
use crate::problem::limits::{ALPHAS, BETAS, LOW_SOMMA_POINTS, MOST_ORDER, SIGMAS};
use crate::quantum::optimise::candidate::{CostedChoice, ProfileCandidate, System, candidate_case};
use crate::quantum::optimise::grid::PricedGrid;
use crate::quantum::optimise::pricing::choice;
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

/// A profile with a parameter, over all that is scanned of it.
struct ProfileFamily {
    of: fn(f64) -> ProfileChoice,
    /// The parameter's values, ascending.
    values: Vec<f64>,
    /// Whether there are values between these.
    continuous: bool,
    /// Whether the recovery point is scanned as well. It is not where it follows from the
    /// parameter, or where moving it changes nothing.
    free_point: bool,
}

impl ProfileFamily {
    /// All profiles that have a parameter.
    fn all() -> [Self; 5] {
        let ratios = |[least, most]: [f64; 2], count: i32| {
            (0..=count)
                .map(|i| least * (most / least).powf(f64::from(i) / f64::from(count)))
                .collect()
        };
        let family = |of, values, free_point| Self { of, values, continuous: true, free_point };
        [
            family(
                |sigma| ProfileChoice::Gaussian { sigma: Some(sigma) },
                ratios(SIGMAS, 48),
                false,
            ),
            family(|c| ProfileChoice::LowSomma { c: Some(c) }, ratios(LOW_SOMMA_POINTS, 48), false),
            family(|beta| ProfileChoice::Acl { beta }, ratios(BETAS, 8), true),
            family(exponential, ratios(ALPHAS, 12), true),
            Self {
                of: |order| ProfileChoice::Smooth { order: order as usize },
                values: (1..=MOST_ORDER).map(|order| order as f64).collect(),
                continuous: false,
                free_point: true,
            },
        ]
    }

    /// The candidates of the family: each of these values, read at each of these recovery points.
    fn candidates(&self, values: &[f64], beyond_edge: &[Option<f64>]) -> Vec<ProfileCandidate> {
        let of =
            |value, beyond_edge| ProfileCandidate { profile: (self.of)(value), beyond_edge, value };
        values.iter().flat_map(|&v| beyond_edge.iter().map(move |&f| of(v, f))).collect()
    }

    /// The whole grid of the family.
    fn coarse<'a>(&self, system: &'a System<'a>) -> PricedGrid<'a> {
        let beyond_edge: Vec<_> = if self.free_point {
            (0..=4).map(|i| Some(FURTHEST * f64::from(i) / 4.0)).collect()
        } else {
            vec![None]
        };
        PricedGrid::new(system, self.candidates(&self.values, &beyond_edge))
    }

    /// The cheapest on ever finer grids about `found`.
    fn refined(&self, system: &System<'_>, mut found: CostedChoice) -> CostedChoice {
        /// Finer grids.
        const ZOOMS: i32 = 5;
        /// Steps of a finer grid on either side of the best.
        const STEPS: i32 = 2;
        let [least, most] = [self.values[0], self.values[self.values.len() - 1]];
        let ratio = self.values[1] / self.values[0];
        let offsets = || (-STEPS..=STEPS).map(f64::from);
        for zoom in 1..=ZOOMS {
            let width = f64::from(STEPS).powi(-zoom);
            let ProfileCandidate { value, beyond_edge, .. } = found.candidate;
            let values: Vec<f64> = if self.continuous {
                offsets().map(|i| (value * ratio.powf(i * width)).clamp(least, most)).collect()
            } else {
                vec![value]
            };
            let beyond_edge: Vec<_> = match beyond_edge {
                Some(point) => offsets()
                    .map(|i| Some((point + 0.25 * FURTHEST * i * width).clamp(0.0, FURTHEST)))
                    .collect(),
                None => vec![None],
            };
            let mut next = self.candidates(&values, &beyond_edge);
            next.retain(|candidate| *candidate != found.candidate);
            let next = PricedGrid::new(system, next).cheapest(1, found.least_cost());
            found = next.into_iter().fold(found, CostedChoice::cheaper);
        }
        let found = self.at_edges(system, found);
        self.along_line(system, found)
    }

    /// The cheapest on a short line of values through `found`: near an end of a range the cost has
    /// steps of a few per mille of the value, as steps of the walk are saved one after the other.
    fn along_line(&self, system: &System<'_>, found: CostedChoice) -> CostedChoice {
        /// Values on either side.
        const VALUES: i32 = 16;
        /// Ratio of a value to the one before.
        const STEP: f64 = 1.002;
        if !self.continuous {
            return found;
        }
        let [least, most] = [self.values[0], self.values[self.values.len() - 1]];
        let own = found.candidate.value;
        let value = |k: i32| (own * STEP.powi(k)).clamp(least, most);
        let values: Vec<f64> = (-VALUES..=VALUES).filter(|&k| k != 0).map(value).collect();
        let line = self.candidates(&values, &[found.candidate.beyond_edge]);
        let next = PricedGrid::new(system, line).cheapest(1, found.least_cost());
        next.into_iter().fold(found, CostedChoice::cheaper)
    }

    /// The cheapest choice at the ends of a range of values about `found`, or `found`. In that
    /// range the rounds of amplification and the points of `p` stay the same. The cost falls up to
    /// an end of the range, which may be narrower than any grid.
    fn at_edges(&self, system: &System<'_>, mut found: CostedChoice) -> CostedChoice {
        /// Halvings of a step of the whole grid.
        const HALVINGS: usize = 16;
        if !self.continuous {
            return found;
        }
        let [least, most] = [self.values[0], self.values[self.values.len() - 1]];
        let ratio = self.values[1] / self.values[0];
        let kind = |choice: &CostedChoice| (choice.rounds(), choice.points.value());
        let (start, own) = (found.candidate.clone(), kind(&found));
        let at = |value: f64| {
            let profile = (self.of)(value);
            choice(system, &ProfileCandidate { profile, value, ..start.clone() })
        };
        for step in [ratio, ratio.recip()] {
            let (mut inside, mut beyond) = (start.value, (start.value * step).clamp(least, most));
            for _ in 0..HALVINGS {
                let next = at((inside * beyond).sqrt());
                if kind(&next) == own {
                    inside = next.candidate.value
                } else {
                    beyond = next.candidate.value
                }
                found = found.cheaper(next);
            }
        }
        found
    }
}

/// Units of progress of [`choices`]: two a family, and one for the defaults.
pub const UNITS: usize = 11;

/// The cheapest set-up of every profile for one system, the profiles with their default parameters,
/// and the case's own profile if it is given by a formula. A set-up that cannot be planned has the
/// reason. Advances `progress` by [`UNITS`]. Collective.
pub fn choices(system: &System<'_>, progress: &mut Progress) -> Vec<CostedChoice> {
    /// A family is not refined if its least cost on its grid exceeds the least of all by this
    /// factor.
    const LARGEST_RATIO: f64 = 2.0;
    /// Number of values of a parameter that are refined: costs jump where a register or a round of
    /// amplification is saved.
    const KEPT: usize = 4;
    let families = ProfileFamily::all();
    let (mut grids, mut cheapest) = (Vec::new(), Vec::new());
    for family in &families {
        let mut grid = family.coarse(system);
        cheapest.push(grid.cheapest(1, f64::INFINITY));
        grids.push(grid);
        progress.advance(1);
    }
    // With S = 0 one mode suffices for any profile.
    let one = ProfileCandidate::planned(ProfileChoice::Planned);
    let one_case = candidate_case(system.case, system.bounds, &one);
    let planned = takes_one_mode(&one_case, system.bounds).then(|| choice(system, &one));
    let all = cheapest.iter().flatten().chain(&planned);
    let least = all.map(CostedChoice::least_cost).fold(f64::INFINITY, f64::min);
    let mut found: Vec<CostedChoice> = Vec::new();
    for ((family, grid), first) in families.iter().zip(&mut grids).zip(cheapest) {
        // One mode is the field: no profile is cheaper.
        let close = match planned {
            Some(_) => Vec::new(),
            None => grid.cheapest(KEPT, LARGEST_RATIO * least),
        };
        let refined = close.into_iter().map(|choice| family.refined(system, choice));
        found.extend(first.into_iter().chain(refined).reduce(CostedChoice::cheaper));
        progress.advance(1);
    }
    let own = &system.case.warp.profile;
    let formula = matches!(own, ProfileChoice::Exponential { alpha: Alpha::Formula(_) });
    let defaults = DEFAULTS.into_iter().chain(formula.then(|| own.clone()));
    found.extend(planned);
    found.extend(defaults.map(|profile| choice(system, &ProfileCandidate::planned(profile))));
    progress.advance(1);
    found
}
