//! Statistics of batches: norms kept, applications, solves.

use crate::propagate::method::BatchReport;
use serde::{Deserialize, Serialize};

/// Statistics of the batches of a mode group so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct BatchStatistics {
    /// Largest change of a norm, as a fraction of the allowed one; none where the method does not
    /// keep norms.
    pub defect: Option<f64>,
    /// Smallest `‖w_l(T)‖/‖w_l(0)‖`; none where no state was but zero.
    pub kept: Option<f64>,
    /// Applications.
    pub applications: usize,
    /// Linear systems solved.
    pub solves: usize,
}

impl BatchStatistics {
    /// The smallest ratio of norms of a batch, infinite where there is none, and the largest
    /// defect.
    pub(crate) fn norms(&mut self, ratio: f64, defect: Option<f64>) {
        self.join(Some(ratio).filter(|r| r.is_finite()), defect);
    }

    /// The work of a batch.
    pub(crate) fn took(&mut self, report: &BatchReport) {
        self.applications += report.applications;
        self.solves += report.solves;
    }

    /// Adds those of another group.
    pub fn add(&mut self, other: &Self) {
        self.join(other.kept, other.defect);
        self.applications += other.applications;
        self.solves += other.solves;
    }

    fn join(&mut self, kept: Option<f64>, defect: Option<f64>) {
        self.kept = self.kept.into_iter().chain(kept).reduce(f64::min);
        self.defect = self.defect.into_iter().chain(defect).reduce(f64::max);
    }
}
