//! The driver of one run: ten steps, which `compute` calls in order (see `steps`).
//!
//! ```text
//! start → reduce → prepare → exact → open → observe start → solve → compare → expand → finish
//! ```
//!
//! [`run()`] takes these steps and writes the results. [`solve`] works in memory, without console
//! output, and returns a [`Solution`].
//!
//! Uses: results, quantum, solve, and every room below. Paper: the runs of section 8.

mod at_start;
mod checkpointing;
pub mod classical;
pub mod compare;
pub mod errors;
mod estimates;
pub mod exact;
pub mod expand;
pub mod fields;
mod files;
mod history;
pub mod ledger;
mod log;
mod modes;
pub mod norms;
pub mod options;
mod particles;
pub mod planning;
mod positive;
mod readout;
pub mod solution;
mod solved;
mod steps;
mod summarise;
pub mod unresolved;
mod vanishing;
pub mod warnings;

use crate::base::error::{Error, Result};
use crate::parallel::communicator::World;
use crate::problem::case::Case;
use crate::results::finished;
use crate::results::summary::Summary;
use crate::run::options::{Options, Output};
use crate::run::planning::with_files_read;
pub use crate::run::solution::Solution;
use crate::run::steps::{Driver, StepResults};
use std::path::Path;

/// Runs a case and writes its results into `directory`. Collective over all ranks.
///
/// # Errors
/// The first error of any rank, the same on all; [`Error::Stopped`] if the run
/// stopped early and can be resumed; [`Error::FinishedByOthers`] if another process finished it.
pub fn run(world: &World, given: &Case, directory: &Path, options: &Options) -> Result<Summary> {
    if !options.force {
        finished::refuse_to_replace(&world.group(), directory, given, options.resume)?;
    }
    let case = &*with_files_read(&world.group(), given)?;
    let output = Output { given, directory, options };
    compute(world, case, Some(output))?.write_prepared(world, directory)
}

/// As [`finished::is_done`]. What a kill left of the checkpoints of a finished run is removed,
/// unless another run is at work in the directory. Collective.
pub fn is_done_removing_rest(
    world: &World,
    directory: &Path,
    case: &Case,
    warning: impl Fn(&Error) -> String,
) -> bool {
    let is_done = finished::is_done(&world.group(), directory, case, warning);
    if is_done && world.group().is_first() {
        checkpointing::remove_rest(directory);
    }
    is_done
}

/// Solves a case in memory, without console output, files or checkpoints. No particles are
/// followed, and the estimates of the grid's error do not contain what the ledger knows. Collective
/// over all ranks.
///
/// # Errors
/// The first error of any rank, the same on all.
pub fn solve(world: &World, case: &Case) -> Result<Solution> {
    let mut case = with_files_read(&world.group(), case)?.into_owned();
    // Only `run` writes these files, while the modes are in memory.
    case.output.warped_field = false;
    let mut solution = compute(world, &case, None)?;
    solution.summary.finish(&world.group(), &solution.log.watch);
    Ok(solution)
}

/// Runs a case in memory. Only a run with `output` prints, keeps checkpoints and writes warped
/// fields. Collective over all ranks.
///
/// # Errors
/// As [`run()`].
fn compute(world: &World, case: &Case, output: Option<Output<'_>>) -> Result<Solution> {
    let mut driver = Driver::start(world, output);
    let reduced = driver.reduce(case)?;
    let mut planned = driver.prepare(&reduced)?;
    let exact = driver.exact(&reduced, &planned)?;
    let mut checkpointing = driver.open(&planned)?;
    let mut start = driver.observe_start(&reduced, &mut planned)?;
    let solution = driver.solve(&mut planned, &mut start, checkpointing.as_mut())?;
    let compared = driver.compare(&mut planned, &solution)?;
    let results = driver.expand(&reduced, &planned, &exact, solution)?;
    Ok(driver.finish(StepResults {
        reduced,
        planned,
        exact,
        checkpointing,
        start,
        compared,
        results,
    }))
}
