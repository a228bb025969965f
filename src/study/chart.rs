//! `phasewarp chart`: accuracy against cost, method by method.
//!
//! The methods are run on one case with a range of settings (`programme`) within a budget of time.
//! Each trial runs only if its expected time fits (`attempts`, [`crate::study::cost`]); every
//! method is tried once before any is varied. Each trial, run, refused or left out, is an `entry`.
//! From the entries follow Pareto fronts (`result`), sentences on which method to take (`verdict`),
//! files (`files`) and the figure (`picture`).
//!
//! There are two errors. The distance to the exact solution, if one is named, is mostly the error
//! of the grid. The distance to the exact solution of the semi-discrete system is that of the
//! method.

pub mod attempts;
pub mod entry;
pub mod files;
pub mod picture;
pub mod programme;
pub mod result;
pub mod setup;
pub mod verdict;

use crate::base::error::Result;
use crate::base::text::sentence;
use crate::base::version::GIT;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::World;
use crate::plan::here::refuse_too_large_here;
use crate::problem::case::Case;
use crate::results::accuracy::{STAIRCASE, hides_staircase};
use crate::study::budget::{Budget, BudgetClock, refuse_slow_grid};
use crate::study::chart::attempts::{Attempts, ComparedGrid};
use crate::study::chart::programme::Programme;
use crate::study::chart::result::{Chart, mark_fronts};
use crate::study::chart::verdict::sentences;
use crate::study::choices::DEGREES;
use crate::study::grids::{grid_name, of_degree, on_grid, stray_edges};
use crate::study::trial::refuse_start_from_file;
use std::time::Duration;

#[cfg(test)]
mod tests;

/// Runs the trials of `case` that fit into `limit`. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Input`] for a case that starts from a file, and if no trial fits
/// into `limit`; the first trial's error if nothing could be run.
pub fn measure(world: &World, case: &Case, limit: Duration) -> Result<Chart> {
    let budget =
        Budget::new(world, "chart (of its budget)", limit.as_secs_f64(), BudgetClock::Seconds);
    refuse_start_from_file(case, "the file fixes the grid, which a chart varies")?;
    refuse_too_large_here(world, case)?;
    refuse_slow_grid(world, case, limit.as_secs_f64())?;
    let jumps = Bounds::new(case)?.jumps;
    let stray = stray_edges(case);
    let treated = jumps && case.has_upwind_cells();
    let programme = Programme::new(case, treated, |space| {
        stray_edges(&on_grid(case, &space.elements())) <= stray
    });
    let (cases, left_out) = other_degrees(case);
    let programme = programme.with_degrees(&cases);
    let mut attempts = Attempts::new(world, case, &cases, jumps, budget);
    let ComparedGrid { space: compared, why_coarser } = attempts.run_programme(&programme)?;
    let exact = match case.fields.len() {
        1 => "f",
        _ => "density",
    };
    let mut chart = Chart {
        title: case.title.clone(),
        version: env!("CARGO_PKG_VERSION").to_owned(),
        git: GIT.to_owned(),
        ranks: world.group().size(),
        budget_seconds: limit.as_secs_f64(),
        took_seconds: attempts.elapsed(),
        exact: case.exact.as_ref().map(|_| exact.to_owned()),
        grid: grid_name(&case.space),
        compared_on: grid_name(&compared),
        compared_why: why_coarser,
        zero: attempts.zero == Some(true),
        sentences: Vec::new(),
        entries: attempts.entries,
    };
    mark_fronts(&mut chart.entries);
    chart.sentences = sentences(&chart);
    chart.sentences.extend(hides_staircase(case).then(|| format!("{}.", sentence(STAIRCASE))));
    chart.sentences.extend(left_out);
    Ok(chart)
}

/// The case with elements of other degrees, and the reason why higher degrees are missing, if they
/// are.
fn other_degrees(case: &Case) -> (Vec<Case>, Option<String>) {
    let others = DEGREES.filter(|degree| *degree != case.space.degree());
    let merged = vec![false; 2 * case.space.dimension()];
    let mut left_out = None;
    let found = others.filter_map(|degree| {
        let why = |error: &_| format!("Elements of degree {degree} and more: {error}.");
        let case = of_degree(case, degree, &merged);
        if let Err(error) = &case {
            left_out.get_or_insert_with(|| why(error));
        }
        case.ok()
    });
    (found.collect(), left_out)
}
