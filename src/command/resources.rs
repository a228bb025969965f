//! `phasewarp resources`: what the case takes on a quantum computer.

use crate::case::{Case, Method};
use crate::communicator::{Communicator, World};
use crate::error::{Error, Result};
use crate::partition::Block;
use crate::plan::{Bounds, Plan, Resources};
use crate::problem::Problem;
use crate::quantum::resources::Record;
use crate::run;

/// Assembles `case` on all ranks and counts. Collective.
///
/// # Errors
/// [`Error::Input`] for a classical case; as [`Problem::new`] and [`Plan::new`].
pub fn count(world: &World, case: &Case) -> Result<Record> {
    if case.method == Method::Classical {
        let what = "solver.method = \"classical\" has no quantum side; \"schrodingerized\" has";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    if case.varies() {
        let what =
            "inflow.value depends on t; the paper's counts are for a generator that does not";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    run::refuse_hopeless_here(world, case)?;
    let all = world.group();
    let here = Resources {
        ranks: all.size(),
        ranks_x: None,
        memory_per_rank: Some(run::memory_per_rank(&all)),
    };
    let bounds = Bounds::new(case)?;
    let expected = Plan::provisional(case, &bounds, &here)?;
    let (mesh, patience) = (&expected.layout.mesh, expected.patience());
    let communicator = Communicator::new(world, mesh);
    let block = Block::new(&case.space, mesh, communicator.space.rank());
    let mut problem = Problem::new(case, &bounds, &communicator, block, (1, patience))?;
    let bounds = problem.bounds(case, &bounds);
    let ratio = problem.probe(&communicator, bounds.rate, &case.legs());
    let plan = Plan::with_bounds(case, bounds.clone(), &here, ratio)?;
    let Some(warp) = &plan.warp else {
        return Err(Error::Input(format!(
            "{}: nothing is planned by modes",
            case.name
        )));
    };
    Record::new(case, (&bounds, warp), &problem, &communicator.space)
}
