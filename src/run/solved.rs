//! The fields that a run solves for.

use crate::results::dataset::EarlyResult;
use crate::solve::field_readings::FieldReadings;

/// The fields that either method solves for, on this rank's share.
pub(crate) struct SolvedFields {
    /// The fields at `T`.
    pub fields: Vec<FieldReadings>,
    /// The first field by each reading of the plateau.
    pub plateau: Vec<Vec<f64>>,
    /// Moments and fields at the output times before the end.
    pub early: Vec<EarlyResult>,
    /// A warning about the modes that the run started from.
    pub warning: Option<String>,
}

impl SolvedFields {
    /// The first field at `T`.
    pub fn first_field(&self) -> &[f64] {
        self.fields[0].first()
    }
}
