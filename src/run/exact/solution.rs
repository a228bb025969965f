//! The exact solution at any points.

use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::exact::Tracer;
use crate::problem::formula::Expression;

/// The exact solution of a case, at any points and times.
pub enum ExactValues<'a> {
    /// A formula.
    Given(&'a Expression),
    /// Characteristics, traced back.
    Traced(Box<Tracer<'a>>),
}

impl<'a> ExactValues<'a> {
    /// The solution of `case` that `exact` names. Collective.
    ///
    /// # Errors
    /// If `V` is not finite.
    pub fn new(world: &Group, case: &'a Case, exact: &'a Exact) -> Result<Self> {
        world.agree(match exact {
            Exact::Characteristics => Tracer::new(case).map(|tracer| Self::Traced(tracer.into())),
            Exact::Formula(formula) => Ok(Self::Given(formula)),
        })
    }

    /// Whether they are a formula.
    pub fn are_given(&self) -> bool {
        matches!(self, Self::Given(_))
    }

    /// The values at `points` `[x, y, z, vx, vy, vz]` at a time.
    pub fn values_at(&self, points: &[[f64; 6]], time: f64) -> Vec<f64> {
        match self {
            Self::Given(formula) => formula.at_points(points, time),
            Self::Traced(tracer) => tracer.values(points, time),
        }
    }
}
