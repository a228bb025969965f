//! What a run writes while it solves, and what it finds.

use crate::results::dataset::Early;
use crate::run::checkpointing::Checkpointing;
use std::collections::BTreeMap;
use std::path::Path;

/// Where warped fields are written, and their attributes.
#[derive(Clone, Copy)]
pub(crate) struct WarpedOutput<'a> {
    /// The directory of the results.
    pub directory: &'a Path,
    /// Seconds by step so far.
    pub seconds: &'a BTreeMap<String, f64>,
    /// Program, commit, libraries.
    pub provenance: &'a [(String, String)],
}

/// What a run writes while it solves.
pub(crate) struct Files<'a> {
    /// Warped fields.
    pub warped: WarpedOutput<'a>,
    /// Checkpoints of a run by modes.
    pub checkpointing: Option<&'a mut Checkpointing>,
}

/// What either method finds, on this rank's share; the `History` of the output times before the end
/// is [`Unread`] at first, then a list of [`Early`].
pub(crate) struct Found<History> {
    /// Every field at `T` by each reading: `[field][reading]`.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// The first field by each reading of the plateau.
    pub plateau: Vec<Vec<f64>>,
    /// What is known at the output times before the end.
    pub early: History,
    /// Seconds that went into the files of warped fields.
    pub warped_seconds: f64,
    /// What the user should know of the start.
    pub warning: Option<String>,
}

/// `ũ`, or sums for the moments, at the end of each leg but the last: `[field][leg]`.
pub(crate) type Unread = Vec<Vec<Vec<f64>>>;

/// The fields that were solved for, with moments and fields at the output times before the end.
pub(crate) type SolvedFields = Found<Vec<Early>>;
