//! `phasewarp resources`: the cost of the case on a quantum computer.

use crate::base::error::{Error, Result};
use crate::base::table::{ColumnValues, csv, tabular};
use crate::command::cli::{RecordFormat, ResourcesArgs};
use crate::command::loading::load;
use crate::command::printing::{print, print_json, print_unwrapped};
use crate::parallel::communicator::World;
use crate::plan::here::refuse_too_large_here;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Delta, Method};
use crate::quantum::optimise::candidate::{CostedChoice, System};
use crate::quantum::optimise::pricing::preparation;
use crate::quantum::optimise::ranking::Ranking;
use crate::quantum::optimise::{choices, deltas, scheme_of, unitary_of};
use crate::quantum::planned_modes;
use crate::quantum::resources::{Comparison, Preparation, Record, Unitary, accesses};
use crate::quantum::synthesis::RotationSynthesis;
use crate::solve::prepared::Prepared;
use crate::solve::system::StateNorms;
use crate::study::end_to_end::EndToEnd;
use serde::Serialize;
use std::fmt::Display;

/// First line of a table in LaTeX.
const TEX_HEAD: &str = "% Written by phasewarp resources. x exact, g emitted gates (exact), \
                        b upper bound, m model or estimate";

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
        let Ranking(mut all) = optimise(world, &case, synthesis)?;
        // The unitary scheme, if the case has one and does not use it already.
        let other = unitary(world, &case, synthesis).ok().filter(|_| !case.is_unitary());
        let least = other.as_ref().and_then(Unitary::least);
        all.extend(least.map(CostedChoice::unitary));
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

/// The counts of the cheapest set-up and of the case's own. Collective.
///
/// # Errors
/// [`Error::Input`] for a classical case; as [`Prepared::new`], [`Prepared::plan_modes`] and
/// [`preparation`].
fn compare(world: &World, case: &Case, synthesis: RotationSynthesis) -> Result<Comparison> {
    has_counts(case)?;
    let mut prepared = prepare(world, case)?;
    let ratio = prepared.probe();
    let mut prepared = prepared.plan_modes(world, &Resources::here(world), ratio)?;
    let norms_of_own = norms(&mut prepared);
    let warp = planned_modes(case, &prepared.plan)?;
    let planned = Preparation::of_plan(warp, case.tolerance);
    let own = Record::new(&prepared, planned, norms_of_own, synthesis)?;
    drop(prepared);
    let ranking = optimise(world, case, synthesis)?;
    let (unitary, not_unitary) = match unitary(world, case, synthesis) {
        Ok(unitary) => (Some(unitary), None),
        Err(why) => (None, Some(case.reason(&why))),
    };
    let not_compared = ranking.not_compared();
    let Some(choice) = ranking.first() else {
        let cheapest_is_own = Some("no other set-up could be priced".to_owned());
        let cheapest = own.clone();
        return Ok(Comparison {
            cheapest,
            own,
            unitary,
            not_unitary,
            cheapest_is_own,
            own_not_taken: None,
            not_compared,
        });
    };
    let scheme = scheme_of(case);
    let mut prepared = match choice.delta {
        None => prepare(world, &scheme)?,
        Some(delta) => prepare(world, &with_delta(&scheme, delta))?,
    };
    let ratio = prepared.probe();
    let norms = norms(&mut prepared);
    prepared.case = choice.of(&prepared.case, &prepared.bounds);
    let planned = preparation(&prepared.case, &prepared.bounds, ratio)?;
    let found = Record::new(&prepared, planned, norms, synthesis)?;
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
        cheapest_is_own: taken.then_some(why),
        own_not_taken: refused.filter(|_| own_is_cheaper),
        own,
        unitary,
        not_unitary,
        not_compared,
    })
}

/// The unitary scheme on the grid of `case`. Collective.
///
/// # Errors
/// As [`unitary_of`]; as [`Prepared::new`].
fn unitary(world: &World, case: &Case, synthesis: RotationSynthesis) -> Result<Unitary> {
    let prepared = prepare(world, &unitary_of(case)?)?;
    Ok(Unitary::new(&accesses(&prepared, 1.0, synthesis), case.tolerance))
}

/// Every choice of profile, parameter, recovery point and `δ`, the cheapest first. Collective.
///
/// # Errors
/// As [`Prepared::new`].
fn optimise(world: &World, case: &Case, synthesis: RotationSynthesis) -> Result<Ranking> {
    let case = scheme_of(case);
    let mut all = Vec::new();
    let largest = if case.enters() { largest_inflow(world, &case)? } else { 0.0 };
    for delta in deltas(&case, largest) {
        let case = with_delta(&case, delta);
        let mut prepared = prepare(world, &case)?;
        let ratio = prepared.probe();
        let norms = norms(&mut prepared);
        let accesses = &accesses(&prepared, ratio, synthesis);
        all.extend(choices(&System {
            world: Some(&world.group()),
            case: &prepared.case,
            bounds: &prepared.bounds,
            ratio,
            norms,
            accesses,
        }));
    }
    Ok(Ranking::new(all))
}

/// The largest `|b|` over the rows of all ranks. Collective.
///
/// # Errors
/// As [`Prepared::new`].
fn largest_inflow(world: &World, case: &Case) -> Result<f64> {
    let prepared = prepare(world, case)?;
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

fn prepare(world: &World, case: &Case) -> Result<Prepared> {
    refuse_too_large_here(world, case)?;
    Prepared::new(world, case, &Resources::here(world))
}

/// Norms of the first field. Collective.
pub(super) fn norms(prepared: &mut Prepared) -> StateNorms {
    let Prepared { system, communicator, bounds, case, .. } = prepared;
    system.rough_norms(communicator, bounds, case.duration())
}
