//! `phasewarp export-quantum`: what a simulator of quantum computers takes of a tiny case.

use crate::case::Case;
use crate::communicator::{Communicator, World};
use crate::error::{Error, Result};
use crate::partition::{Block, Mesh};
use crate::plan::{Bounds, Plan, Resources};
use crate::problem::Problem;
use crate::quantum::export::{Description, Export, refuse};
use std::path::Path;

/// Exports `case` into `directory`: every rank has the whole of it, the first one writes. Collective.
///
/// # Errors
/// As [`refuse`], [`Problem::new`], [`Plan::new`], [`Export::new`] and [`Export::write`].
pub fn export(world: &World, case: &Case, directory: &Path) -> Result<Description> {
    refuse(case)?;
    crate::run::refuse_hopeless_here(world, case)?;
    let all = world.group();
    let blocks = vec![1; case.space.dimension()];
    let here = Resources {
        ranks: all.size(),
        ranks_x: Some(blocks.clone()),
        memory_per_rank: Some(crate::run::memory_per_rank(&all)),
    };
    let mesh = Mesh {
        space: blocks,
        groups: all.size(),
    };
    let bounds = Bounds::new(case)?;
    let patience = Plan::provisional(case, &bounds, &here)?.patience();
    let communicator = Communicator::new(world, &mesh);
    let block = Block::new(&case.space, &mesh, 0);
    let width = size_of::<crate::matrix::Lanes>() / 8;
    let mut problem = Problem::new(case, &bounds, &communicator, block, (width, patience))?;
    let bounds = problem.bounds(case, &bounds);
    let ratio = problem.probe(&communicator, bounds.rate, &case.legs());
    let plan = Plan::with_bounds(case, bounds.clone(), &here, ratio)?;
    let Some(warp) = &plan.warp else {
        let what = "nothing is planned by modes";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    };
    let exported = Export::new(case, (&bounds, warp), &mut problem, &communicator);
    let exported = all.agree(exported)?;
    let written = if all.rank() == 0 {
        exported.write(directory)
    } else {
        Ok(())
    };
    all.agree(written)?;
    Ok(exported.description().clone())
}
