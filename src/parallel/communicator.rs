//! MPI: start and end, groups of ranks, agreement on errors, exact reductions, ghost exchange.
//!
//! A serial run has one rank. Nothing depends on timing, and all reductions are sums of integers,
//! maxima or minima. So results have the same bits on any number of ranks.

pub mod transpose;
pub mod vote;
pub(crate) mod watch;

pub use crate::parallel::ghost_exchange::{GhostExchange, VectorRow};
pub use crate::parallel::group::Group;
pub use crate::parallel::world::World;

use crate::parallel::partition::ProcessMesh;

/// The process mesh as communicators.
pub struct Communicator {
    /// All ranks.
    pub world: Group,
    /// The ranks that share this rank's modes and split space.
    pub space: Group,
    /// The ranks that share this rank's space block and split the modes.
    pub modes: Group,
}

impl Communicator {
    /// Splits `world` into the process mesh (see [`crate::parallel::partition`]).
    pub fn new(world: &World, mesh: &ProcessMesh) -> Self {
        let world = world.group();
        let rank = world.rank();
        Self {
            space: world.split(rank / mesh.blocks()),
            modes: world.split(rank % mesh.blocks()),
            world,
        }
    }
}
