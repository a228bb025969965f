//! The layout of a run: the process mesh of least modelled cost that fits, the modes of each group,
//! and memory.

use crate::base::bisect::bisect_whole;
use crate::base::error::{Error, LESS_MEMORY, Result};
use crate::base::memory::NamedBytes;
use crate::base::text::{bytes_text, counted};
use crate::matrix::lanes::Lanes;
use crate::parallel::partition::ProcessMesh;
use crate::plan::balance;
use crate::plan::balance::Batch;
use crate::plan::memory::{PlannedWork, arrays, memory_of_points, program_bytes};
use crate::problem::case::{Case, Method};
use crate::problem::grid::PhaseSpace;
use crate::problem::limits::MOST_POINTS;
use crate::propagate::descriptor;
use serde::Serialize;
use std::collections::BTreeSet;

// Costs of an exchange in rows of a step, measured within a node (docs/performance.md): 4 µs a
// round and 40 ns a ghost, against 7 to 20 ns a row.
/// Cost of a round of messages.
const ROWS_A_ROUND: f64 = 300.0;
/// Cost of a ghost that is packed, sent and unpacked.
const ROWS_A_GHOST: f64 = 3.0;

/// A mesh of more blocks is taken if it is at least this many times as fast by the model, which
/// does not count that ranks with neighbouring blocks wait for each other in every step.
const WORTH_A_SPLIT: f64 = 1.08;

/// The distribution of a run over the ranks, and its memory.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Layout {
    /// The process mesh.
    pub mesh: ProcessMesh,
    /// The batches of each mode group, longest first.
    pub groups: Vec<Vec<Batch>>,
    /// Largest modelled cost of a group over the mean.
    pub imbalance: f64,
    /// Names of arrays with their bytes on the fullest rank.
    pub arrays: Vec<NamedBytes>,
}

/// The work of a block of space in a step, in rows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockRows {
    /// Rows of the block.
    pub own: f64,
    /// The cost that splitting space adds.
    pub exchange: f64,
}

/// The ranks and the memory that a layout may use.
#[derive(Clone, Debug, Default)]
pub struct Resources {
    /// Number of ranks.
    pub ranks: usize,
    /// Blocks along each x-axis, if given by the user.
    pub ranks_x: Option<Vec<usize>>,
    /// Bytes a rank may take, if known.
    pub memory_per_rank: Option<u64>,
}

impl Resources {
    /// These ranks, on the blocks of `mesh`.
    pub fn on_mesh(&self, mesh: &ProcessMesh) -> Self {
        Self { ranks_x: Some(mesh.space.clone()), ..self.clone() }
    }
}

/// The sentence on what helps where the program itself does not fit.
const FEWER_RANKS: &str = "program and libraries alone take more than that: fewer ranks on a node \
                           leave more memory for each";

/// Refuses a grid that no layout fits into the memory of `resources`, before anything is evaluated
/// on the grid.
///
/// # Errors
/// [`Error::Memory`].
pub fn refuse_too_large(case: &Case, resources: &Resources) -> Result<()> {
    let (ranks, limit) = (resources.ranks, resources.memory_per_rank.unwrap_or(u64::MAX));
    // The tracer keeps V and distances for all of space on every rank.
    let tracer = if case.traces_exact() { 80.0 } else { 0.0 };
    // A lower bound for any layout. By modes: two batch vectors, a state and the sums of a reading.
    // Classical: four real vectors and the field.
    let bytes_per_cell = match case.method {
        Method::Schrodingerized => 2.0 * size_of::<Lanes>() as f64 + 32.0,
        Method::Classical => 48.0,
    };
    let needed = bytes_per_cell * case.space.cells() as f64 / ranks as f64
        + tracer * case.space.space_cells() as f64;
    if needed > limit as f64 {
        return Err(Error::Memory {
            needed: format!("at least {}", bytes_text(needed as u64)),
            available: bytes_text(limit),
            detail: format!(
                "{:.3e} unknowns on {}",
                case.space.cells() as f64,
                counted(ranks, "rank", "ranks")
            ),
            remedies: LESS_MEMORY.to_owned(),
        });
    }
    Ok(())
}

/// The most points in `p` with which a run can keep all modes.
pub(crate) struct LargestPoints {
    /// `N_p`.
    pub points: usize,
    /// The mesh on which they fit.
    pub mesh: ProcessMesh,
}

impl Layout {
    pub(crate) fn new(work: PlannedWork<'_>, resources: &Resources) -> Result<Self> {
        let grid = &work.case.space;
        let layout = match &resources.ranks_x {
            Some(space) => Self::of_mesh(work, mesh_of(grid, space, resources.ranks)?),
            None => Self::cheapest(work, resources)?,
        };
        layout.within(work, resources)?.require_column_numbers(grid)
    }

    /// The layout on the cheapest mesh that fits, or else on that of least memory.
    fn cheapest(work: PlannedWork<'_>, resources: &Resources) -> Result<Self> {
        let limit = resources.memory_per_rank.unwrap_or(u64::MAX);
        let mut best: Option<(bool, f64, Self)> = None;
        // Fewest blocks come first; more must be faster by a factor.
        for layout in Self::every(work, resources.ranks) {
            let fits = layout.memory() <= limit;
            let cost = if fits { layout.cost(work) } else { layout.memory() as f64 };
            let worth = if fits { WORTH_A_SPLIT } else { 1.0 };
            let better = best.as_ref().is_none_or(|(other, least, _)| {
                (fits && !other) || (fits == *other && worth * cost < *least)
            });
            if better {
                best = Some((fits, cost, layout));
            }
        }
        let none = || Error::Ranks(format!("{} ranks do not fit the grid", resources.ranks));
        best.map(|(_, _, layout)| layout).ok_or_else(none)
    }

    /// This layout. Refuses more cells on a rank than 32-bit column numbers can address.
    fn require_column_numbers(self, space: &PhaseSpace) -> Result<Self> {
        let largest = self.mesh.fullest_block(space);
        if 2 * largest.cells + largest.ghosts <= u32::MAX as usize {
            return Ok(self);
        }
        Err(Error::Ranks(format!(
            "{} cells on a rank, {} of memory; at most {} can be numbered: more blocks along x \
             (--ranks-x)",
            largest.cells,
            bytes_text(self.memory()),
            u32::MAX / 2
        )))
    }

    /// The layouts of all splits of `ranks` into blocks × groups, fewest blocks first.
    pub(crate) fn every(
        work: PlannedWork<'_>,
        ranks: usize,
    ) -> impl Iterator<Item = Self> + use<'_> {
        meshes(&work.case.space, ranks).map(move |mesh| Self::of_mesh(work, mesh))
    }

    fn of_mesh(work: PlannedWork<'_>, mesh: ProcessMesh) -> Self {
        let modes = work.warp.map_or(&[][..], |warp| &warp.work);
        let coupling = descriptor(work.case.propagator.method).batch_coupling();
        let groups = balance::share_out(modes, &BTreeSet::new(), coupling, mesh.groups);
        let costs = groups.iter().map(|group| balance::cost(group));
        let (most, sum) = (costs.clone().max().unwrap_or(0), costs.sum::<usize>());
        let imbalance = if sum == 0 { 1.0 } else { most as f64 * mesh.groups as f64 / sum as f64 };
        let kept = |group: &Vec<Batch>| group.iter().map(|b| b.modes.len()).sum::<usize>();
        let most = groups.iter().map(kept).max().unwrap_or(0);
        let arrays = arrays(work, &mesh, most);
        Self { mesh, groups, imbalance, arrays }
    }

    /// The most points `N_p` with which a run on `resources` can keep all modes, and its mesh. None
    /// if there are no modes, no memory is given, or not even two points fit. The result does not
    /// depend on `N_p` of `work`.
    pub(crate) fn largest_points(
        work: PlannedWork<'_>,
        resources: &Resources,
    ) -> Option<LargestPoints> {
        let limit = resources.memory_per_rank.filter(|_| work.warp.is_some())?;
        let grid = &work.case.space;
        let meshes = match &resources.ranks_x {
            Some(space) => vec![mesh_of(grid, space, resources.ranks).ok()?],
            None => meshes(grid, resources.ranks).collect(),
        };
        let most = |mesh: ProcessMesh| {
            let memory = |points| memory_of_points(work, &mesh, points);
            let points = most_points(MOST_POINTS, limit, memory)?;
            Some(LargestPoints { points, mesh })
        };
        // Of equal numbers that of the fewest blocks: the last one counts.
        meshes.into_iter().rev().filter_map(most).max_by_key(|found| found.points)
    }

    /// The modes of each mode group, ascending.
    pub fn modes(&self) -> Vec<Vec<usize>> {
        let of = |group: &Vec<Batch>| {
            let mut modes: Vec<usize> = group.iter().flat_map(|b| b.modes.clone()).collect();
            modes.sort_unstable();
            modes
        };
        self.groups.iter().map(of).collect()
    }

    /// Modelled time of the slowest group, in applications of a mode on the whole grid.
    pub(crate) fn cost(&self, work: PlannedWork<'_>) -> f64 {
        let costs = self.groups.iter().map(|group| balance::cost(group));
        let group = work.warp.map_or(1.0, |_| costs.max().unwrap_or(0) as f64);
        let BlockRows { own, exchange } = self.rows(work);
        group * (own + exchange) / work.case.space.cells() as f64
    }

    /// The work of the fullest block in a step.
    pub(crate) fn rows(&self, PlannedWork { case, warp, .. }: PlannedWork<'_>) -> BlockRows {
        let fullest = self.mesh.fullest_block(&case.space);
        let own = fullest.cells as f64;
        if self.mesh.blocks() == 1 {
            return BlockRows { own, exchange: 0.0 };
        }
        let splitting =
            warp.map_or(1.0, |_| descriptor(case.propagator.method).cost_of_splitting());
        let messages = ROWS_A_ROUND + ROWS_A_GHOST * fullest.ghosts as f64;
        BlockRows { own, exchange: splitting * (own + messages) - own }
    }

    /// Planned bytes on the fullest rank.
    pub fn memory(&self) -> u64 {
        self.arrays.iter().map(|a| a.bytes).sum()
    }

    /// Refuses a layout of `work` that does not fit into the memory of `resources`, if that is
    /// known.
    ///
    /// # Errors
    /// [`Error::Memory`].
    pub fn within(self, work: PlannedWork<'_>, resources: &Resources) -> Result<Self> {
        let limit = resources.memory_per_rank.unwrap_or(u64::MAX);
        if self.memory() <= limit {
            return Ok(self);
        }
        let largest = self.arrays.iter().max_by_key(|a| a.bytes).cloned();
        let NamedBytes { name, bytes } = largest.unwrap_or_default();
        Err(Error::Memory {
            needed: bytes_text(self.memory()),
            available: bytes_text(limit),
            detail: format!("{name}: {}", bytes_text(bytes)),
            remedies: match work.warp.filter(|warp| warp.points.is_some()) {
                // Whatever the case is, it does not fit.
                _ if program_bytes(resources.ranks) > limit => FEWER_RANKS.to_owned(),
                Some(warp) => fewer_points(work, warp.takes_points(), resources),
                None => LESS_MEMORY.to_owned(),
            },
        })
    }
}

/// Every split of `ranks` into blocks × groups, fewest blocks first.
fn meshes(grid: &PhaseSpace, ranks: usize) -> impl Iterator<Item = ProcessMesh> {
    let blocks = (1..=ranks).filter(move |b| ranks.is_multiple_of(*b));
    blocks.filter_map(move |blocks| {
        Some(ProcessMesh { space: split_axes(grid, blocks)?, groups: ranks / blocks })
    })
}

/// The sentence on what reduces the memory of a run that stores its modes and does not fit. `given`
/// is whether `solver.warp.points` can be given.
fn fewer_points(work: PlannedWork<'_>, given: bool, resources: &Resources) -> String {
    let most = match Layout::largest_points(work, resources) {
        Some(LargestPoints { points, .. }) => format!("at most {points} fit"),
        None => "no number of them fits".to_owned(),
    };
    let fewer = match (&work.case.warped_start, given) {
        (Some(_), _) => format!("a file of initial.warped with fewer points ({most})"),
        (None, true) => {
            format!("dropping the modes (--mode streamed), fewer solver.warp.points ({most})")
        }
        (None, false) => {
            format!(
                "dropping the modes (--mode streamed), a larger solver.tolerance, which takes \
                fewer points in p ({most})"
            )
        }
    };
    format!(
        "{fewer}, more ranks on more nodes, or fewer cells (axis.N.x.cells, axis.N.v.cells) need \
         less"
    )
}

/// The largest even number from 2 to `most` whose `memory`, which does not decrease, is within
/// `limit`.
fn most_points(most: usize, limit: u64, memory: impl Fn(usize) -> u64) -> Option<usize> {
    let [half, _] = bisect_whole(0, most / 2 + 1, |half| memory(2 * half) <= limit);
    Some(2 * half).filter(|points| *points > 0)
}

fn mesh_of(grid: &PhaseSpace, space: &[usize], ranks: usize) -> Result<ProcessMesh> {
    let n = grid.dimension();
    if space.len() > n {
        return Err(Error::Ranks(format!(
            "--ranks-x: {} numbers given, the case has {n} x-axes",
            space.len()
        )));
    }
    let mut space = space.to_vec();
    space.resize(n, 1);
    let mesh = ProcessMesh { space, groups: 1 };
    mesh.validate(grid)?;
    let blocks = mesh.blocks();
    if !ranks.is_multiple_of(blocks) {
        let divisors: Vec<String> =
            (1..=ranks).filter(|d| ranks.is_multiple_of(*d)).map(|d| d.to_string()).collect();
        return Err(Error::Ranks(format!(
            "--ranks-x: {blocks} blocks do not divide {ranks} ranks; products of {} do",
            divisors.join(", ")
        )));
    }
    Ok(ProcessMesh { groups: ranks / blocks, ..mesh })
}

/// `blocks` split over the x-axes with the fewest ghosts; `None` if no axis has that many cells.
fn split_axes(grid: &PhaseSpace, blocks: usize) -> Option<Vec<usize>> {
    let product = |parts: &Vec<usize>| parts.iter().product::<usize>();
    // Every split of the first axes, whose product divides `blocks`.
    let mut splits = vec![Vec::new()];
    for axis in 0..grid.dimension() {
        let longer = |parts: Vec<usize>| {
            let left = blocks / product(&parts);
            let divisors =
                (1..=left.min(grid.most_blocks(axis))).filter(move |p| left.is_multiple_of(*p));
            divisors.map(move |p| [&parts[..], &[p]].concat())
        };
        splits = splits.into_iter().flat_map(longer).collect();
    }
    splits.retain(|parts| product(parts) == blocks);
    splits.into_iter().min_by_key(|parts| ghosts_within(grid, parts))
}

/// Ghost cells of space of a block with neighbours on all sides, for `parts` blocks along each
/// x-axis.
fn ghosts_within(grid: &PhaseSpace, parts: &[usize]) -> usize {
    let size: Vec<usize> = grid.x.iter().zip(parts).map(|(a, p)| a.cells.div_ceil(*p)).collect();
    let volume: usize = size.iter().product();
    let split = size.iter().zip(parts).filter(|(_, p)| **p > 1);
    split.map(|(s, _)| 2 * volume / s).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;

    #[test]
    fn ranks_are_kept_busy_whatever_the_number_of_modes() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/example1.toml");
        let case = Case::load(&path, &[]).expect("a case of the repository");
        let one = Resources { ranks: 1, ..Resources::default() };
        let plan = Plan::new(&case, &one, 1.15).expect("a plan");
        let planned = plan.warp.as_ref().expect("a schrodingerized run");
        for modes in [13, 17, 19, 28, 43, 47, 60, 77] {
            let mut warp = planned.clone();
            warp.work.truncate(modes);
            let work = PlannedWork { case: &case, bounds: &plan.bounds, warp: Some(&warp) };
            let layout = |ranks: usize| {
                let resources = Resources { ranks, ..Resources::default() };
                Layout::new(work, &resources).expect("a layout")
            };
            let alone = layout(1).cost(work);
            // By the model: whole batches or blocks of space, whichever is faster.
            for (ranks, least) in [(2, 0.84), (3, 0.75), (4, 0.71)] {
                let found = layout(ranks);
                let efficiency = alone / found.cost(work) / ranks as f64;
                let at = format!("{modes} modes, {:?}: {efficiency}", found.mesh);
                assert!((least..=1.0).contains(&efficiency), "{at}");
                let even = modes < 28 || ranks == 3 || found.imbalance <= 1.18;
                assert!(even, "{at}, imbalance {}", found.imbalance);
            }
        }
    }
}
