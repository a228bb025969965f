//! `phasewarp resources`: the cost of the case on a quantum computer.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::base::table::{ColumnValues, csv, tabular};
use crate::command::cli::{RecordFormat, ResourcesArgs};
use crate::command::loading::load;
use crate::command::printing::{print, print_json, print_unwrapped};
use crate::parallel::communicator::World;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Delta, Method};
use crate::quantum::optimise::candidate::{CostedChoice, System};
use crate::quantum::optimise::pricing::{PLANNED, preparation};
use crate::quantum::optimise::ranking::Ranking;
use crate::quantum::optimise::{UNITS, choices, deltas, scheme_of, unitary_of};
use crate::quantum::planned_modes;
use crate::quantum::resources::settings::{PlannedSetUp, SetUpSettings};
use crate::quantum::resources::{Comparison, Preparation, Record, Unitary, accesses};
use crate::quantum::synthesis::RotationSynthesis;
use crate::solve::prepared::Prepared;
use crate::solve::system::{RoughSolution, StateNorms};
use crate::study::end_to_end::EndToEnd;
use serde::Serialize;
use std::fmt::Display;

/// First line of a table in LaTeX.
const TEX_HEAD: &str = "% Written by phasewarp resources. x exact, g emitted gates (exact), \
                        b upper bound, m model or estimate";

/// Units of progress of a system.
const UNITS_OF_SYSTEM: usize = 4;

/// Prints the counts of the cheapest set-up and of the case's own; with `--optimise` a ranking of
/// choices, with `--accuracy` the cost from end to end. Collective.
///
/// # Errors
/// As `compare`, `optimise` and [`EndToEnd::new`]; [`Error::Input`] for `--optimise` or
/// `--accuracy` in a format that holds one choice.
pub fn execute(world: &World, args: &ResourcesArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let many = if args.optimise { "--optimise" } else { "--accuracy" };
    let one = matches!(args.format, RecordFormat::Azure | RecordFormat::Qref);
    if one && (args.optimise || args.accuracy.is_some()) {
        return Err(Error::Input(format!(
            "{many} compares many choices: --format text, json, csv and latex show them; azure and \
             qref hold only one"
        )));
    }
    let synthesis = args.t_of_rotation;
    if let Some(accuracy) = args.accuracy {
        has_counts(&case)?;
        let found = EndToEnd::new(world, &case, accuracy, synthesis)?;
        show(world, args.format, &found, EndToEnd::columns);
        return Ok(());
    }
    if args.optimise {
        has_counts(&case)?;
        let mut progress = progress(world, &case, 1);
        let RankedSystem { ranking: Ranking(mut all), last } =
            optimise(world, &case, synthesis, &mut progress)?;
        let ProbedCase { prepared: Prepared { bounds, .. }, rough } = last;
        // The unitary scheme, if the case has one and does not use it already.
        let other = match bounds.is_skew() {
            true => None,
            false => unitary(world, &case, rough.norms, synthesis).ok(),
        };
        progress.finish();
        all.extend(other.and_then(|unitary| CostedChoice::unitary(&unitary.costs)));
        show(world, args.format, &Ranking::new(all), Ranking::columns);
        return Ok(());
    }
    let found = compare(world, &case, synthesis)?;
    match args.format {
        RecordFormat::Azure => print_json(world, &found.cheapest.logical_counts()),
        RecordFormat::Qref => print_json(world, &found.cheapest.qref()),
        format => show(world, format, &found, |found| found.costs().columns()),
    }
    Ok(())
}

/// Prints `found` as text or JSON, or its table.
fn show<T: Serialize + Display>(
    world: &World,
    format: RecordFormat,
    found: &T,
    columns: impl Fn(&T) -> Vec<ColumnValues>,
) {
    match format {
        RecordFormat::Csv => print_unwrapped(world, &csv(&columns(found))),
        RecordFormat::Latex => {
            let table = tabular(&columns(found), |_| String::new());
            print_unwrapped(world, &format!("{TEX_HEAD}\n{table}"));
        }
        RecordFormat::Json => print_json(world, found),
        RecordFormat::Text | RecordFormat::Azure | RecordFormat::Qref => {
            print(world, &found.to_string());
        }
    }
}

/// Progress of a search, and of `systems` systems beside it.
fn progress(world: &World, case: &Case, systems: usize) -> Progress {
    let of_search = deltas(case, 0.0).len() * (UNITS_OF_SYSTEM + UNITS);
    Progress::new(world.group().rank() == 0, "resources", of_search + systems * UNITS_OF_SYSTEM)
}

/// An assembled case and what is known of its solution.
struct ProbedCase {
    prepared: Prepared,
    rough: RoughSolution,
}

impl ProbedCase {
    /// Collective.
    ///
    /// # Errors
    /// As [`Prepared::new`].
    fn new(world: &World, case: &Case) -> Result<Self> {
        let mut prepared = Prepared::here(world, case)?;
        let rough = prepared.rough_solution();
        Ok(Self { prepared, rough })
    }
}

/// Every choice that was priced.
struct RankedSystem {
    ranking: Ranking,
    /// The system of the last `δ`.
    last: ProbedCase,
}

/// The counts of the cheapest set-up and of the case's own. Collective.
///
/// # Errors
/// [`Error::Input`] for a classical case; as [`Prepared::new`], [`Prepared::plan_modes`] and
/// [`preparation`].
fn compare(world: &World, case: &Case, synthesis: RotationSynthesis) -> Result<Comparison> {
    has_counts(case)?;
    let mut progress = progress(world, case, 3);
    let ProbedCase { prepared, rough } = ProbedCase::new(world, case)?;
    let prepared = prepared.plan_modes(world, &Resources::here(world), rough.ratio)?;
    let warp = planned_modes(&case.name, &prepared.plan)?;
    let planned = Preparation::of_plan(warp, case.warp.share * case.tolerance);
    let own = Record::new(&prepared, planned, rough.norms, synthesis)?;
    drop(prepared);
    progress.advance(UNITS_OF_SYSTEM);
    let RankedSystem { ranking, last } = optimise(world, case, synthesis, &mut progress)?;
    let (unitary, not_unitary) = match unitary(world, case, rough.norms, synthesis) {
        Ok(unitary) => (Some(unitary), None),
        Err(why) => (None, Some(case.reason(&why))),
    };
    progress.advance(UNITS_OF_SYSTEM);
    let comparison = Comparison {
        cheapest: own.clone(),
        cheapest_settings: None,
        own,
        unitary,
        not_unitary,
        cheapest_is_own: None,
        own_not_taken: None,
        not_compared: ranking.not_compared(),
    };
    let Some(choice) = ranking.first() else {
        progress.finish();
        let cheapest_is_own = Some("no other set-up could be priced".to_owned());
        return Ok(Comparison { cheapest_is_own, ..comparison });
    };
    let (found, settings) = record_of(world, choice, last, synthesis)?;
    progress.finish();
    let own = &comparison.own;
    let own_is_cheaper = own.least_gates() < found.least_gates();
    let refused = own.not_comparable();
    let taken = own_is_cheaper && refused.is_none();
    let why = format!(
        "{:.3e} gates, {:.3e} by the cheapest choice",
        own.least_gates(),
        found.least_gates()
    );
    Ok(Comparison {
        cheapest: if taken { own.clone() } else { found },
        cheapest_settings: (!taken).then_some(settings),
        cheapest_is_own: taken.then_some(why),
        own_not_taken: refused.filter(|_| own_is_cheaper),
        ..comparison
    })
}

/// The counts of `choice`, for which the system `last` serves if it has the same `δ`, and its
/// settings. Collective.
///
/// # Errors
/// As [`Prepared::new`] and [`preparation`].
fn record_of(
    world: &World,
    choice: &CostedChoice,
    last: ProbedCase,
    synthesis: RotationSynthesis,
) -> Result<(Record, SetUpSettings)> {
    let ProbedCase { mut prepared, rough } = match choice.delta {
        Some(delta) if delta != last.prepared.case.warp.delta => {
            let case = with_delta(&last.prepared.case, delta);
            drop(last);
            ProbedCase::new(world, &case)?
        }
        _ => last,
    };
    prepared.case = choice.of(&prepared.case, &prepared.bounds);
    let planned = preparation(&prepared.case, &prepared.bounds, rough.ratio)?;
    let record = Record::new(&prepared, planned, rough.norms, synthesis)?;
    let planned = PlannedSetUp {
        points: record.points,
        period: record.period,
        recovery: record.probabilities.recovery,
        share: PLANNED,
        bin_bits: record.rounding.as_ref().map(|rounding| rounding.bin_bits),
    };
    let settings = SetUpSettings::new(&prepared.case, &planned);
    Ok((record, settings))
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
) -> Result<Unitary> {
    let prepared = Prepared::here(world, &unitary_of(case)?)?;
    let accesses = accesses(&prepared, 1.0, synthesis);
    Ok(Unitary::new(&accesses, case.tolerance, norms.no_start()))
}

/// Every choice of profile, parameter, recovery point and `δ`, the cheapest first. Collective.
///
/// # Errors
/// As [`Prepared::new`].
fn optimise(
    world: &World,
    case: &Case,
    synthesis: RotationSynthesis,
    progress: &mut Progress,
) -> Result<RankedSystem> {
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
    Ok(RankedSystem { ranking: Ranking::new(all), last })
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

/// `case` with another `δ`.
fn with_delta(case: &Case, delta: Delta) -> Case {
    let mut case = case.clone();
    case.warp.delta = delta;
    case
}

/// Refuses cases to which the paper's counts do not apply.
pub(super) fn has_counts(case: &Case) -> Result<()> {
    if case.method == Method::Classical {
        let what = "solver.method = \"classical\" has no quantum algorithm; choose \
                    \"schrodingerized\"";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    if case.varies() {
        let what = "depends on t; the paper's counts hold for a generator that does not";
        let what = format!("{} {what}", case.inflow_key());
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    if let Some(start) = &case.start {
        let what = "the counts hold for an initial state u(0) g(p), and a file may hold any other; \
                    give initial.f";
        return Err(Error::Input(format!("{}: {what}", start.place)));
    }
    Ok(())
}
