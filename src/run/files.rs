//! What a run prints and writes while it solves.

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

/// What a run prints and writes while it solves; by default nothing.
#[derive(Default)]
pub(crate) struct SolveOutput<'a> {
    /// Whether this rank prints the progress.
    pub prints: bool,
    /// Warped fields, if the run writes files.
    pub warped: Option<WarpedOutput<'a>>,
    /// Checkpoints of a run by modes.
    pub checkpointing: Option<&'a mut Checkpointing>,
}
