//! A case assembled on all ranks without being run, for what is measured of it before a plan is made.

use crate::base::error::Result;
use crate::matrix::bounds::Bounds;
use crate::parallel::communicator::{Communicator, World};
use crate::parallel::partition::Block;
use crate::plan::Plan;
use crate::plan::layout::Resources;
use crate::problem::case::Case;
use crate::solve::system::Problem;

/// The problem on this rank, and what was measured of it.
pub struct Assembled {
    /// The process mesh.
    pub communicator: Communicator,
    /// This rank's part.
    pub problem: Problem,
    /// With the growth that was found.
    pub bounds: Bounds,
    /// Largest `‖ũ(0)‖/‖f(t)‖`, see [`Problem::probe`].
    pub ratio: f64,
}

impl Assembled {
    /// Assembles `case` on the mesh that a run on `here` would have, for vectors of at most `width` numbers a row. Collective.
    ///
    /// # Errors
    /// As [`Plan::provisional`] and [`Problem::new`].
    pub fn new(
        world: &World,
        case: &Case,
        bounds: &Bounds,
        (here, width): (&Resources, usize),
    ) -> Result<Self> {
        let expected = Plan::provisional(case, bounds, here)?;
        let (mesh, max_weight_sweeps) = (&expected.layout.mesh, expected.max_weight_sweeps());
        let communicator = Communicator::new(world, mesh);
        let block = Block::new(&case.space, mesh, communicator.space.rank());
        let mut problem = Problem::new(
            case,
            bounds,
            &communicator,
            block,
            (width, max_weight_sweeps),
        )?;
        let bounds = problem.bounds(case, bounds);
        let ratio = problem.probe(&communicator, bounds.rate, &case.legs());
        Ok(Self {
            communicator,
            problem,
            bounds,
            ratio,
        })
    }
}
