//! `phasewarp stability`: limits beyond which methods fail, measured beside theory.

use crate::base::error::Result;
use crate::command::cli::StabilityArgs;
use crate::command::loading::{load, make_study_directory};
use crate::command::printing::print;
use crate::parallel::communicator::World;
use crate::problem::exported::{ExportKind, ExportOwner};
use crate::study::stability;

/// Measures the panels, writes the files and prints the table. Collective.
///
/// # Errors
/// As `make_study_directory`, [`stability::measure`] and [`stability::panel::Stability::write`].
pub fn execute(world: &World, args: &StabilityArgs) -> Result<()> {
    let (all, case) = (world.group(), load(world, &args.case)?);
    let owner = ExportOwner::new(ExportKind::Stability, &case.settings);
    let output = args.output.as_ref();
    let directory = make_study_directory(world, output, &owner, &case.name, args.force)?;
    let found = stability::measure(world, &case, &args.only, args.budget)?;
    all.on_first_rank(|| found.write(&directory, &owner))?;
    print(world, &found.to_string());
    print(world, &format!("files in {}", directory.display()));
    Ok(())
}
