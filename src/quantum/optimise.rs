//! The `δ`, profile and recovery point with the smallest product of queries and repetitions
//! (`phasewarp resources --optimise`).
//!
//! The two factors conflict. A profile with few modes has a low `‖H‖_max` and a small probability
//! of the solution. A large `δ` fills the state with auxiliary unknowns, a small one couples them
//! strongly. Every choice is planned as a run would be, to the same tolerance.

use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Coefficients, Delta, ProfileChoice};
use crate::quantum::figure::Figure;
use crate::quantum::probability::{PlannedState, Probabilities};
use crate::quantum::resources::walk;
use crate::schrodingerization::profile::series::points;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::system::StateNorms;
use serde::Serialize;
use std::fmt;

/// Profiles that are tried.
const PROFILES: [ProfileChoice; 8] = [
    ProfileChoice::Designed,
    ProfileChoice::Gaussian,
    ProfileChoice::LowSomma { c: None },
    ProfileChoice::Acl { beta: 0.75 },
    ProfileChoice::Smooth { order: 8 },
    ProfileChoice::Smooth { order: 2 },
    ProfileChoice::Exponential { alpha: 1.0 },
    ProfileChoice::Exponential { alpha: 10.0 },
];
/// More modes than this are not planned in full.
const MOST_MODES: usize = 1 << 14;
/// How far above the planned recovery point others are tried.
const FURTHER: [f64; 3] = [0.0, 0.5, 1.0];

/// Values of `δ` that are tried where something enters, `largest` being the largest inflow.
pub fn deltas(case: &Case, largest: f64) -> Vec<Delta> {
    if !case.enters() {
        return vec![case.warp.delta];
    }
    vec![Delta::Planned, Delta::Largest, Delta::Given(2.0 * largest), Delta::Given(8.0 * largest)]
}

/// A choice and its cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Choice {
    /// The profile.
    pub profile: ProfileChoice,
    /// `δ`; none where nothing enters.
    pub delta: Option<Delta>,
    /// `p◇`.
    pub recovery: Figure,
    /// `N_p`.
    pub points: Figure,
    /// Walk steps of an evolution.
    pub walk_steps: Figure,
    /// Probability of slice and window, all conditions met.
    pub probability: [Figure; 2],
    /// Walk steps until it succeeds in the window, or in the slice where there is none: repeated,
    /// and by amplitude amplification.
    pub cost: [Figure; 2],
}

impl Choice {
    fn unavailable(profile: ProfileChoice, delta: Option<Delta>, why: &str) -> Self {
        let none = || Figure::unavailable(why);
        Self {
            profile,
            delta,
            recovery: none(),
            points: none(),
            walk_steps: none(),
            probability: [none(), none()],
            cost: [none(), none()],
        }
    }
}

/// A system that some `δ` makes, as much as the choice needs to know.
pub struct System<'a> {
    /// The case with that `δ`.
    pub case: &'a Case,
    /// Its bounds.
    pub bounds: &'a Bounds,
    /// `‖u(0)‖/‖f(T)‖` planned for.
    pub ratio: f64,
    /// The norms the probabilities follow from.
    pub norms: StateNorms,
    /// `max |S_ij|` and `max |K_ij|`, nonzeros of the fullest row.
    pub matrix: (f64, f64, usize),
}

impl System<'_> {
    /// `δ`; none where nothing enters.
    fn delta(&self) -> Option<Delta> {
        self.case.enters().then_some(self.case.warp.delta)
    }
}

/// Plans every profile and recovery point for one system; what cannot be planned says why.
pub fn choices(system: &System<'_>) -> Vec<Choice> {
    let mut found = Vec::new();
    let delta = system.delta();
    for profile in PROFILES {
        let mut case = system.case.clone();
        case.warp.profile = profile;
        (case.warp.interval, case.warp.points, case.warp.recovery) = (None, None, None);
        case.warp.coefficients = Coefficients::Analytic;
        let plan = |case: &Case| {
            let modes = WarpPlan::modes_of(case, system.bounds, system.ratio)?;
            match modes <= MOST_MODES {
                true => WarpPlan::new(case, system.bounds, system.ratio).map(Ok),
                false => Ok(Err(format!("{modes} modes; up to {MOST_MODES} are compared"))),
            }
        };
        // These two may begin e^{−p} anywhere: another recovery point only shifts them.
        let moves = matches!(profile, ProfileChoice::Designed | ProfileChoice::Gaussian);
        let mut first = None;
        for further in FURTHER.into_iter().take(if moves { 1 } else { FURTHER.len() }) {
            case.warp.recovery = first.map(|point: f64| point + further);
            match plan(&case).unwrap_or_else(|error| Err(error.to_string())) {
                Ok(plan) => {
                    first.get_or_insert(plan.readings[0].point);
                    found.push(choice(system, profile, &plan));
                }
                Err(why) => {
                    found.push(Choice::unavailable(profile, delta, &why));
                    break;
                }
            }
        }
    }
    found
}

/// The cost of `system` with `profile` as planned.
fn choice(system: &System<'_>, profile: ProfileChoice, plan: &WarpPlan) -> Choice {
    let (time, tolerance) = (system.case.duration(), system.case.tolerance);
    let points = points(&plan.series).next_power_of_two();
    let highest = plan.series.wavenumber(points / 2);
    let (s, k, nonzeros) = system.matrix;
    // An entry's S and K are at most the largest of each.
    let tau = nonzeros as f64 * (highest * s).hypot(k) * time;
    let label = |x: f64| Figure::estimate(x, "norms of the classical solution to three digits");
    let planned = PlannedState { bounds: system.bounds, warp: plan, time, points };
    let found = Probabilities::new(&planned, system.norms, &label);
    let steps = walk(tau, tolerance * found.amplitude()).1;
    let steps = steps.value().map_or(steps, Figure::bound);
    let chain = match found.window {
        Some(_) => &found.in_window,
        None => &found.at_slice,
    };
    let of = |evolutions: &Figure| match (evolutions.value(), steps.value()) {
        (Some(n), Some(steps)) => label(n * steps),
        _ => evolutions.clone(),
    };
    Choice {
        profile,
        delta: system.delta(),
        recovery: Figure::exact(found.recovery),
        points: Figure::exact(found.points as f64),
        cost: [of(&chain.repetitions), of(&chain.amplified_evolutions)],
        walk_steps: steps,
        probability: [found.at_slice.all, found.in_window.all],
    }
}

/// All choices, the cheapest first, by repetition or amplitude amplification; those without a
/// number last.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Ranking(pub Vec<Choice>);

impl Ranking {
    /// Sorted.
    pub fn new(mut choices: Vec<Choice>) -> Self {
        let key = |choice: &Choice| {
            let costs = choice.cost.iter().filter_map(Figure::value);
            costs.fold(f64::INFINITY, f64::min)
        };
        choices.sort_by(|a, b| key(a).total_cmp(&key(b)));
        Self(choices)
    }
}

impl fmt::Display for Ranking {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{:<22}{:>10}{:>8}{:>9}{:>12}{:>11}{:>11}{:>12}{:>12}",
            "profile",
            "delta",
            "p",
            "N_p",
            "walk steps",
            "P slice",
            "P window",
            "naive",
            "amplified"
        )?;
        let number =
            |figure: &Figure| figure.value().map_or("-".to_owned(), |x| format!("{x:.2e}"));
        for choice in &self.0 {
            let delta = match choice.delta {
                None => "-".to_owned(),
                Some(Delta::Planned) => "planned".to_owned(),
                Some(Delta::Largest) => "max".to_owned(),
                Some(Delta::Given(delta)) => format!("{delta:.2e}"),
            };
            let profile = crate::base::text::word(&choice.profile);
            if let Figure::Unavailable { because } = &choice.recovery {
                writeln!(f, "{profile:<22}{delta:>10}   unavailable: {because}")?;
                continue;
            }
            writeln!(
                f,
                "{profile:<22}{delta:>10}{:>8.3}{:>9}{:>12}{:>11}{:>11}{:>12}{:>12}",
                choice.recovery.value().unwrap_or(f64::NAN),
                choice.points.value().unwrap_or(f64::NAN),
                number(&choice.walk_steps),
                number(&choice.probability[0]),
                number(&choice.probability[1]),
                number(&choice.cost[0]),
                number(&choice.cost[1]),
            )?;
        }
        writeln!(
            f,
            "cost: walk steps until the field is in the window, repeated until it is (naive) or by \
             amplitude amplification; estimates"
        )
    }
}
