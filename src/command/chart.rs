//! `phasewarp chart`: runs the trials, writes the files.

use crate::base::error::Result;
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::study::chart::measure;
use crate::study::chart::result::Chart;
use std::path::Path;
use std::time::Duration;

/// Makes the chart of `case` within `budget` and writes it into `directory`. Collective.
///
/// # Errors
/// As [`measure`]; [`crate::base::error::Error::Directory`], [`crate::base::error::Error::Output`] where it cannot be written.
pub fn chart(world: &World, case: &Case, budget: Duration, directory: &Path) -> Result<Chart> {
    let all = world.group();
    let writable = match all.rank() {
        0 => crate::base::disk::make(directory),
        _ => Ok(()),
    };
    all.agree(writable)?;
    let chart = measure(world, case, budget)?;
    let written = match all.rank() {
        0 => chart.write(directory),
        _ => Ok(()),
    };
    all.agree(written)?;
    Ok(chart)
}
