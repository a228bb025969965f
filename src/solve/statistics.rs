//! Statistics of batches: changes of norms, applications, solves.

use crate::propagate::method::BatchReport;
use serde::{Deserialize, Serialize};

/// Statistics of the batches of a mode group so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BatchStatistics {
    /// Largest change of a norm, as a fraction of the allowed one; `None` if the method does not
    /// preserve norms.
    pub defect: Option<f64>,
    /// Smallest `‖w_l(T)‖/‖w_l(0)‖`; `None` if all states were zero.
    #[serde(rename = "kept")]
    pub least_norm_ratio: Option<f64>,
    /// Number of applications of the matrix.
    pub applications: usize,
    /// Number of linear systems solved.
    pub solves: usize,
}

impl BatchStatistics {
    /// Adds the work of a batch.
    pub(crate) fn took(&mut self, report: &BatchReport) {
        self.applications += report.applications;
        self.solves += report.solves;
    }

    /// Adds the statistics of another group.
    pub fn add(&mut self, other: &Self) {
        self.norms(other.least_norm_ratio, other.defect);
        self.applications += other.applications;
        self.solves += other.solves;
    }

    /// Adds the smallest ratio of norms and the largest defect of a batch.
    pub(crate) fn norms(&mut self, least_norm_ratio: Option<f64>, defect: Option<f64>) {
        self.least_norm_ratio =
            self.least_norm_ratio.into_iter().chain(least_norm_ratio).reduce(f64::min);
        self.defect = self.defect.into_iter().chain(defect).reduce(f64::max);
    }
}
