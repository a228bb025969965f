//! The data of a result: fields, moments, earlier output times, the exact solution, the plateau.

use crate::matrix::observables::{Moments, Totals};
use crate::plan::Plan;
use crate::problem::case::Case;
use crate::problem::exact::sheet::sums::MultivaluedVelocity;
use crate::quantum::readout::Readout;
use std::collections::BTreeMap;
use std::ops::Range;

/// Name of the file with the datasets of a run.
pub const RESULT: &str = "result.h5";

/// The exact solution on a rank's share.
pub enum ExactSolution {
    /// `f` at cell centres.
    Field(Vec<f64>),
    /// For measure-valued data, which have moments only: the multivalued velocity on all of space,
    /// in one dimension.
    Measure {
        /// Its branches.
        curve: Option<MultivaluedVelocity>,
    },
}

/// The contents of `result.h5`.
pub struct Results<'a> {
    /// The case.
    pub case: &'a Case,
    /// The plan it ran with.
    pub plan: &'a Plan,
    /// Space cells of this rank, one range for each space axis; may be empty.
    pub share: &'a [Range<usize>],
    /// The case's fields on the share, velocities fastest.
    pub fields: &'a [&'a [f64]],
    /// The exact solution on the share.
    pub exact: Option<&'a ExactSolution>,
    /// Moments of the exact solution on the share, at every time of `early` and then at the end, or
    /// at the end only; empty without `exact`.
    pub exact_moments: &'a [Moments],
    /// Moments on the share.
    pub moments: &'a Moments,
    /// `V` on the share.
    pub potential: &'a [f64],
    /// Mass and energies in all of space.
    pub totals: Totals,
    /// Results at the output times before the end, ascending.
    pub early: &'a [EarlyResult],
    /// The plateau; the same on all ranks.
    pub plateau: &'a [PlateauPoint],
    /// Estimates by a quantum computer; the same on all ranks.
    pub readout: Option<&'a Readout>,
    /// Seconds by step.
    pub seconds: &'a BTreeMap<String, f64>,
    /// Attributes of the file: what produced it.
    pub provenance: &'a [(String, String)],
}

/// Attributes of a file as a whole.
pub struct FileAttributes<'a> {
    /// The case.
    pub case: &'a Case,
    /// The plan it ran with.
    pub plan: &'a Plan,
    /// The time of its fields.
    pub time: f64,
    /// Seconds by step.
    pub seconds: &'a BTreeMap<String, f64>,
    /// Attributes of the file: what produced it.
    pub provenance: &'a [(String, String)],
}

impl<'a> Results<'a> {
    pub(crate) fn about(&self) -> FileAttributes<'a> {
        FileAttributes {
            case: self.case,
            plan: self.plan,
            time: self.case.end,
            seconds: self.seconds,
            provenance: self.provenance,
        }
    }

    /// The branches of the exact velocity, if they are known.
    pub(crate) fn curve(&self) -> Option<&'a MultivaluedVelocity> {
        let Some(ExactSolution::Measure { curve }) = self.exact else { return None };
        curve.as_ref()
    }
}

/// The field read at `p` instead of `p◇`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlateauPoint {
    /// The point `p` at which the field is read.
    pub p: f64,
    /// Relative l2 distance to the field read at `p◇`.
    pub distance: f64,
    /// `(∫ f² dx dv)^½`.
    pub norm: f64,
}

/// The vectors as slices.
pub fn slices(vectors: &[Vec<f64>]) -> Vec<&[f64]> {
    vectors.iter().map(Vec::as_slice).collect()
}

/// Results at an output time before the end, on a rank's share.
#[derive(Clone, Debug)]
pub struct EarlyResult {
    /// The time of its fields.
    pub time: f64,
    /// The moments.
    pub moments: Moments,
    /// Mass and energies in all of space.
    pub totals: Totals,
    /// The case's fields; empty if only moments are written at this time.
    pub fields: Vec<Vec<f64>>,
}
