//! Limits of this machine: memory per rank, and cases that cannot fit.

use crate::base::error::Result;
use crate::base::log::eprint_wrapped;
use crate::base::memory;
use crate::base::row_major::volume;
use crate::parallel::communicator::{Group, World};
use crate::plan::layout::{Resources, refuse_too_large};
use crate::problem::case::Case;
use crate::problem::potential::Potential;
use std::time::Instant;

/// Bytes a rank of `world` may take: its share of the memory of its node, within its own limits,
/// and the least of these over all ranks. Collective.
pub fn memory_per_rank(world: &Group) -> u64 {
    let available = memory::available();
    let share = available.together / world.ranks_on_node() as u64;
    -world.max(-(share.min(available.alone) as f64)) as u64
}

impl Resources {
    /// All ranks of `world`, without a limit on memory.
    pub fn unlimited(world: &World) -> Self {
        Self { ranks: world.group().size(), ..Self::default() }
    }

    /// All ranks of `world` with the memory that they have on this machine. Collective.
    pub fn here(world: &World) -> Self {
        let all = world.group();
        Self { ranks: all.size(), ranks_x: None, memory_per_rank: Some(memory_per_rank(&all)) }
    }
}

/// Seconds to evaluate `V` on all cells of space, extrapolated from some of them; 0 for a small
/// grid. By one rank's clock.
fn seconds_to_evaluate(case: &Case) -> f64 {
    const FEW: usize = 1 << 17;
    const SAMPLE: f64 = 16384.0;
    let axes = &case.space.x;
    if case.space.space_cells() <= FEW {
        return 0.0;
    }
    let side = SAMPLE.powf(1.0 / axes.len() as f64) as usize;
    let ranges: Vec<_> = axes.iter().map(|axis| 0..axis.cells.min(side)).collect();
    let some = volume(&ranges);
    let started = Instant::now();
    // Errors of V are reported where V is used.
    let _ = Potential::new(case, &ranges);
    started.elapsed().as_secs_f64() * case.space.space_cells() as f64 / some as f64
}

/// Seconds for a cell of space before anything is solved, beside evaluating `V`: to locate jumps,
/// to bound the matrix, to reduce the case and to plan. 5.4 s were measured for 2e6 × 8 cells.
const SECONDS_PER_SPACE_CELL: f64 = 2e-6;
/// Seconds to plan a cell of phase space: 1.7 s were measured for 4000 × 4000 cells.
const SECONDS_PER_PHASE_CELL: f64 = 1e-7;

/// Seconds of the steps on the cells of space before anything is solved. By one rank's clock.
pub fn seconds_before_solving(case: &Case) -> f64 {
    seconds_to_evaluate(case) + SECONDS_PER_SPACE_CELL * case.space.space_cells() as f64
}

/// Reports on the first rank that the steps before the solve take long: evaluating `V` and planning
/// on a fine grid, as far as it fits into this machine's memory, and planning millions of modes.
/// Collective.
pub fn announce_slow_steps(world: &World, case: &Case) {
    const LONG: f64 = 1.0;
    const MANY: usize = 1 << 20;
    let fits = refuse_too_large_here(world, case).is_ok();
    if !world.group().is_first() {
        return;
    }
    if let Some(points) = case.warp.points.filter(|&points| points > MANY) {
        let each = "the work of each mode is planned, which may take half a minute";
        eprint_wrapped(&format!("solver.warp.points = {points}: {each}"));
    }
    let (space, all) = (case.space.space_cells() as f64, case.space.cells() as f64);
    let seconds = if fits {
        seconds_before_solving(case) + SECONDS_PER_PHASE_CELL * all
    } else {
        seconds_to_evaluate(case)
    };
    if seconds > LONG {
        eprint_wrapped(&format!(
            "{all:.3e} cells, {space:.3e} of space: evaluating V and planning take about \
             {seconds:.0} s"
        ));
    }
}

/// Refuses a grid that does not fit into this machine's memory. Collective.
///
/// # Errors
/// [`crate::base::error::Error::Memory`].
pub fn refuse_too_large_here(world: &World, case: &Case) -> Result<()> {
    refuse_too_large(case, &Resources::here(world))
}
