//! The cost of one candidate: its plan, a lower bound from a few coefficients, and the number.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::problem::case::{Case, Delta};
use crate::quantum::cost::{EvolutionRequirements, LeastCost};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::optimise::candidate::{CostedChoice, ProfileCandidate, System, candidate_case};
use crate::quantum::probability::{PlannedState, Probabilities, WINDOW, amplification_rounds};
use crate::quantum::resources::Preparation;
use crate::quantum::walk::{PROFILE_PART, evolution_part};
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

    /// The number of modes `l ≥ 0` that `points` points have if they are given by hand.
    fn modes(&self) -> usize {
        self.points / 2 + 1
    }

    /// The series of all modes.
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
pub fn preparation(case: &Case, bounds: &Bounds, ratio: f64) -> Result<Preparation> {
    let case = planned_within(case);
    let outline = Outline::new(&case, bounds, ratio)?;
    Ok(of_outline(&outline, case.tolerance, ratio))
}

/// `case` with the tolerance to which its profile is planned.
fn planned_within(case: &Case) -> Case {
    Case { tolerance: PLANNED * case.tolerance, ..case.clone() }
}

/// The state of the plan `outline`, for an error `field_tolerance` of the field.
fn of_outline(outline: &Outline, field_tolerance: f64, ratio: f64) -> Preparation {
    let state_tolerance = field_tolerance / ratio;
    let series = match outline.profile.form() {
        ProfileForm::Transform(shape) => RegisterModes::new(outline).series(shape),
        ProfileForm::Series(series) => series.clone(),
    };
    let planned = outline.profile.to_string();
    Preparation { series, point: outline.point, state_tolerance, field_tolerance, planned }
}

/// A candidate whose number of modes is known, but no coefficient.
pub(super) struct PlannedCandidate {
    /// The case, with the tolerance that its profile is planned for.
    case: Case,
    outline: Outline,
}

impl PlannedCandidate {
    /// The plan of `candidate`.
    ///
    /// # Errors
    /// Why there is none, or why it is not compared.
    pub fn new(
        system: &System<'_>,
        candidate: &ProfileCandidate,
    ) -> std::result::Result<Self, String> {
        // Of no state there is nothing to plan.
        if let Some(why) = system.norms.no_start() {
            return Err(why.to_owned());
        }
        let case = planned_within(&candidate_case(system.case, system.bounds, candidate));
        let outline = Outline::new(&case, system.bounds, system.ratio);
        let outline = outline.map_err(|error| case.reason(&error))?;
        let too_many = |modes: f64| format!("{modes} modes; up to {MOST_MODES} are compared");
        // Coefficients of a profile with a corner may take long, and be of no use.
        if outline.modes > MOST_MODES as f64 {
            return Err(too_many(outline.modes));
        }
        if let ProfileForm::Transform(_) = outline.profile.form() {
            let modes = RegisterModes::new(&outline).modes();
            if modes > MOST_MODES + 1 {
                return Err(too_many(modes as f64));
            }
        }
        Ok(Self { case, outline })
    }

    /// A lower bound of the cost. It takes the norm of the first modes for the norm of the state,
    /// and a window without end.
    pub fn least_possible(&self, system: &System<'_>) -> f64 {
        /// Modes whose coefficients are computed: others add little to the norm.
        const FIRST: usize = 64;
        /// Round-off of the cost and of its bound.
        const ROUND_OFF: f64 = 1e-9;
        let Self { case, outline } = self;
        let ProfileForm::Transform(shape) = outline.profile.form() else { return 0.0 };
        let register = RegisterModes::new(outline);
        let first = PlannedState {
            bounds: system.bounds,
            series: &register.first(shape, FIRST),
            point: outline.point,
            state_tolerance: case.tolerance / system.ratio,
            time: case.duration(),
            points: register.points,
        };
        let most = first.most_probable(&system.norms);
        if !(most > 0.0 && most.is_finite()) {
            return 0.0;
        }
        let evolutions = (1.0 / most).min(2.0 * amplification_rounds(most) + 1.0);
        let evolutions = LabelledNumber::exact(evolutions);
        let demand = EvolutionRequirements {
            highest: TAU * (register.points / 2) as f64 / register.period,
            points: first.points,
            period: register.period,
            tolerance: LabelledNumber::exact(
                most.sqrt() * evolution_part(first.points > 1) * system.case.tolerance,
            ),
        };
        let least = system.accesses.least(&demand, &[evolutions.clone(), evolutions]);
        (1.0 - ROUND_OFF) * least.cost.least()
    }

    /// The cost of the candidate.
    fn priced(&self, system: &System<'_>, candidate: &ProfileCandidate) -> CostedChoice {
        let Self { case, outline } = self;
        let Preparation { series, point, state_tolerance, .. } =
            of_outline(outline, case.tolerance, system.ratio);
        let time = case.duration();
        let label =
            |x: f64| LabelledNumber::estimate(x, "norms of the classical solution, 3 digits");
        let points = points(&series).next_power_of_two();
        let bounds = system.bounds;
        let planned =
            PlannedState { bounds, series: &series, point, state_tolerance, time, points };
        let found = Probabilities::new(&planned, system.norms, &label);
        let delta = delta_of(system);
        let all = &found.nearest().all;
        if let (None, Some(because)) = (all.value(), all.because()) {
            return CostedChoice::unavailable(candidate, delta, because);
        }
        let demand = EvolutionRequirements {
            highest: series.wavenumber(series.modes() - 1),
            points,
            period: series.period,
            tolerance: found
                .amplitude()
                .times(&LabelledNumber::exact(evolution_part(points > 1) * system.case.tolerance)),
        };
        let LeastCost { cost, queries } = system.accesses.least(&demand, &found.evolutions());
        CostedChoice {
            recovery: LabelledNumber::exact(found.recovery),
            points: LabelledNumber::exact(found.points as f64),
            probability: [found.at_slice.all, found.in_window.all],
            demand: Some(demand),
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
    match PlannedCandidate::new(system, candidate) {
        Ok(planned) => planned.priced(system, candidate),
        Err(why) => CostedChoice::unavailable(candidate, delta_of(system), &why),
    }
}
