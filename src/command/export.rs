//! `phasewarp export-quantum`: what a simulator of quantum computers takes of a tiny case.

use crate::case::Case;
use crate::communicator::World;
use crate::error::{Error, Result};
use crate::plan::{Bounds, Plan, Resources};
use crate::quantum::export::{Description, Export, refuse};
use crate::run::{self, Assembled};
use std::path::Path;

/// Exports `case` into `directory`: every rank has the whole of it, the first one writes. Collective.
///
/// # Errors
/// As [`refuse`], [`Assembled::new`], [`Plan::new`], [`Export::new`] and [`Export::write`].
pub fn export(world: &World, case: &Case, directory: &Path) -> Result<Description> {
    refuse(case)?;
    run::refuse_hopeless_here(world, case)?;
    let all = world.group();
    let here = Resources {
        ranks: all.size(),
        ranks_x: Some(vec![1; case.space.dimension()]),
        memory_per_rank: Some(run::memory_per_rank(&all)),
    };
    let width = size_of::<crate::matrix::Lanes>() / 8;
    let mut system = Assembled::new(world, case, &Bounds::new(case)?, (&here, width))?;
    let plan = Plan::with_bounds(case, system.bounds.clone(), &here, system.ratio)?;
    let Some(warp) = &plan.warp else {
        let what = "nothing is planned by modes";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    };
    let (bounds, problem) = (&system.bounds, &mut system.problem);
    let exported = Export::new(case, (bounds, warp), problem, &system.communicator);
    let exported = all.agree(exported)?;
    let written = if all.rank() == 0 {
        exported.write(directory)
    } else {
        Ok(())
    };
    all.agree(written)?;
    Ok(exported.description().clone())
}
