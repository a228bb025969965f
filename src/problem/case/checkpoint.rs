//! `[checkpoint]`: the time between checkpoints.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use serde::Deserialize;
use std::time::Duration;

/// `[checkpoint]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct CheckpointTable {
    minutes: Option<f64>,
}

impl CheckpointTable {
    /// Time between checkpoints; `None` if they are not made by the clock.
    pub fn check(&self, file: &CaseFile<'_>) -> Result<Option<Duration>> {
        const YEAR: f64 = 525_600.0;
        let minutes = self.minutes.unwrap_or(30.0);
        let minutes = file.within("checkpoint.minutes", minutes, 0.0..=YEAR, || {
            format!("must be from 0 (no checkpoints by the clock) to {YEAR}")
        })?;
        Ok((minutes > 0.0).then(|| Duration::from_secs_f64(60.0 * minutes)))
    }
}
