//! The problem of a case on a rank, prepared as a run prepares it.

use phasewarp::matrix::bounds::Bounds;
use phasewarp::matrix::lanes::LANES;
use phasewarp::parallel::communicator::{Communicator, World};
use phasewarp::parallel::partition::{Block, Mesh};
use phasewarp::plan::Plan;
use phasewarp::problem::case::Case;
use phasewarp::propagate::method::{Evolution, Initial, Propagator};
use phasewarp::propagate::propagator;
use phasewarp::propagate::time_dependent_inflow::Schedule;
use phasewarp::solve::system::DiscreteSystem;

/// Sweeps that better weights are worth.
const WEIGHT_SWEEPS: usize = 100;

/// The block of this rank on `mesh`.
pub fn block_of(case: &Case, mesh: &Mesh, communicator: &Communicator) -> Block {
    Block::new(&case.space, mesh, communicator.space.rank())
}

/// The problem of a case on a rank as a run prepares it, with weights where the run takes them.
pub struct Prepared {
    /// Number of cells of the grid.
    pub cells: usize,
    pub communicator: Communicator,
    pub problem: DiscreteSystem,
    pub bounds: Bounds,
}

/// What a propagator works on.
pub struct Parts<'a> {
    pub evolution: Evolution<'a>,
    /// The fields at time zero.
    pub initial: Vec<Initial<'a>>,
    pub communicator: &'a Communicator,
    /// The weights of the block's own cells.
    pub pi: &'a [f64],
    /// The steps of an inflow that depends on time.
    pub schedule: Option<&'a Schedule>,
}

impl<'a> Parts<'a> {
    /// The propagator of a run by `plan`.
    pub fn propagator(&self, plan: &Plan) -> Box<dyn Propagator + 'a> {
        let warp = plan.warp.as_ref().expect("a plan of modes");
        let setting = plan.propagator_setting(warp);
        propagator(&setting, self.schedule, self.evolution.matrix).expect("a propagator")
    }
}

impl Prepared {
    pub fn new(world: &World, case: &Case, mesh: &Mesh) -> Self {
        let communicator = Communicator::new(world, mesh);
        let block = block_of(case, mesh, &communicator);
        let allowed = Bounds::new(case).expect("V is finite");
        let sizes = (2 * LANES, WEIGHT_SWEEPS);
        let problem = DiscreteSystem::new(case, &allowed, &communicator, block, sizes)
            .expect("weights and steps are found");
        let bounds = problem.bounds(case, &allowed);
        Self {
            cells: case.space.cells(),
            communicator,
            problem,
            bounds,
        }
    }

    /// For a propagation over `time`.
    pub fn parts(&mut self, time: f64) -> Parts<'_> {
        let Self {
            communicator,
            problem,
            bounds,
            ..
        } = self;
        let norm = |state: &Vec<f64>| problem.norm(communicator, state, false);
        let norms: Vec<f64> = problem.states.iter().map(norm).collect();
        let rows = problem.matrix.rows();
        let initial = problem.states.iter().zip(norms);
        Parts {
            initial: initial
                .map(|(state, norm)| Initial::real(&state[..rows], norm))
                .collect(),
            pi: &problem.weights.pi[..problem.matrix.block.cells()],
            communicator,
            schedule: problem.schedule.as_ref(),
            evolution: Evolution {
                matrix: &problem.matrix,
                exchange: &mut problem.exchange,
                space: &communicator.space,
                rate: bounds.rate,
                growth: bounds.growth,
                time,
                terms: problem.terms,
            },
        }
    }
}
