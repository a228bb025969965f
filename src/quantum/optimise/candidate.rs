//! A choice of profile, `δ` and recovery point with its cost, and the system that it is for.

use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Coefficients, Delta, ProfileChoice, RecoveryMethod, Shift};
use crate::quantum::cost::{Access, Accesses, Cost, EvolutionRequirements};
use crate::quantum::labelled_number::LabelledNumber;
use crate::quantum::probability::amplification_rounds;
use crate::quantum::walk::OracleQueries;
use crate::solve::system::StateNorms;
use serde::Serialize;

/// A choice and its cost.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CostedChoice {
    /// The profile.
    pub profile: ProfileChoice,
    /// Whether this is the unitary scheme, beside a case that has another.
    pub unitary_scheme: bool,
    /// `δ`; `None` without inflow.
    pub delta: Option<Delta>,
    /// `p◇`.
    pub recovery: LabelledNumber,
    /// `N_p`.
    pub points: LabelledNumber,
    /// The access to `H`; `None` if the cost is not known.
    pub access: Option<Access>,
    /// Calls of the block encoding in an evolution, by the sequence whose rotations are computed.
    pub steps: LabelledNumber,
    /// Calls of the block encoding in an evolution, by the sequence of about half as many.
    pub half_calls_steps: LabelledNumber,
    /// Calls of the block encoding in an evolution, by the cheaper sequence.
    pub walk_steps: LabelledNumber,
    /// Whether the cheaper sequence is the one of half as many calls; `None` if the cost is not
    /// known.
    pub half_calls: Option<bool>,
    /// Probabilities that all conditions are met, of the slice and of the window.
    pub probability: [LabelledNumber; 2],
    /// Gates, in Toffoli gates, until the field is measured in the window, or in the slice where
    /// there is none: repeated, and by amplitude amplification. The sequence is the cheaper one.
    pub cost: [LabelledNumber; 2],
    /// The fewer gates of the two, by the sequence whose rotations are computed, with the same
    /// access.
    pub gates_until_measured_2k: LabelledNumber,
    /// Calls of the oracles by sparse access, whatever access takes the fewest gates.
    #[serde(flatten)]
    pub queries: OracleQueries,
    /// The time and accuracy of the evolution; `None` if they are not known.
    #[serde(skip)]
    pub requirements: Option<EvolutionRequirements>,
    /// The profile and the recovery point, as settings of a case.
    #[serde(skip)]
    pub(super) candidate: ProfileCandidate,
}

impl CostedChoice {
    /// The choice of a candidate that cannot be planned; `why` is the reason.
    pub(super) fn unavailable(
        candidate: &ProfileCandidate,
        delta: Option<Delta>,
        why: &str,
    ) -> Self {
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
            gates_until_measured_2k: none(),
            queries: OracleQueries::unavailable(why),
            requirements: None,
        }
    }

    /// `candidate` at this cost. The state and the evolution are left open.
    pub(super) fn at_cost(
        candidate: &ProfileCandidate,
        delta: Option<Delta>,
        cost: &Cost,
        queries: OracleQueries,
    ) -> Self {
        Self {
            access: Some(cost.access),
            steps: cost.evolution.steps.clone(),
            half_calls_steps: cost.half_calls.steps.clone(),
            walk_steps: cost.cheaper().steps.clone(),
            half_calls: Some(cost.cheaper() == &cost.half_calls),
            cost: cost.cheaper().gates_until_measured.clone(),
            gates_until_measured_2k: cost.gates_until_measured_2k.clone(),
            queries,
            ..Self::unavailable(candidate, delta, "")
        }
    }

    /// The unitary scheme with these accesses: one mode, which is the field. `None` without access.
    pub fn unitary(costs: &[Cost]) -> Option<Self> {
        let one = || LabelledNumber::exact(1.0);
        let cost = Cost::least_of(costs)?;
        let planned = ProfileCandidate::planned(ProfileChoice::Planned);
        if let Some(why) = cost.measured().why_not() {
            return Some(Self { unitary_scheme: true, ..Self::unavailable(&planned, None, why) });
        }
        let queries = costs.iter().find_map(|cost| cost.queries.clone())?;
        Some(Self {
            unitary_scheme: true,
            recovery: LabelledNumber::exact(0.0),
            points: one(),
            probability: [one(), LabelledNumber::unavailable("one mode has no register of p")],
            ..Self::at_cost(&planned, None, cost, queries)
        })
    }

    /// The probability of the window, or of the slice where there is none.
    pub fn nearest(&self) -> &LabelledNumber {
        let [slice, window] = &self.probability;
        if window.value().is_some() { window } else { slice }
    }

    /// Rounds of amplitude amplification; `None` if the probability is not known.
    pub(super) fn rounds(&self) -> Option<f64> {
        self.nearest().value().map(amplification_rounds)
    }

    /// Gates until the field is measured, repeated or amplified, whichever is fewer.
    pub fn measured(&self) -> &LabelledNumber {
        LabelledNumber::lower_of(&self.cost)
    }

    /// Why the choice cannot be planned; `None` if it can.
    pub fn why_not(&self) -> Option<&str> {
        self.recovery.why_not()
    }

    pub(super) fn cheaper(self, other: Self) -> Self {
        if other.least_cost() < self.least_cost() { other } else { self }
    }

    /// Gates until the field is measured, repeated or amplified, whichever is fewer; infinite where
    /// there is no number.
    pub fn least_cost(&self) -> f64 {
        LabelledNumber::least(&self.cost)
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
    /// The ranks that share the work, if there are others.
    pub world: Option<&'a Group>,
    /// The case with that `δ`.
    pub case: &'a Case,
    /// Bounds of the case.
    pub bounds: &'a Bounds,
    /// The ratio `‖u(0)‖/‖f(T)‖` that is planned for.
    pub ratio: f64,
    /// The norms from which the probabilities follow.
    pub norms: StateNorms,
    /// The data from which the costs follow.
    pub accesses: &'a Accesses,
}

/// A profile with its recovery point: how far the field is read beyond the first point where the
/// profile is `e^{−p}`. `None` leaves that to the plan.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ProfileCandidate {
    pub profile: ProfileChoice,
    pub beyond_edge: Option<f64>,
    /// The value of the parameter in the scan; 0 for defaults.
    pub value: f64,
}

impl ProfileCandidate {
    /// A profile as it is planned.
    pub fn planned(profile: ProfileChoice) -> Self {
        Self { profile, beyond_edge: None, value: 0.0 }
    }
}

/// `case` with a candidate, without settings given by hand. It has one reading: a second one only
/// estimates the error of an emulation.
pub(super) fn candidate_case(case: &Case, bounds: &Bounds, candidate: &ProfileCandidate) -> Case {
    let mut case = case.clone();
    let growth = bounds.growth * case.duration();
    let shift = case.warp.shift.of(bounds.growth) * case.duration();
    let warp = &mut case.warp;
    (warp.profile, warp.share) = (candidate.profile.clone(), 1.0);
    (warp.interval, warp.points) = (None, None);
    warp.recovery =
        candidate.beyond_edge.map(|beyond_edge| (growth - shift).max(0.0) + beyond_edge);
    (warp.coefficients, warp.recovery_method) = (Coefficients::Analytic, RecoveryMethod::Point);
    if candidate.profile == ProfileChoice::Planned {
        // A single mode has no other recovery point.
        warp.shift = Shift::Given(0.0);
    }
    (case.output.recovery_points, case.output.plateau, case.output.warped_field) = (1, None, false);
    case
}
