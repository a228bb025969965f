//! A case that is run for its numbers: in memory, in silence, and measured alone, though others ran before it.

use crate::base::error::Result;
use crate::base::machine;
use crate::matrix::observables::Moments;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::problem::case::Case;
use crate::results::dataset::ExactSolution;
use crate::results::summary::Summary;
use crate::run::{Computed, compute};
use std::ops::Range;

/// Steps of a run that only compare its result with others.
const COMPARISONS: [&str; 3] = ["exact", "verify", "readout"];

/// What a run gave.
pub struct Trial {
    /// The numbers, as a run writes them; `memory_peak_bytes_per_rank` is that of this run.
    pub summary: Summary,
    /// What was planned.
    pub plan: Plan,
    /// Seconds that the result took, without what it is compared with.
    pub seconds: f64,
    /// This rank's space cells, one range an x-axis; may be empty.
    pub share: Vec<Range<usize>>,
    /// Every field at `T` on them, velocities fastest.
    pub fields: Vec<Vec<f64>>,
    /// Moments there.
    pub moments: Moments,
    /// The exact solution there, where one is named.
    pub exact: Option<ExactSolution>,
}

/// Runs `case` without writing or saying anything. Collective over all ranks.
///
/// # Errors
/// As [`crate::run::run`], but for files.
pub fn trial(world: &World, case: &Case) -> Result<Trial> {
    machine::reset_peak_memory();
    let case = Case {
        warped_field: false,
        // What it is compared with has all of the grid.
        expand: true,
        ..case.clone()
    };
    let Computed {
        mut summary,
        plan,
        share,
        fields,
        exact,
        moments,
        watch,
        ..
    } = compute(world, &case, None)?;
    summary.finish(&world.group(), watch);
    let compared: f64 = (COMPARISONS.iter())
        .filter_map(|step| summary.seconds.get(*step))
        .sum();
    Ok(Trial {
        seconds: summary.wall_seconds - compared,
        summary,
        plan,
        share,
        fields,
        moments,
        exact,
    })
}
