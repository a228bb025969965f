//! `[time]`: the times at which the run begins and ends.

use crate::base::error::Result;
use crate::problem::case::file::CaseFile;
use crate::problem::limits::LARGEST_NUMBER;
use serde::Deserialize;
use std::ops::Range;

/// `[time]` as it is written.
#[derive(Debug, Default, Deserialize)]
pub struct TimeTable {
    #[serde(default)]
    start: f64,
    end: Option<f64>,
}

impl TimeTable {
    /// The times at which the run begins and ends.
    pub fn check(&self, file: &CaseFile<'_>) -> Result<Range<f64>> {
        let end = file.required("time.end", self.end, "a number")?;
        let least = 1.0 / LARGEST_NUMBER;
        file.within("time.end", end, least..=LARGEST_NUMBER, || {
            format!("must be above 0, between {least:e} and {LARGEST_NUMBER:e}")
        })?;
        let start = file.within("time.start", self.start, 0.0..=LARGEST_NUMBER, || {
            format!("must be from 0 to {LARGEST_NUMBER:e}")
        })?;
        if end - start < least.max(SHORTEST * end) {
            let message = format!("must be below time.end = {end}, by {SHORTEST:e} of it at least");
            return file.refuse("time.start", message);
        }
        if start > 0.0 && !file.has("initial.field") {
            let message = "initial.f is f(0); a later start needs initial.field, a file with f at \
                           that time";
            return file.refuse("time.start", message);
        }
        Ok(start..end)
    }
}

/// Least duration of a run relative to its final time, so that their difference has digits.
const SHORTEST: f64 = 1e-6;
