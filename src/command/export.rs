//! `phasewarp export-quantum`: a tiny case for a quantum simulator.

use crate::base::error::Result;
use crate::base::log::report;
use crate::command::cli::ExportArgs;
use crate::command::loading::{default_directory, load};
use crate::command::printing::print;
use crate::parallel::communicator::World;
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::quantum::export::{Description, Export, refuse};
use crate::solve::prepared::Prepared;
use std::path::Path;

/// Exports the case and prints its qubits and probability. Collective.
///
/// # Errors
/// As `export`.
pub fn execute(world: &World, args: &ExportArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let directory =
        args.output.clone().unwrap_or_else(|| default_directory(&case.name).join("quantum"));
    let description = export(world, &case, &directory)?;
    if let Some(why) = &description.preparation
        && world.group().rank() == 0
    {
        report(&format!("warning: no preparation.qasm: {why}"));
    }
    let probability = description.probability_p * description.probability_field_given_p;
    let line = format!(
        "{} qubits ({} of p); read at p = {:.4} with probability {probability:.4e}; files in {}",
        description.qubits,
        description.qubits_p,
        description.recovery,
        directory.display()
    );
    print(world, &line);
    Ok(())
}

/// Exports `case` into `directory`: every rank has the whole of it, the first one writes.
/// Collective.
///
/// # Errors
/// As [`refuse`], [`Prepared::new`], [`Prepared::plan_modes`], [`Export::new`] and
/// [`Export::write`].
fn export(world: &World, case: &Case, directory: &Path) -> Result<Description> {
    refuse(case)?;
    refuse_hopeless_here(world, case)?;
    let all = world.group();
    let here =
        Resources { ranks_x: Some(vec![1; case.space.dimension()]), ..Resources::here(world) };
    let mut prepared = Prepared::new(world, case, &here)?;
    let ratio = prepared.probe();
    prepared.plan_modes(&here, ratio)?;
    let exported = all.agree(Export::new(&mut prepared))?;
    all.on_first_rank(|| exported.write(directory))?;
    Ok(exported.description().clone())
}
