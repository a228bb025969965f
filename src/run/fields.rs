//! Solves the semi-discrete system, by modes or classically, for the fields at `T` and at the
//! output times before.

use crate::base::error::Result;
use crate::results::dataset::EarlyResult;
use crate::results::summary::Summary;
use crate::run::files::SolveOutput;
use crate::run::{classical, modes};
use crate::solve::prepared::Prepared;

/// The fields that either method solves for, on this rank's share.
pub(crate) struct SolvedFields {
    /// The fields at `T` by each reading: `[field][reading]`.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// The first field by each reading of the plateau.
    pub plateau: Vec<Vec<f64>>,
    /// Moments and fields at the output times before the end.
    pub early: Vec<EarlyResult>,
    /// A warning about the modes that the run started from.
    pub warning: Option<String>,
}

/// The state `ũ` at the end of each leg but the last, or its sums over velocities if only moments
/// are wanted: `[field][leg]`.
pub(crate) type EarlyStates = Vec<Vec<Vec<f64>>>;

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
