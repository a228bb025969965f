//! Solves the semi-discrete system, by modes or classically, for the fields at `T` and at the
//! output times before.

use crate::base::error::Result;
use crate::results::summary::Summary;
use crate::run::files::{RunFiles, SolvedFields};
use crate::run::{classical, modes};
use crate::solve::prepared::Prepared;

/// Computes every field at `T` and at the output times before, by the plan of `prepared`. Counts go
/// into `summary`. There is no console output without `files`. Collective.
///
/// # Errors
/// As [`crate::solve::modes::run`]; files that cannot be written or read.
pub(crate) fn solve(
    prepared: &mut Prepared,
    files: Option<&mut RunFiles<'_>>,
    summary: &mut Summary,
) -> Result<SolvedFields> {
    match prepared.plan.warp {
        Some(_) => modes::by_modes(prepared, files, summary),
        None => classical::integrate_fields(prepared, files.is_some(), summary),
    }
}
