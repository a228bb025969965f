//! The settings that were chosen for the accuracy of a run, in a file beside its results.

use crate::base::disk;
use crate::base::error::Result;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Name of the file.
pub const NAME: &str = "accuracy.json";

/// The `--set` options chosen for an accuracy.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ChosenSetup {
    /// The accuracy.
    pub accuracy: f64,
    /// The relative L1 error of the density that the trials expect, if the file is of a version
    /// that stores it.
    #[serde(default)]
    pub expected_error: Option<f64>,
    /// Checksum of the case for which it was chosen: its text and its `--set` options.
    pub case: String,
    /// The chosen `--set` options.
    pub settings: Vec<String>,
}

impl ChosenSetup {
    /// The choice in `directory`, if a run wrote one there.
    pub fn read(directory: &Path) -> Option<Self> {
        serde_json::from_str(&disk::read_text(&directory.join(NAME)).ok()?).ok()
    }

    /// Writes it into `directory`, which is there. By one rank.
    ///
    /// # Errors
    /// As [`disk::write_json`].
    pub fn write(&self, directory: &Path) -> Result<()> {
        disk::write_json(&directory.join(NAME), self)
    }
}
