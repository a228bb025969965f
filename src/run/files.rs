//! The files that a run writes while it solves, and the fields that it solves for.

use crate::results::dataset::EarlyResult;
use crate::run::checkpointing::Checkpointing;
use std::collections::BTreeMap;
use std::path::Path;

/// The directory of the files of warped fields, and the attributes of these files.
pub(crate) struct WarpedOutput<'a> {
    /// The directory of the results.
    pub directory: &'a Path,
    /// Seconds by step so far.
    pub seconds: &'a BTreeMap<String, f64>,
    /// Program, commit, libraries.
    pub provenance: &'a [(String, String)],
    /// Seconds spent writing these files.
    pub writing_seconds: f64,
}

/// The files that a run writes while it solves.
pub(crate) struct RunFiles<'a> {
    /// Warped fields.
    pub warped: WarpedOutput<'a>,
    /// Checkpoints of a run by modes.
    pub checkpointing: Option<&'a mut Checkpointing>,
}

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
