//! What a run writes while it solves, and what it finds.

use crate::results::dataset::Early;
use crate::run::checkpointing::Checkpointing;
use std::collections::BTreeMap;
use std::path::Path;

/// What a run writes while it solves.
pub(crate) struct Files<'a> {
    /// Where warped fields are written.
    pub directory: &'a Path,
    /// Seconds by step so far, for their attributes.
    pub seconds: &'a BTreeMap<String, f64>,
    /// Program, commit, libraries, for their attributes.
    pub provenance: &'a [(String, String)],
    /// Checkpoints of a run by modes.
    pub checkpointing: Option<&'a mut Checkpointing>,
}

/// What either method finds, on this rank's share.
pub(crate) struct Found {
    /// Every field at `T` by each reading: `[field][reading]`.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// The first field by each reading of the plateau.
    pub plateau: Vec<Vec<f64>>,
    /// `ũ`, or sums for the moments, at the end of each leg but the last: `[field][leg]`.
    pub early: Vec<Vec<Vec<f64>>>,
    /// Seconds that went into the files of warped fields.
    pub warped_seconds: f64,
    /// What the user should know of the start.
    pub warning: Option<String>,
}

/// What was solved for, on this rank's share.
pub(crate) struct SolvedFields {
    /// Every field at `T` by each reading: `[field][reading]`.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// The first field by each reading of the plateau.
    pub plateau: Vec<Vec<f64>>,
    /// Moments and fields at the output times before the end.
    pub early: Vec<Early>,
    /// Seconds that went into the files of warped fields.
    pub warped_seconds: f64,
    /// What the user should know of the start.
    pub warning: Option<String>,
}
