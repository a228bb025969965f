//! The cost of one candidate: its plan, a lower bound from a few coefficients, and the number.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Delta};
use crate::quantum::cost::{EvolutionRequirements, LeastCost};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::measurement_window::WINDOW;
use crate::quantum::optimise::candidate::{CostedChoice, ProfileCandidate, System, candidate_case};
use crate::quantum::probability::{PlannedMeasurement, PlannedState, amplification_rounds, reach};
use crate::quantum::walk::PROFILE_PART;
use crate::schrodingerization::placement::Outline;
use crate::schrodingerization::profile::series::{Series, points};
use crate::schrodingerization::profile::{ProfileForm, ProfileShape};
use std::f64::consts::TAU;

/// The largest number of modes of a candidate that is compared.
pub(super) const MOST_MODES: usize = 1 << 17;
/// Part of the field's tolerance to which a profile is planned at `p◇`, so that its window has
/// [`PROFILE_PART`].
pub const PLANNED: f64 = PROFILE_PART / WINDOW;

/// The modes of a state that is planned to be measured: on a period so long that the window ends
/// where hardly anything is left of `e^{−p}`, and that the modes fill a register, whose highest
/// wavenumber is in the `α` of a circuit.
struct RegisterModes {
    /// `N_p`, a power of two: modes `−N_p/2 … N_p/2 − 1`.
    points: usize,
    period: f64,
}

impl RegisterModes {
    /// The modes of the plan `outline` of a profile that is known on the line.
    fn new(outline: &Outline) -> Self {
        /// Length added to the window: `e^{−6}` of the probability is beyond it.
        const WINDOW: f64 = 3.0;
        let highest = TAU * (outline.modes - 1.0) / outline.period;
        let least = outline.period + WINDOW;
        let half = ((highest * least / TAU).ceil() as usize).max(1).next_power_of_two();
        // A register has all of its wavenumbers: none is above the highest.
        Self { points: 2 * half, period: least.max(half as f64 * TAU / highest) }
    }

    fn highest(&self) -> f64 {
        TAU * (self.points / 2) as f64 / self.period
    }

    fn series(&self, shape: &dyn ProfileShape) -> Series {
        Series::analytic_points(self.period, self.points, |mu| shape.coefficient(mu))
    }

    /// The series of the first `count` modes.
    fn first(&self, shape: &dyn ProfileShape, count: usize) -> Series {
        Series::analytic(self.period, count.min(self.points / 2), |mu| shape.coefficient(mu))
    }
}

/// The state of `case`, planned to be measured.
///
/// # Errors
/// As [`WarpPlan::modes_of`](crate::schrodingerization::warp_plan::WarpPlan::modes_of).
pub fn planned_state(case: &Case, bounds: &Bounds, ratio: f64) -> Result<PlannedState> {
    Ok(PlannedCandidate::new(&planned_within(case), bounds, ratio)?.state())
}

/// `case` with the tolerance to which its profile is planned.
fn planned_within(case: &Case) -> Case {
    Case { tolerance: PLANNED * case.tolerance, ..case.clone() }
}

/// A candidate whose number of modes is known, but no coefficient.
pub(super) struct PlannedCandidate {
    outline: Outline,
    /// The tolerance that the profile is planned for.
    state_tolerance: f64,
    /// The tolerance of the field at `p◇`.
    field_tolerance: f64,
    /// `Λ⁺` and `Λ⁻`.
    reach: [f64; 2],
}

impl PlannedCandidate {
    /// The plan of `case`, whose tolerance is that of its profile.
    fn new(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Self> {
        Ok(Self {
            outline: Outline::new(case, bounds, ratio)?,
            state_tolerance: case.tolerance / ratio,
            field_tolerance: case.tolerance,
            reach: reach(bounds, case),
        })
    }

    /// The plan of `candidate`.
    ///
    /// # Errors
    /// Why there is none, or why it is not compared.
    pub fn of(
        system: &System<'_>,
        candidate: &ProfileCandidate,
    ) -> std::result::Result<Self, String> {
        // Of no state there is nothing to plan.
        if let Some(why) = system.norms.no_start() {
            return Err(why.to_owned());
        }
        let case = planned_within(&candidate_case(system.case, system.bounds, candidate));
        let planned = Self::new(&case, system.bounds, system.ratio);
        let planned = planned.map_err(|error| case.reason(&error))?;
        let outline = &planned.outline;
        let too_many = |modes: f64| format!("{modes} modes; up to {MOST_MODES} are compared");
        // Coefficients of a profile with a corner may take long, and be of no use.
        if outline.modes > MOST_MODES as f64 {
            return Err(too_many(outline.modes));
        }
        if let ProfileForm::Transform(_) = outline.profile.form() {
            // The modes `l ≥ 0` that so many points have if they are given by hand.
            let modes = RegisterModes::new(outline).points / 2 + 1;
            if modes > MOST_MODES + 1 {
                return Err(too_many(modes as f64));
            }
        }
        Ok(planned)
    }

    /// The state of this plan, in a register.
    fn state(&self) -> PlannedState {
        let series = match self.outline.profile.form() {
            ProfileForm::Transform(shape) => RegisterModes::new(&self.outline).series(shape),
            ProfileForm::Series(series) => series.clone(),
        };
        let points = points(&series);
        self.state_of(series, points).in_register()
    }

    /// The state of this plan with this series, on `points` points.
    fn state_of(&self, series: Series, points: usize) -> PlannedState {
        let Self { ref outline, state_tolerance, field_tolerance, reach } = *self;
        let (profile, point) = (outline.profile.to_string(), outline.point);
        PlannedState { series, profile, point, points, state_tolerance, field_tolerance, reach }
    }

    /// A lower bound of the cost. It takes the norm of the first modes for the norm of the state,
    /// and a window without end.
    pub fn least_possible(&self, system: &System<'_>) -> f64 {
        /// Modes whose coefficients are computed: others add little to the norm.
        const FIRST: usize = 64;
        /// Round-off of the cost and of its bound.
        const ROUND_OFF: f64 = 1e-9;
        let ProfileForm::Transform(shape) = self.outline.profile.form() else { return 0.0 };
        let register = RegisterModes::new(&self.outline);
        let first = self.state_of(register.first(shape, FIRST), register.points);
        let most = first.most_probable(&system.norms);
        if !(most > 0.0 && most.is_finite()) {
            return 0.0;
        }
        let evolutions = (1.0 / most).min(2.0 * amplification_rounds(most) + 1.0);
        let evolutions = LabelledNumber::exact(evolutions);
        let amplitude = LabelledNumber::exact(most.sqrt());
        let requirements = EvolutionRequirements {
            highest: register.highest(),
            ..first.requirements(&amplitude, system.case.tolerance)
        };
        let least = system.accesses.least(&requirements, &[evolutions.clone(), evolutions]);
        (1.0 - ROUND_OFF) * least.cost.least()
    }

    fn priced(&self, system: &System<'_>, candidate: &ProfileCandidate) -> CostedChoice {
        let PlannedMeasurement { probabilities, requirements } =
            self.state().measurement(system.norms, system.case.tolerance);
        let delta = delta_of(system);
        if let Some(why) = probabilities.nearest().all.why_not() {
            return CostedChoice::unavailable(candidate, delta, why);
        }
        let LeastCost { cost, queries } =
            system.accesses.least(&requirements, &probabilities.evolutions());
        CostedChoice {
            recovery: LabelledNumber::exact(probabilities.recovery),
            points: LabelledNumber::exact(probabilities.points as f64),
            probability: [probabilities.at_slice.all, probabilities.in_window.all],
            requirements: Some(requirements),
            ..CostedChoice::at_cost(candidate, delta, &cost, queries)
        }
    }
}

/// `δ` of the system; `None` without inflow.
fn delta_of(system: &System<'_>) -> Option<Delta> {
    system.case.enters().then_some(system.case.warp.delta)
}

/// The cost of `system` with `candidate`.
pub(super) fn choice(system: &System<'_>, candidate: &ProfileCandidate) -> CostedChoice {
    match PlannedCandidate::of(system, candidate) {
        Ok(planned) => planned.priced(system, candidate),
        Err(why) => CostedChoice::unavailable(candidate, delta_of(system), &why),
    }
}
