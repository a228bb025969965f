//! `phasewarp chart`: accuracy against cost, method by method.

use crate::base::error::Result;
use crate::command::cli::ChartArgs;
use crate::command::loading::{load, make_study_directory};
use crate::command::printing::print;
use crate::parallel::communicator::World;
use crate::problem::exported::{ExportKind, ExportOwner};
use crate::study::chart::measure;

/// Measures the case, writes the files and prints what was found. Collective.
///
/// # Errors
/// As `make_study_directory` and [`measure`]; [`crate::base::error::Error::Directory`] and
/// [`crate::base::error::Error::Output`] where files cannot be written.
pub fn execute(world: &World, args: &ChartArgs) -> Result<()> {
    let (all, case) = (world.group(), load(world, &args.case)?);
    let owner = ExportOwner::new(ExportKind::Chart, &case.settings);
    let output = args.output.as_ref();
    let directory = make_study_directory(world, output, &owner, &case.name, args.force)?;
    let chart = measure(world, &case, args.budget)?;
    all.on_first_rank(|| chart.write(&directory, &owner))?;
    print(world, &chart.to_string());
    print(world, &format!("files in {}", directory.display()));
    Ok(())
}
