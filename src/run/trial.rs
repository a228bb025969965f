//! A case that is run for its numbers: in memory, in silence, and measured alone, though others ran before it.

use super::{Computed, compute};
use crate::case::Case;
use crate::communicator::World;
use crate::error::Result;
use crate::observables::Moments;
use crate::output::hdf5::ExactSolution;
use crate::output::summary::Summary;
use crate::plan::Plan;
use crate::system;
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
/// As [`super::run`], but for files.
pub fn trial(world: &World, case: &Case) -> Result<Trial> {
    system::reset_peak_memory();
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
