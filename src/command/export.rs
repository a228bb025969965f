//! `phasewarp export-quantum`: what a simulator of quantum computers takes of a tiny case.

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::quantum::export::{Description, Export, refuse};
use crate::solve::prepared::Prepared;
use std::path::Path;

/// Exports `case` into `directory`: every rank has the whole of it, the first one writes. Collective.
///
/// # Errors
/// As [`refuse`], [`Prepared::new`], [`Plan::new`], [`Export::new`] and [`Export::write`].
pub fn export(world: &World, case: &Case, directory: &Path) -> Result<Description> {
    refuse(case)?;
    refuse_hopeless_here(world, case)?;
    let all = world.group();
    let here =
        Resources { ranks_x: Some(vec![1; case.space.dimension()]), ..Resources::here(world) };
    let mut prepared = Prepared::new(world, case, &here)?;
    let ratio = prepared.probe();
    prepared.plan_modes(&here, ratio)?;
    let Some(warp) = &prepared.plan.warp else {
        let what = "nothing is planned by modes";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    };
    let planned = (&prepared.bounds, warp);
    let exported = Export::new(case, planned, &mut prepared.system, &prepared.communicator);
    let exported = all.agree(exported)?;
    let written = if all.rank() == 0 { exported.write(directory) } else { Ok(()) };
    all.agree(written)?;
    Ok(exported.description().clone())
}
