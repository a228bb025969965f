//! `phasewarp resources`: what the case takes on a quantum computer.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::here::{memory_per_rank, refuse_hopeless_here};
use crate::plan::layout::Resources;
use crate::problem::case::{Case, Method};
use crate::quantum::access::largest_parts;
use crate::quantum::optimise::{Ranking, System, choices, deltas};
use crate::quantum::resources::Record;
use crate::run::assembled::Assembled;
use crate::solve::system::Norms;

/// Assembles `case` on all ranks and counts. Collective.
///
/// # Errors
/// [`Error::Input`] for a classical case; as [`Assembled::new`] and [`Plan::new`].
pub fn count(world: &World, case: &Case) -> Result<Record> {
    has_counts(case)?;
    let mut system = assembled(world, case)?;
    let plan = Plan::with_bounds(case, system.bounds.clone(), &here(world), system.ratio)?;
    let Some(warp) = &plan.warp else {
        return Err(Error::Input(format!(
            "{}: nothing is planned by modes",
            case.name
        )));
    };
    let norms = norms(&mut system, case);
    let problem = (&system.problem, norms);
    Record::new(
        case,
        (&system.bounds, warp),
        problem,
        &system.communicator.space,
    )
}

/// Every choice of profile, recovery point and `δ`, the cheapest first. Collective.
///
/// # Errors
/// As [`count`].
pub fn optimise(world: &World, case: &Case) -> Result<Ranking> {
    has_counts(case)?;
    let mut all = Vec::new();
    let own = assembled(world, case)?;
    let inflow = own.problem.matrix.inflow.iter();
    let largest = inflow
        .flat_map(|aux| aux.values)
        .fold(0.0, |m: f64, b| m.max(b.abs()));
    let largest = own.communicator.space.max(largest);
    drop(own);
    for delta in deltas(case, largest) {
        let mut case = case.clone();
        case.warp.delta = delta;
        let mut system = assembled(world, &case)?;
        let norms = norms(&mut system, &case);
        let (s, k, nonzeros) = largest_parts(&system.problem.matrix);
        let space = &system.communicator.space;
        all.extend(choices(&System {
            case: &case,
            bounds: &system.bounds,
            ratio: system.ratio,
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

/// What a plan of this machine's ranks may take.
fn here(world: &World) -> Resources {
    let all = world.group();
    Resources {
        ranks: all.size(),
        ranks_x: None,
        memory_per_rank: Some(memory_per_rank(&all)),
    }
}

fn assembled(world: &World, case: &Case) -> Result<Assembled> {
    refuse_hopeless_here(world, case)?;
    Assembled::new(world, case, &Bounds::new(case)?, (&here(world), 1))
}

/// Norms of the first field. Collective.
fn norms(system: &mut Assembled, case: &Case) -> Norms {
    let rate = system.bounds.rate;
    (system.problem).rough_norms(&system.communicator, rate, case.end)
}
