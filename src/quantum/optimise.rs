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
//!
//! **The scheme** is the conservative interface where the degree is 0: it needs no weights, whose
//! table as large as phase space no query could compute ([`scheme_of`]).

pub mod ranking;
#[cfg(test)]
mod tests;

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::Group;
use crate::problem::case::{
    Alpha, Case, Coefficients, Delta, EndFlux, Interface, Limiter, Method, ProfileChoice,
    RecoveryMethod, Shift,
};
use crate::problem::limits::{ALPHAS, BETAS, CS, MOST_ORDER, SIGMAS};
use crate::quantum::cost::{Access, Accesses, Cost, EvolutionRequirements};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::probability::{PlannedState, Probabilities};
use crate::quantum::resources::Preparation;
use crate::schrodingerization::placement::{forecast_modes, place, takes_one_mode};
use crate::schrodingerization::profile::ProfileForm;
use crate::schrodingerization::profile::series::{Series, points};
use crate::solve::system::StateNorms;
use serde::Serialize;
use std::f64::consts::TAU;

/// The default profiles of a run, for comparison.
const DEFAULTS: [ProfileChoice; 8] = [
    ProfileChoice::Designed,
    ProfileChoice::Gaussian { sigma: None },
    ProfileChoice::LowSomma { c: None },
    ProfileChoice::Acl { beta: 0.75 },
    ProfileChoice::Smooth { order: 8 },
    ProfileChoice::Smooth { order: 2 },
    ProfileChoice::Exponential { alpha: Alpha::Constant(1.0) },
    ProfileChoice::Exponential { alpha: Alpha::Constant(10.0) },
];
/// More modes than this are not compared.
const MOST_MODES: usize = 1 << 14;
/// The furthest that `p◇` is moved beyond where the profile is first `e^{−p}`: there the
/// probability is `e^{−4}` times as large.
const FURTHEST: f64 = 2.0;

/// `case` with the scheme that is taken on a quantum computer: of degree 0 the conservative
/// interface, which is stable without weights.
pub fn scheme_of(case: &Case) -> Case {
    let mut case = case.clone();
    if case.interface == Interface::Hat {
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

/// A choice and its cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CostedChoice {
    /// The profile.
    pub profile: ProfileChoice,
    /// Whether this is the unitary scheme, beside a case that has another.
    pub unitary_scheme: bool,
    /// `δ`; none without inflow.
    pub delta: Option<Delta>,
    /// `p◇`.
    pub recovery: LabelledNumber,
    /// `N_p`.
    pub points: LabelledNumber,
    /// The access to `H`; none if the cost is not known.
    pub access: Option<Access>,
    /// Calls of the block encoding in an evolution, by the sequence whose rotations are computed.
    pub steps: LabelledNumber,
    /// The same by the sequence of about half as many.
    pub half_calls_steps: LabelledNumber,
    /// The same by the cheaper sequence.
    pub walk_steps: LabelledNumber,
    /// Whether that is the cheaper sequence; none if the cost is not known.
    pub half_calls: Option<bool>,
    /// Probability of slice and window, all conditions met.
    pub probability: [LabelledNumber; 2],
    /// All gates, in Toffoli gates, until it succeeds in the window, or in the slice where there is
    /// none: repeated, and by amplitude amplification; by the cheaper sequence.
    pub cost: [LabelledNumber; 2],
    /// The required evolution; none if it is not known.
    #[serde(skip)]
    pub demand: Option<EvolutionRequirements>,
    /// The profile and the recovery point, as settings of a case.
    #[serde(skip)]
    candidate: ProfileCandidate,
}

impl CostedChoice {
    /// One that cannot be planned.
    fn unavailable(candidate: &ProfileCandidate, delta: Option<Delta>, why: &str) -> Self {
        let none = || LabelledNumber::unavailable(why);
        Self {
            profile: candidate.profile.clone(),
            unitary_scheme: false,
            candidate: candidate.clone(),
            delta,
            recovery: none(),
            points: none(),
            access: None,
            steps: none(),
            half_calls_steps: none(),
            walk_steps: none(),
            half_calls: None,
            probability: [none(), none()],
            cost: [none(), none()],
            demand: None,
        }
    }

    /// The unitary scheme, whose cheapest access costs this: one mode, which is the field.
    pub fn unitary(cost: &Cost) -> Self {
        let one = || LabelledNumber::exact(1.0);
        Self {
            unitary_scheme: true,
            recovery: LabelledNumber::exact(0.0),
            points: one(),
            probability: [one(), LabelledNumber::unavailable("one mode has no register of p")],
            access: Some(cost.access),
            cost: cost.cheaper().gates_until_measured.clone(),
            walk_steps: cost.cheaper().steps.clone(),
            steps: cost.evolution.steps.clone(),
            half_calls_steps: cost.half_calls.steps.clone(),
            half_calls: Some(cost.cheaper() == &cost.half_calls),
            ..Self::unavailable(&ProfileCandidate::planned(ProfileChoice::Planned), None, "")
        }
    }

    /// The probability of the window, or of the slice where there is none.
    pub fn nearest(&self) -> &LabelledNumber {
        let [slice, window] = &self.probability;
        if window.value().is_some() { window } else { slice }
    }

    /// Calls of the block encoding in an evolution, of the cheaper sequence.
    pub fn calls(&self) -> &LabelledNumber {
        if self.half_calls == Some(true) { &self.half_calls_steps } else { &self.steps }
    }

    /// The lower of both costs.
    pub fn measured(&self) -> &LabelledNumber {
        let [repeated, amplified] = &self.cost;
        match amplified.value() < repeated.value() {
            true => amplified,
            false => repeated,
        }
    }

    /// Why it cannot be planned, if so.
    pub fn why_not(&self) -> Option<&str> {
        match self.recovery.value() {
            None => self.recovery.because(),
            Some(_) => None,
        }
    }

    /// The cheaper of both.
    fn cheaper(self, other: Self) -> Self {
        if other.least_cost() < self.least_cost() { other } else { self }
    }

    /// The lower of both costs; infinite where there is none.
    pub fn least_cost(&self) -> f64 {
        self.cost.iter().filter_map(LabelledNumber::value).fold(f64::INFINITY, f64::min)
    }

    /// `case` with this choice, to be planned with `bounds`.
    pub fn of(&self, case: &Case, bounds: &Bounds) -> Case {
        let mut case = candidate_case(case, bounds, &self.candidate);
        if let Some(delta) = self.delta {
            case.warp.delta = delta;
        }
        case
    }
}

/// The properties of a system with some `δ` that the choice needs.
pub struct System<'a> {
    /// Ranks that share the work, if there are others.
    pub world: Option<&'a Group>,
    /// The case with that `δ`.
    pub case: &'a Case,
    /// Bounds of the case.
    pub bounds: &'a Bounds,
    /// `‖u(0)‖/‖f(T)‖` planned for.
    pub ratio: f64,
    /// The norms the probabilities follow from.
    pub norms: StateNorms,
    /// The data from which the costs follow.
    pub accesses: &'a Accesses,
}

/// A profile, and how far beyond where it is first `e^{−p}` it is read; planned where that is none.
#[derive(Clone, Debug, PartialEq)]
struct ProfileCandidate {
    profile: ProfileChoice,
    further: Option<f64>,
    /// The parameter as the scan has it; 0 of defaults.
    value: f64,
}

impl ProfileCandidate {
    /// A profile as it is planned.
    fn planned(profile: ProfileChoice) -> Self {
        Self { profile, further: None, value: 0.0 }
    }
}

/// `case` with a candidate, without settings given by hand. It has one reading: a second one only
/// estimates the error of an emulation.
fn candidate_case(case: &Case, bounds: &Bounds, candidate: &ProfileCandidate) -> Case {
    let mut case = case.clone();
    let growth = bounds.growth * case.duration();
    let shift = case.warp.shift.of(bounds.growth) * case.duration();
    let warp = &mut case.warp;
    warp.profile = candidate.profile.clone();
    (warp.interval, warp.points) = (None, None);
    warp.recovery = candidate.further.map(|further| (growth - shift).max(0.0) + further);
    (warp.coefficients, warp.recovery_method) = (Coefficients::Analytic, RecoveryMethod::Point);
    if candidate.profile == ProfileChoice::Planned {
        // A single mode has no other recovery point.
        warp.shift = Shift::Given(0.0);
    }
    (case.recovery_points, case.plateau, case.warped_field) = (1, None, false);
    case
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
    /// Whether the recovery point is free: where it is not, the parameter moves it, or moving it
    /// changes nothing.
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
            family(|c| ProfileChoice::LowSomma { c: Some(c) }, ratios(CS, 48), false),
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

    /// The cheapest of all values read at all points, of up to `most` values, the cheapest first.
    /// Every rank prices a share.
    fn best(&self, system: &System<'_>, grid: &ScanGrid, most: usize) -> Vec<CostedChoice> {
        let of = |value, further| ProfileCandidate { profile: (self.of)(value), further, value };
        let all = grid.values.iter().flat_map(|&v| grid.further.iter().map(move |&f| of(v, f)));
        let all: Vec<ProfileCandidate> = all.collect();
        let (rank, ranks) = system.world.map_or((0, 1), |world| (world.rank(), world.size()));
        let mut costs = vec![f64::NEG_INFINITY; all.len()];
        for (k, cost) in costs.iter_mut().enumerate().skip(rank).step_by(ranks) {
            *cost = choice(system, &all[k]).least_cost();
        }
        if let Some(world) = system.world {
            world.max_into(&mut costs);
        }
        let mut order: Vec<usize> = (0..all.len()).collect();
        order.sort_by(|&a, &b| costs[a].total_cmp(&costs[b]));
        let mut found: Vec<CostedChoice> = Vec::new();
        for candidate in order.into_iter().map(|k| &all[k]) {
            let new = found.iter().all(|choice| choice.candidate.value != candidate.value);
            if new && found.len() < most {
                found.push(choice(system, candidate));
            }
        }
        found
    }

    /// The cheapest on the whole grid of the family, of several values of the parameter: costs jump
    /// where a register or a round of amplification is saved.
    fn coarse(&self, system: &System<'_>) -> Vec<CostedChoice> {
        /// Number of values that are refined.
        const KEPT: usize = 4;
        let further = match self.free_point {
            true => (0..=4).map(|i| Some(FURTHEST * f64::from(i) / 4.0)).collect(),
            false => vec![None],
        };
        self.best(system, &ScanGrid { values: self.values.clone(), further }, KEPT)
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
            let ProfileCandidate { value, further, .. } = found.candidate;
            let values = match self.continuous {
                true => {
                    offsets().map(|i| (value * ratio.powf(i * width)).clamp(least, most)).collect()
                }
                false => vec![value],
            };
            let further = match further {
                Some(point) => offsets()
                    .map(|i| Some((point + 0.25 * FURTHEST * i * width).clamp(0.0, FURTHEST)))
                    .collect(),
                None => vec![None],
            };
            let grid = ScanGrid { values, further };
            let next = self.best(system, &grid, 1);
            found = next.into_iter().fold(found, CostedChoice::cheaper);
        }
        found
    }
}

/// All combinations of values of a parameter with recovery points.
struct ScanGrid {
    values: Vec<f64>,
    further: Vec<Option<f64>>,
}

/// The cheapest of every profile for one system, the profiles as they are by default, and the
/// case's own where that is one of a formula; what cannot be planned says why. Collective.
pub fn choices(system: &System<'_>) -> Vec<CostedChoice> {
    /// A family whose least cost on its grid is more than so many times the least is not refined.
    const LARGEST_RATIO: f64 = 2.0;
    let families = ProfileFamily::all();
    let coarse: Vec<(&ProfileFamily, Vec<CostedChoice>)> =
        families.iter().map(|family| (family, family.coarse(system))).collect();
    let all = coarse.iter().flat_map(|(_, choices)| choices);
    let least = all.map(CostedChoice::least_cost).fold(f64::INFINITY, f64::min);
    let closer = |family: &ProfileFamily, choice: CostedChoice| match choice.least_cost()
        <= LARGEST_RATIO * least
    {
        true => family.refined(system, choice),
        false => choice,
    };
    let of_family = |(family, choices): (&ProfileFamily, Vec<CostedChoice>)| {
        choices.into_iter().map(|choice| closer(family, choice)).reduce(CostedChoice::cheaper)
    };
    let mut found: Vec<CostedChoice> = coarse.into_iter().filter_map(of_family).collect();
    // With S = 0 one mode suffices for any profile.
    let one = ProfileCandidate::planned(ProfileChoice::Planned);
    let one_case = candidate_case(system.case, system.bounds, &one);
    let planned = takes_one_mode(&one_case, system.bounds).then_some(one.profile);
    let own = &system.case.warp.profile;
    let formula = matches!(own, ProfileChoice::Exponential { alpha: Alpha::Formula(_) });
    let defaults = DEFAULTS.into_iter().chain(planned).chain(formula.then(|| own.clone()));
    found.extend(defaults.map(|profile| choice(system, &ProfileCandidate::planned(profile))));
    found
}

/// The state of `case`, planned to be measured: on a period so long that the window ends where
/// hardly anything is left of `e^{−p}`, and that the modes fill a register, whose highest
/// wavenumber is in the `α` of a circuit.
///
/// # Errors
/// As [`WarpPlan::modes_of`](crate::schrodingerization::warp_plan::WarpPlan::modes_of).
pub fn preparation(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Preparation> {
    /// Length added to the window: `e^{−6}` of the probability is beyond it.
    const WINDOW: f64 = 3.0;
    let placement = place(case, bounds, ratio)?;
    let series = match placement.profile.as_ref().map(|profile| profile.form()) {
        Some(ProfileForm::Transform(shape)) => {
            let planned = &placement.series;
            let highest = planned.wavenumber(planned.modes() - 1);
            let least = planned.period + WINDOW;
            let modes = (highest * least / TAU).ceil() as usize + 1;
            // A register has all of its wavenumbers: none is above the highest.
            let modes = modes.next_power_of_two();
            let period = least.max((modes - 1) as f64 * TAU / highest);
            Series::analytic(period, modes, |mu| shape.coefficient(mu))
        }
        _ => placement.series.clone(),
    };
    Ok(Preparation {
        series,
        point: placement.readings[0].point,
        state_tolerance: case.tolerance / ratio,
        planned: placement.profile.as_ref().map_or(String::new(), ToString::to_string),
    })
}

/// The cost of `system` with `candidate`.
fn choice(system: &System<'_>, candidate: &ProfileCandidate) -> CostedChoice {
    let delta = system.case.enters().then_some(system.case.warp.delta);
    let case = candidate_case(system.case, system.bounds, candidate);
    let too_many = |modes: f64| {
        let why = format!("{modes} modes; up to {MOST_MODES} are compared");
        CostedChoice::unavailable(candidate, delta, &why)
    };
    // Coefficients of a profile with a corner may take long, and be of no use.
    if !matches!(candidate.profile, ProfileChoice::Designed | ProfileChoice::Planned) {
        let modes = forecast_modes(&case, system.bounds, system.ratio);
        if let Some(modes) = modes.filter(|&modes| modes > MOST_MODES as f64) {
            return too_many(modes);
        }
    }
    let Preparation { series, point, state_tolerance, .. } =
        match preparation(&case, system.bounds, system.ratio) {
            Ok(preparation) => preparation,
            Err(error) => return CostedChoice::unavailable(candidate, delta, &case.reason(&error)),
        };
    let modes = series.modes();
    if modes > MOST_MODES {
        return too_many(modes as f64);
    }
    let time = case.duration();
    let label = |x: f64| LabelledNumber::estimate(x, "norms of the classical solution, 3 digits");
    let points = points(&series).next_power_of_two();
    let bounds = system.bounds;
    let planned = PlannedState { bounds, series: &series, point, state_tolerance, time, points };
    let found = Probabilities::new(&planned, system.norms, &label);
    let all = &found.nearest().all;
    if let (None, Some(because)) = (all.value(), all.because()) {
        return CostedChoice::unavailable(candidate, delta, because);
    }
    let demand = EvolutionRequirements {
        highest: series.wavenumber(modes - 1),
        points,
        period: series.period,
        tolerance: found.amplitude().times(&LabelledNumber::exact(case.tolerance)),
    };
    let least = system.accesses.least(&demand, &found.evolutions());
    CostedChoice {
        profile: candidate.profile.clone(),
        unitary_scheme: false,
        candidate: candidate.clone(),
        delta,
        recovery: LabelledNumber::exact(found.recovery),
        points: LabelledNumber::exact(found.points as f64),
        access: Some(least.access),
        cost: least.cheaper().gates_until_measured.clone(),
        demand: Some(demand),
        half_calls: Some(least.cheaper() == &least.half_calls),
        walk_steps: least.cheaper().steps.clone(),
        steps: least.evolution.steps,
        half_calls_steps: least.half_calls.steps,
        probability: [found.at_slice.all, found.in_window.all],
    }
}
