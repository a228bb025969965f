//! `phasewarp export-quantum`: what a simulator of quantum computers takes of a tiny case.

use crate::base::error::{Error, Result};
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::plan::here::{memory_per_rank, refuse_hopeless_here};
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::quantum::export::{Description, Export, refuse};
use crate::run::assembled::Assembled;
use std::path::Path;

/// Exports `case` into `directory`: every rank has the whole of it, the first one writes. Collective.
///
/// # Errors
/// As [`refuse`], [`Assembled::new`], [`Plan::new`], [`Export::new`] and [`Export::write`].
pub fn export(world: &World, case: &Case, directory: &Path) -> Result<Description> {
    refuse(case)?;
    refuse_hopeless_here(world, case)?;
    let all = world.group();
    let here = Resources {
        ranks: all.size(),
        ranks_x: Some(vec![1; case.space.dimension()]),
        memory_per_rank: Some(memory_per_rank(&all)),
    };
    let width = size_of::<crate::matrix::lanes::Lanes>() / 8;
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
