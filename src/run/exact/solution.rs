//! The exact solution at any points.

use crate::base::error::Result;
use crate::parallel::communicator::Group;
use crate::problem::case::{Case, Exact};
use crate::problem::exact::Tracer;
use crate::problem::formula::Expression;
use std::time::{Duration, Instant};

/// The exact solution of a case, at any points and times.
pub enum ExactValues<'a> {
    /// A formula.
    Given(&'a Expression),
    /// Characteristics, traced back.
    Traced {
        /// What traces them.
        tracer: Box<Tracer<'a>>,
        /// The start of the program, and the wall time after which values are zero: a caller that
        /// gives it looks at the time afterwards.
        wall: Option<(Instant, Duration)>,
    },
}

/// Number of points that are traced between two looks at the time.
const TRACED_AT_ONCE: usize = 256;

impl<'a> ExactValues<'a> {
    /// The solution of `case` that `exact` names. Collective.
    ///
    /// # Errors
    /// If `V` is not finite.
    pub fn new(world: &Group, case: &'a Case, exact: &'a Exact) -> Result<Self> {
        world.agree(match exact {
            Exact::Characteristics => Tracer::new(case).map(Self::traced),
            Exact::Formula(formula) => Ok(Self::Given(formula)),
        })
    }

    /// Characteristics that `tracer` traces.
    pub fn traced(tracer: Tracer<'a>) -> Self {
        Self::Traced { tracer: tracer.into(), wall: None }
    }

    /// These values until a wall time.
    pub fn until(self, wall: Option<(Instant, Duration)>) -> Self {
        match self {
            Self::Traced { tracer, .. } => Self::Traced { tracer, wall },
            Self::Given(_) => self,
        }
    }

    /// Whether they are a formula.
    pub fn are_given(&self) -> bool {
        matches!(self, Self::Given(_))
    }

    /// About the number of steps that a value at a time takes; 1 where they are few.
    pub fn steps(&self, time: f64) -> f64 {
        match self {
            Self::Given(_) => 1.0,
            Self::Traced { tracer, .. } => tracer.steps_of_a_path(time),
        }
    }

    /// The values at `points` `[x, y, z, vx, vy, vz]` at a time.
    pub fn values_at(&self, points: &[[f64; 6]], time: f64) -> Vec<f64> {
        match self {
            Self::Given(formula) => formula.at_points(points, time),
            Self::Traced { tracer, wall: None } => tracer.values(points, time),
            Self::Traced { tracer, wall: Some((start, wall)) } => {
                let in_time = |points: &[[f64; 6]]| {
                    if start.elapsed() < *wall {
                        tracer.values(points, time)
                    } else {
                        vec![0.0; points.len()]
                    }
                };
                points.chunks(TRACED_AT_ONCE).flat_map(in_time).collect()
            }
        }
    }
}
