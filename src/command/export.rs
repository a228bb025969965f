//! `phasewarp export-quantum` and `export-matrix`: a case for other programs.

use crate::base::error::Result;
use crate::base::log::report;
use crate::base::text::{rounded, short};
use crate::command::cli::ExportArgs;
use crate::command::loading::{default_directory, load};
use crate::command::printing::print;
use crate::parallel::communicator::World;
use crate::plan::here::refuse_hopeless_here;
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::quantum::export::{Description, Export};
use crate::quantum::matrices::MatrixCounts;
use crate::quantum::{export, matrices};
use crate::solve::prepared::Prepared;
use std::path::{Path, PathBuf};

/// Exports the circuit of a tiny case and prints its qubits and probability. Collective.
///
/// # Errors
/// As [`export::refuse`], [`Prepared::new`], [`Prepared::plan_modes`], [`Export::new`] and
/// [`Export::write`].
pub fn quantum(world: &World, args: &ExportArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let directory = output(args, &case, "quantum");
    let description = export_quantum(world, &case, &directory)?;
    if let Some(why) = &description.preparation
        && world.group().rank() == 0
    {
        report(&format!("warning: no preparation.qasm: {why}"));
    }
    let probability = description.probability_p * description.probability_field_given_p;
    let line = format!(
        "{} qubits ({} of p); read at p = {} with probability {}; files in {}",
        description.qubits,
        description.qubits_p,
        short(rounded(description.recovery, 1.0)),
        short(probability),
        directory.display()
    );
    print(world, &line);
    Ok(())
}

/// Exports the matrices of a case and prints how large they are. Collective.
///
/// # Errors
/// As [`matrices::refuse`], [`Prepared::new`] and [`matrices::export`].
pub fn matrix(world: &World, args: &ExportArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let directory = output(args, &case, "matrix");
    matrices::refuse(&case)?;
    let (prepared, _) = assembled(world, &case)?;
    let written = world.group().on_first_rank(|| matrices::export(&prepared, &directory))?;
    let MatrixCounts { cells, unknowns, entries } = written;
    let line = format!(
        "A: {cells} rows, {entries} entries; S, K: {unknowns} rows; files in {}",
        directory.display()
    );
    print(world, &line);
    Ok(())
}

/// Where the files go: where the user says, or `results/NAME/kind`.
fn output(args: &ExportArgs, case: &Case, kind: &str) -> PathBuf {
    args.output.clone().unwrap_or_else(|| default_directory(&case.name).join(kind))
}

/// `case` with the whole of it on every rank, and those ranks. Collective.
fn assembled(world: &World, case: &Case) -> Result<(Prepared, Resources)> {
    refuse_hopeless_here(world, case)?;
    let here =
        Resources { ranks_x: Some(vec![1; case.space.dimension()]), ..Resources::here(world) };
    Ok((Prepared::new(world, case, &here)?, here))
}

/// Exports `case` into `directory`: the first rank writes. Collective.
fn export_quantum(world: &World, case: &Case, directory: &Path) -> Result<Description> {
    export::refuse(case)?;
    let all = world.group();
    let (mut prepared, here) = assembled(world, case)?;
    let ratio = prepared.probe();
    let mut prepared = prepared.plan_modes(world, &here, ratio)?;
    let exported = all.agree(Export::new(&mut prepared))?;
    all.on_first_rank(|| exported.write(directory))?;
    Ok(exported.description().clone())
}
