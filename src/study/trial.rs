//! Trials: runs of a case for its numbers only, in memory and without console output.

use crate::base::error::{Error, Result};
use crate::base::memory;
use crate::parallel::communicator::World;
use crate::problem::case::{
    Case, Coefficients, Delta, OutputSettings, Propagation, PropagatorMethod, Warp,
};
use crate::results::summary::Summary;
use crate::run::{Solution, solve};

/// Steps of a run that only compare its result with others.
const COMPARISONS: [&str; 3] = ["exact", "verify", "readout"];

/// Runs `case` without writing files or console output; `memory_peak_bytes_per_rank` is that of
/// this trial alone. Collective.
///
/// # Errors
/// As [`crate::run::solve`].
pub fn trial(world: &World, case: &Case) -> Result<Solution> {
    memory::reset_peak();
    // Comparisons need the values on the whole grid.
    let mut case = case.clone();
    case.output.expand = true;
    solve(world, &case)
}

/// Seconds of a trial without the comparisons with other results.
pub fn seconds_of_result(summary: &Summary) -> f64 {
    let compared: f64 = (COMPARISONS.iter()).filter_map(|step| summary.seconds.get(*step)).sum();
    summary.wall_seconds - compared
}

/// `case` with no output but the fields at its end.
pub fn final_fields_only(case: &Case) -> Case {
    let output = OutputSettings {
        plateau: None,
        at_start: None,
        times: Vec::new(),
        warped_field: false,
        ..case.output.clone()
    };
    Case { output, readout: None, ..case.clone() }
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

/// `case` with another coupling `δ` of the inflow.
pub fn with_delta(case: &Case, delta: Delta) -> Case {
    Case { warp: Warp { delta, ..case.warp.clone() }, ..case.clone() }
}

/// A propagator that takes `steps` equal steps over `duration`, or none.
pub fn propagation(duration: f64, method: PropagatorMethod, steps: Option<usize>) -> Propagation {
    Propagation { method, step: steps.map(|n| duration / n as f64) }
}
