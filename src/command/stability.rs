//! `phasewarp stability`: measures, writes, and says what was found.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::study::stability;
use crate::study::stability::panel::{Name, Stability};
use std::path::Path;
use std::time::Duration;

/// The panels `only` of `case`, written into `directory`. Collective.
///
/// # Errors
/// As [`stability::measure`] and [`Stability::write`].
pub fn stability(
    world: &World,
    case: &Case,
    directory: &Path,
    (only, budget): (&[Name], Duration),
) -> Result<Stability> {
    let group = world.group();
    // Before it takes a minute: whether there is a place for what is found.
    let made = match group.rank() {
        0 => crate::base::disk::make(directory),
        _ => Ok(()),
    };
    group.agree(made)?;
    let found = stability::measure(world, case, only, budget)?;
    let written = match group.rank() {
        0 => found.write(directory),
        _ => Ok(()),
    };
    group.agree(written)?;
    Ok(found)
}
