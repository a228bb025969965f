//! Trials: runs of a case for its numbers only, in memory and without console output.

use crate::base::error::{Error, Result};
use crate::base::memory;
use crate::matrix::observables::Moments;
use crate::parallel::communicator::World;
use crate::plan::Plan;
use crate::problem::case::{Case, Coefficients, Delta, Propagation, PropagatorMethod, Warp};
use crate::results::summary::Summary;
use crate::run::{Solution, solve};
use std::ops::Range;

/// Steps of a run that only compare its result with others.
const COMPARISONS: [&str; 3] = ["exact", "verify", "readout"];

/// The result of a trial.
pub struct Trial {
    /// The summary of the run; `memory_peak_bytes_per_rank` is that of this trial alone.
    pub summary: Summary,
    /// The plan of the run.
    pub plan: Plan,
    /// Seconds without the comparisons with other results.
    pub seconds: f64,
    /// Space cells of this rank, one range for each x-axis; may be empty.
    pub share: Vec<Range<usize>>,
    /// Every field at `T` on these cells, with velocities fastest.
    pub fields: Vec<Vec<f64>>,
    /// Moments on these cells.
    pub moments: Moments,
}

/// Runs `case` without writing files or console output. Collective.
///
/// # Errors
/// As [`crate::run::solve`].
pub fn trial(world: &World, case: &Case) -> Result<Trial> {
    memory::reset_peak();
    let case = Case {
        // Comparisons need the values on the whole grid.
        expand: true,
        ..case.clone()
    };
    let Solution { summary, plan, share, results, .. } = solve(world, &case)?;
    let compared: f64 = (COMPARISONS.iter()).filter_map(|step| summary.seconds.get(*step)).sum();
    Ok(Trial {
        seconds: summary.wall_seconds - compared,
        summary,
        plan,
        share,
        fields: results.fields,
        moments: results.moments,
    })
}

/// `case` with no output but the fields at its end.
pub fn final_fields_only(case: &Case) -> Case {
    Case {
        plateau: None,
        readout: None,
        output_at_start: None,
        times: Vec::new(),
        warped_field: false,
        ..case.clone()
    }
}

/// Refuses a case that starts from a file, for the reason `why`.
///
/// # Errors
/// [`Error::Input`] with the place of the key, the reason, and what to give instead.
pub fn refuse_start_from_file(case: &Case, why: &str) -> Result<()> {
    let warped = case.warped_start.as_ref().map(|start| (&start.place, "give initial.f"));
    let field = case.start_field.as_ref();
    let field = field.map(|start| (&start.place, "leave it out, with time.start"));
    match warped.or(field) {
        Some((place, instead)) => Err(Error::Input(format!("{place}: {why}; {instead}"))),
        None => Ok(()),
    }
}

/// Removes the settings of the series in `p`, so that interval, points, recovery point,
/// coefficients and the scale of the inflow are planned.
pub fn plan_series(warp: &mut Warp) {
    (warp.interval, warp.points, warp.recovery) = (None, None, None);
    (warp.coefficients, warp.delta) = (Coefficients::Analytic, Delta::Planned);
}

/// A propagator that takes `steps` equal steps over `duration`, or none.
pub fn propagation(duration: f64, method: PropagatorMethod, steps: Option<usize>) -> Propagation {
    Propagation { method, step: steps.map(|n| duration / n as f64) }
}
