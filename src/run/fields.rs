//! Solves the semi-discrete system, by modes or classically, for the fields at `T` and at the
//! output times before.

use crate::base::error::Result;
use crate::results::summary::Summary;
use crate::run::files::SolveOutput;
use crate::run::solved::SolvedFields;
use crate::run::{classical, modes};
use crate::solve::prepared::Prepared;

/// Computes every field at `T` and at the output times before, by the plan of `prepared`. Counts go
/// into `summary`. Collective.
///
/// # Errors
/// As [`crate::solve::modes::run`]; files that cannot be written or read.
pub(crate) fn solve(
    prepared: &mut Prepared,
    output: &mut SolveOutput<'_>,
    summary: &mut Summary,
) -> Result<SolvedFields> {
    match modes::by_modes(prepared, output, summary)? {
        Some(solved) => Ok(solved),
        None => classical::integrate_fields(prepared, output.prints, summary),
    }
}

/// Computes the fields as [`solve`] does, without output. Collective.
///
/// # Errors
/// As [`crate::solve::modes::run`].
pub(crate) fn solve_silently(prepared: &mut Prepared) -> Result<SolvedFields> {
    solve(prepared, &mut SolveOutput::default(), &mut Summary::default())
}
