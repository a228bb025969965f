//! What is known of a result from which a run continues: its time, checksum and errors.

use serde::{Deserialize, Serialize};

/// Relative errors of the grid; `None` where they are not known.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct GridErrorPair {
    /// Of `f`, in L2.
    pub field: Option<f64>,
    /// Of the density, in L2; in L1 if particles showed it.
    pub density: Option<f64>,
}

impl GridErrorPair {
    /// The errors of `f` and of the density.
    pub fn both(self) -> [Option<f64>; 2] {
        [self.field, self.density]
    }
}

/// The properties of a result from which a run continues.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ResultOrigin {
    /// The checksum of `/f`.
    pub checksum: u64,
    /// Time of the result.
    pub time: f64,
    /// Relative l2 distance of its `f` to the semi-discrete solution, if known.
    pub error: Option<f64>,
    /// Its errors of the grid.
    pub grid_errors: GridErrorPair,
    /// Whether its `f` was limited to positive values.
    pub positive: bool,
    /// Whether its run, and those before it, had the data, `V` and inflow of the continued run
    /// since time 0.
    #[serde(default)]
    pub is_same_problem: bool,
}
