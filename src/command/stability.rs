//! `phasewarp stability`: limits beyond which methods fail, measured beside theory.

use crate::base::error::Result;
use crate::command::cli::StabilityArgs;
use crate::command::loading::{load, study_directory};
use crate::command::printing::print;
use crate::parallel::communicator::World;
use crate::study::stability;

/// Measures the panels, writes the files and prints the table. Collective.
///
/// # Errors
/// As [`stability::measure`] and [`stability::panel::Stability::write`].
pub fn execute(world: &World, args: &StabilityArgs) -> Result<()> {
    let (all, case) = (world.group(), load(world, &args.case)?);
    let directory = study_directory(world, args.output.as_ref(), &case.name, "stability")?;
    let found = stability::measure(world, &case, &args.only, args.budget)?;
    all.on_first_rank(|| found.write(&directory))?;
    print(world, &found.to_string());
    print(world, &format!("files in {}", directory.display()));
    Ok(())
}
