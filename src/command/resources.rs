//! `phasewarp resources`: what the case takes on a quantum computer.

use crate::base::error::{Error, Result};
use crate::command::cli::{RecordFormat, ResourcesArgs};
use crate::command::loading::load;
use crate::command::printing::{print, print_as, print_json};
use crate::parallel::communicator::World;
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Method};
use crate::quantum::access::largest_parts;
use crate::quantum::optimise::{Ranking, System, choices, deltas};
use crate::quantum::resources::Record;
use crate::solve::prepared::Prepared;
use crate::solve::system::StateNorms;

/// Counts for the case as it is, or ranks choices for it; prints what was found. Collective.
///
/// # Errors
/// As `count`; [`Error::Input`] for `--optimise` in a format that holds one choice.
pub fn execute(world: &World, args: &ResourcesArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    if args.optimise {
        if matches!(args.format, RecordFormat::Azure | RecordFormat::Qref) {
            let what = "--optimise compares many choices: --format text and json show them, \
                        azure and qref hold one";
            return Err(Error::Input(what.to_owned()));
        }
        print_as(world, &optimise(world, &case)?, args.format == RecordFormat::Json);
        return Ok(());
    }
    let record = count(world, &case)?;
    match args.format {
        RecordFormat::Text => print(world, &record.to_string()),
        RecordFormat::Json => print_json(world, &record),
        RecordFormat::Azure => print_json(world, &record.logical_counts()),
        RecordFormat::Qref => print_json(world, &record.qref()),
    }
    Ok(())
}

/// Assembles `case` on all ranks and counts. Collective.
///
/// # Errors
/// [`Error::Input`] for a classical case; as [`Prepared::new`] and [`Prepared::plan_modes`].
fn count(world: &World, case: &Case) -> Result<Record> {
    has_counts(case)?;
    let mut prepared = prepare(world, case)?;
    let ratio = prepared.probe();
    prepared.plan_modes(&Resources::here(world), ratio)?;
    let norms = norms(&mut prepared);
    Record::new(&prepared, norms)
}

/// Every choice of profile, recovery point and `δ`, the cheapest first. Collective.
///
/// # Errors
/// As [`count`].
fn optimise(world: &World, case: &Case) -> Result<Ranking> {
    has_counts(case)?;
    let mut all = Vec::new();
    let own = prepare(world, case)?;
    let inflow = own.system.matrix.inflow.iter();
    let largest = inflow.flat_map(|aux| aux.values).fold(0.0, |m: f64, b| m.max(b.abs()));
    let largest = own.communicator.space.max(largest);
    drop(own);
    for delta in deltas(case, largest) {
        let mut case = case.clone();
        case.warp.delta = delta;
        let mut prepared = prepare(world, &case)?;
        let ratio = prepared.probe();
        let norms = norms(&mut prepared);
        let (s, k, nonzeros) = largest_parts(&prepared.system.matrix);
        let space = &prepared.communicator.space;
        all.extend(choices(&System {
            case: &case,
            bounds: &prepared.bounds,
            ratio,
            norms,
            matrix: (space.max(s), space.max(k), space.max_count(nonzeros)),
        }));
    }
    Ok(Ranking::new(all))
}

/// Refuses what the paper's counts are not for.
fn has_counts(case: &Case) -> Result<()> {
    if case.method == Method::Classical {
        let what = "solver.method = \"classical\" has no quantum side; \"schrodingerized\" has";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    if case.varies() {
        let what =
            "inflow.value depends on t; the paper's counts are for a generator that does not";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    if let Some(start) = &case.start {
        let what = "the counts are for a start u(0) g(p), and a file holds any; give initial.f";
        return Err(Error::Input(format!("{}: {what}", start.place)));
    }
    Ok(())
}

fn prepare(world: &World, case: &Case) -> Result<Prepared> {
    refuse_hopeless_here(world, case)?;
    Prepared::new(world, case, &Resources::here(world))
}

/// Norms of the first field. Collective.
fn norms(prepared: &mut Prepared) -> StateNorms {
    let Prepared { system, communicator, bounds, case, .. } = prepared;
    system.rough_norms(communicator, bounds, case.duration())
}
