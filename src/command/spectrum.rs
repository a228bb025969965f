//! `phasewarp spectrum`: both ends of the spectrum of `S`.

use crate::base::error::Result;
use crate::command::cli::SpectrumArgs;
use crate::command::loading::load;
use crate::command::printing::print_as;
use crate::parallel::communicator::World;
use crate::study::spectrum::MeasuredSpectra;

/// Measures the spectra of a case and prints them. Collective.
///
/// # Errors
/// As [`MeasuredSpectra::new`].
pub fn execute(world: &World, args: &SpectrumArgs) -> Result<()> {
    let case = load(world, &args.case)?;
    let found = MeasuredSpectra::new(world, &case, &args.refine, args.steps as usize)?;
    print_as(world, &found, args.json);
    Ok(())
}
