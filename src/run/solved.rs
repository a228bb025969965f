//! The fields that a run solves for.

use crate::results::dataset::EarlyResult;

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
