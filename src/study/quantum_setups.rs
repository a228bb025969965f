//! The set-ups of a case on a quantum computer: profile, recovery point, `δ` and scheme, compared
//! by their cost.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::parallel::communicator::World;
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::quantum::optimise::candidate::{CostedChoice, System};
use crate::quantum::optimise::pricing::{PLANNED, planned_state};
use crate::quantum::optimise::ranking::Ranking;
use crate::quantum::optimise::{UNITS, choices, deltas};
use crate::quantum::planned_modes;
use crate::quantum::probability::PlannedState;
use crate::quantum::resources::settings::{PlannedSetUp, SetUpSettings};
use crate::quantum::resources::{ResourceCounts, SetupComparison, UnitaryCosts, accesses};
use crate::quantum::schemes::{scheme_of, unitary_of};
use crate::quantum::synthesis::RotationSynthesis;
use crate::solve::prepared::Prepared;
use crate::solve::system::{RoughSolution, StateNorms};
use crate::study::trial::with_delta;

/// Units of progress of a system.
const UNITS_OF_SYSTEM: usize = 4;

/// Progress of a search, and of `systems` systems beside it.
fn progress(world: &World, case: &Case, systems: usize) -> Progress {
    let of_search = deltas(case, 0.0).len() * (UNITS_OF_SYSTEM + UNITS);
    Progress::new(world.group().is_first(), "resources", of_search + systems * UNITS_OF_SYSTEM)
}

/// An assembled case and what is known of its solution.
pub(super) struct ProbedCase {
    pub prepared: Prepared,
    pub rough: RoughSolution,
}

impl ProbedCase {
    /// Collective.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    pub fn new(world: &World, case: &Case) -> Result<Self> {
        let mut prepared = Prepared::here(world, case)?;
        let rough = prepared.rough_solution();
        Ok(Self { prepared, rough })
    }
}

/// All choices for `case` in the order of their cost, the unitary scheme among them if the case has
/// one and does not use it already. Collective.
///
/// # Errors
/// As [`Prepared::new`].
pub fn ranked(world: &World, case: &Case, synthesis: RotationSynthesis) -> Result<Ranking> {
    let mut progress = progress(world, case, 1);
    let (Ranking(mut all), last) = optimised(world, case, synthesis, &mut progress)?;
    let ProbedCase { prepared: Prepared { bounds, .. }, rough } = last;
    let other =
        if bounds.is_skew() { None } else { unitary(world, case, rough.norms, synthesis).ok() };
    progress.finish();
    all.extend(other.and_then(|unitary| CostedChoice::unitary(&unitary.by_access.costs)));
    Ok(Ranking::new(all))
}

/// The counts of the cheapest set-up and of the case's own. Collective.
///
/// # Errors
/// As [`Prepared::new`], [`Prepared::plan_modes`], [`ResourceCounts::new`] and [`planned_state`].
pub fn compared(
    world: &World,
    case: &Case,
    synthesis: RotationSynthesis,
) -> Result<SetupComparison> {
    let mut progress = progress(world, case, 3);
    let ProbedCase { prepared, rough } = ProbedCase::new(world, case)?;
    let prepared = prepared.plan_modes(world, &Resources::here(world), rough.ratio)?;
    let warp = planned_modes(&case.name, &prepared.plan)?;
    let state = PlannedState::of_plan(warp, &prepared.bounds, case);
    let own = ResourceCounts::new(&prepared, state, rough.norms, synthesis)?;
    drop(prepared);
    progress.advance(UNITS_OF_SYSTEM);
    let (ranking, last) = optimised(world, case, synthesis, &mut progress)?;
    let (unitary, not_unitary) = match unitary(world, case, rough.norms, synthesis) {
        Ok(unitary) => (Some(unitary), None),
        Err(why) => (None, Some(case.reason(&why))),
    };
    progress.advance(UNITS_OF_SYSTEM);
    let first = ranking.first();
    let first = first.map(|choice| CountedChoice::new(world, choice, last, synthesis));
    let first = first.transpose()?;
    progress.finish();
    let of_own = SetupComparison {
        cheapest: own.clone(),
        cheapest_settings: None,
        own,
        unitary,
        not_unitary,
        cheapest_is_own: None,
        own_not_taken: None,
        not_compared: ranking.not_compared(),
    };
    Ok(cheaper(of_own, first))
}

/// The comparison `of_own`, whose cheapest set-up is the case's own, with the `first` choice unless
/// the case's own is cheaper.
fn cheaper(of_own: SetupComparison, first: Option<CountedChoice>) -> SetupComparison {
    let is_own = |of_own, why| SetupComparison { cheapest_is_own: Some(why), ..of_own };
    let Some(CountedChoice { counts, settings }) = first else {
        return is_own(of_own, "no other set-up could be priced".to_owned());
    };
    let [least, least_of_first] = [of_own.own.least_gates(), counts.least_gates()];
    let own_is_cheaper = least < least_of_first;
    let own_not_taken = of_own.own.not_comparable().filter(|_| own_is_cheaper);
    if own_is_cheaper && own_not_taken.is_none() {
        let why = format!("{least:.3e} gates, {least_of_first:.3e} by the cheapest choice");
        return is_own(of_own, why);
    }
    SetupComparison { cheapest: counts, cheapest_settings: Some(settings), own_not_taken, ..of_own }
}

/// The counts of a choice, and the settings that make it the case's own set-up.
struct CountedChoice {
    counts: ResourceCounts,
    settings: SetUpSettings,
}

impl CountedChoice {
    /// The counts of `choice`, for which the system `last` serves if it has the same `δ`.
    /// Collective.
    ///
    /// # Errors
    /// As [`Prepared::new`] and [`planned_state`].
    fn new(
        world: &World,
        choice: &CostedChoice,
        last: ProbedCase,
        synthesis: RotationSynthesis,
    ) -> Result<Self> {
        let ProbedCase { mut prepared, rough } = match choice.delta {
            Some(delta) if delta != last.prepared.case.warp.delta => {
                let case = with_delta(&last.prepared.case, delta);
                drop(last);
                ProbedCase::new(world, &case)?
            }
            _ => last,
        };
        prepared.case = choice.of(&prepared.case, &prepared.bounds);
        let state = planned_state(&prepared.case, &prepared.bounds, rough.ratio)?;
        let counts = ResourceCounts::new(&prepared, state, rough.norms, synthesis)?;
        let planned = PlannedSetUp {
            points: counts.points,
            period: counts.period,
            recovery: counts.probabilities.recovery,
            share: PLANNED,
            bin_bits: counts.by_access.rounding.as_ref().map(|rounding| rounding.bin_bits),
        };
        let settings = SetUpSettings::new(&prepared.case, &planned);
        Ok(Self { counts, settings })
    }
}

/// The unitary scheme on the grid of `case`, whose state at the start has the first of `norms`.
/// Collective.
///
/// # Errors
/// As [`unitary_of`]; as [`Prepared::new`].
fn unitary(
    world: &World,
    case: &Case,
    norms: StateNorms,
    synthesis: RotationSynthesis,
) -> Result<UnitaryCosts> {
    let prepared = Prepared::here(world, &unitary_of(case)?)?;
    let accesses = accesses(&prepared, 1.0, synthesis);
    Ok(UnitaryCosts::new(&accesses, case.tolerance, norms.no_start()))
}

/// Every choice of profile, parameter, recovery point and `δ`, the cheapest first, and the system
/// of the last `δ`. Collective.
///
/// # Errors
/// As [`Prepared::new`].
fn optimised(
    world: &World,
    case: &Case,
    synthesis: RotationSynthesis,
    progress: &mut Progress,
) -> Result<(Ranking, ProbedCase)> {
    let case = scheme_of(case);
    let mut all = Vec::new();
    let largest = if case.enters() { largest_inflow(world, &case)? } else { 0.0 };
    let mut last = None;
    for delta in deltas(&case, largest) {
        // Frees the system of the `δ` before.
        drop(last.take());
        let ProbedCase { prepared, rough } = ProbedCase::new(world, &with_delta(&case, delta))?;
        progress.advance(UNITS_OF_SYSTEM);
        let accesses = &accesses(&prepared, rough.ratio, synthesis);
        let system = System {
            world: Some(&world.group()),
            case: &prepared.case,
            bounds: &prepared.bounds,
            ratio: rough.ratio,
            norms: rough.norms,
            accesses,
        };
        all.extend(choices(&system, progress));
        last = Some(ProbedCase { prepared, rough });
    }
    let last = last.ok_or_else(|| Error::Input(format!("{}: no delta is tried", case.name)))?;
    Ok((Ranking::new(all), last))
}

/// The largest `|b|` over the rows of all ranks. Collective.
///
/// # Errors
/// As [`Prepared::new`].
fn largest_inflow(world: &World, case: &Case) -> Result<f64> {
    let prepared = Prepared::here(world, case)?;
    let inflow = prepared.system.matrix.inflow.iter();
    let largest = inflow.flat_map(|aux| aux.values).fold(0.0, |m: f64, b| m.max(b.abs()));
    Ok(prepared.communicator.space.max(largest))
}
