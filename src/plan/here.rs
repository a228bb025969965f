//! What the machine at hand admits: memory a rank, and cases that cannot fit.

use crate::base::error::Result;
use crate::base::memory;
use crate::parallel::communicator::{Group, World};
use crate::plan::layout::{Resources, refuse_hopeless};
use crate::problem::case::Case;

/// Bytes a rank of `world` may take: its share of what the ranks on its node have together, within
/// its own limits, the least over all. Collective.
pub fn memory_per_rank(world: &Group) -> u64 {
    let available = memory::available();
    let share = available.together / world.ranks_on_node() as u64;
    -world.max(-(share.min(available.alone) as f64)) as u64
}

impl Resources {
    /// All ranks of `world` and the memory that they have here. Collective.
    pub fn here(world: &World) -> Self {
        let all = world.group();
        Self { ranks: all.size(), ranks_x: None, memory_per_rank: Some(memory_per_rank(&all)) }
    }
}

/// Refuses a grid that does not fit into this machine's memory. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Memory`].
pub fn refuse_hopeless_here(world: &World, case: &Case) -> Result<()> {
    refuse_hopeless(case, &Resources::here(world))
}
