//! The result from which a run continued, and the errors that it passes on.

use crate::base::text::GRID_ERROR;
use crate::results::accuracy::{Accuracy, GridErrorPair};
use serde::{Deserialize, Serialize};

/// The result from which a run continued (`initial.field`), and the error of both parts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ContinuedResult {
    /// Path of the file from which the run continued.
    pub file: String,
    /// Checksum of its `/f`, as result files write it.
    pub checksum: String,
    /// The time of that result, at which the run began.
    pub time: f64,
    /// Relative l2 distance of its `f` to the semi-discrete solution since time 0, if known.
    pub error: Option<f64>,
    /// Bound on the effect of that error at the end, relative to the result at the end.
    pub error_inherited: Option<f64>,
    /// The inherited error plus the run's own, which is measured, or else estimated if that is
    /// reliable.
    pub error_total: Option<f64>,
    /// The grid's errors of that result: that of `f` relative to `f` at the end of the run, which
    /// is as large as it if nothing enters or leaves.
    #[serde(default)]
    pub grid: GridErrorPair,
}

impl ContinuedResult {
    /// Whether the grid's error of the run is unknown, as that of the first part is.
    pub fn leaves_grid_unknown(&self, accuracy: &Accuracy) -> bool {
        self.grid == GridErrorPair::default() && !accuracy.grid_measured
    }

    /// The errors of the earlier parts as text, for the closing line.
    pub fn line(&self) -> String {
        let begin = self.time;
        let of_algorithm = match (self.error_inherited, self.error_total) {
            (Some(inherited), Some(total)) => format!(
                "error since t = 0: at most {total:.1e}, of which {inherited:.1e} are inherited \
                 from before t = {begin}"
            ),
            (Some(inherited), None) => {
                format!("error inherited from before t = {begin}: at most {inherited:.1e}")
            }
            (None, _) => format!(
                "error inherited from before t = {begin}: not known, and not part of any estimate"
            ),
        };
        if self.grid != GridErrorPair::default() {
            return of_algorithm;
        }
        format!(
            "{of_algorithm}; {GRID_ERROR} before t = {begin}: not known, and not part of any \
             estimate"
        )
    }
}
