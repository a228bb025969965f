//! A case that is prepared on a process mesh as in a run, and its parts for a propagator.

use phasewarp::matrix::bounds::Bounds;
use phasewarp::parallel::communicator::{Communicator, World};
use phasewarp::parallel::partition::{Block, ProcessMesh};
use phasewarp::plan::Plan;
use phasewarp::plan::layout::Resources;
use phasewarp::problem::case::Case;
use phasewarp::propagate::evolution::{Evolution, InitialState};
use phasewarp::propagate::interruption::Interruption;
use phasewarp::propagate::method::Propagator;
use phasewarp::propagate::propagator;
use phasewarp::propagate::time_dependent_inflow::Schedule;
pub use phasewarp::solve::prepared::Prepared;

/// Limit on the sweeps that improve the weights.
const WEIGHT_SWEEPS: usize = 100;

/// The block of this rank on `mesh`.
pub fn block_of(case: &Case, mesh: &ProcessMesh, communicator: &Communicator) -> Block {
    Block::new(&case.space, mesh, communicator.space.rank())
}

/// The system that a propagator works on.
pub struct Parts<'a> {
    pub evolution: Evolution<'a>,
    /// The fields at time zero.
    pub initial: Vec<InitialState<'a>>,
    pub communicator: &'a Communicator,
    /// The weights of the block's own cells.
    pub pi: &'a [f64],
    /// The time steps of an inflow that depends on time.
    pub schedule: Option<&'a Schedule>,
}

impl<'a> Parts<'a> {
    /// The propagator of a run with this plan.
    pub fn propagator(&self, plan: &Plan) -> Box<dyn Propagator + 'a> {
        let warp = plan.warp.as_ref().expect("a plan of modes");
        let setting = plan.propagator_setting(warp);
        propagator(&setting, self.schedule, self.evolution.matrix).expect("a propagator")
    }
}

/// All ranks of `world`, in the blocks of `mesh`.
pub fn resources(world: &World, mesh: &ProcessMesh) -> Resources {
    Resources {
        ranks: world.group().size(),
        ranks_x: Some(mesh.space.clone()),
        memory_per_rank: None,
    }
}

/// Prepares a case on `mesh`.
pub fn prepare(world: &World, case: &Case, mesh: &ProcessMesh) -> Prepared {
    let bounds = Bounds::new(case).expect("V is finite");
    let plan = Plan::provisional(case, &bounds, &resources(world, mesh)).expect("a plan");
    assert_eq!(plan.layout.mesh, *mesh);
    Prepared::with_sweeps(world, case, &bounds, plan, WEIGHT_SWEEPS)
        .expect("weights and steps are found")
}

/// The parts of a prepared case for a propagation over `time`.
pub fn parts(prepared: &mut Prepared, time: f64) -> Parts<'_> {
    let Prepared { communicator, system, bounds, .. } = prepared;
    let norms = system.states.iter().map(|state| system.norm(communicator, state));
    let norms: Vec<f64> = norms.collect();
    let rows = system.matrix.rows();
    let initial = system.states.iter().zip(norms);
    Parts {
        initial: initial.map(|(state, norm)| InitialState::real(&state[..rows], norm)).collect(),
        pi: &system.weights.pi[..system.matrix.block.cells()],
        communicator,
        schedule: system.schedule.as_ref(),
        evolution: Evolution {
            matrix: &system.matrix,
            exchange: &mut system.exchange,
            space: &communicator.space,
            bounds,
            time,
            norm_terms: system.norm_terms,
            interruption: Interruption::default(),
        },
    }
}
