//! What to ask a batch system for: the process mesh and why, memory of a node.

use super::{Bounds, Layout, MOST_MODES, Plan, bytes_text};
use crate::case::Case;
use serde::Serialize;
use std::fmt;

/// Meshes that are shown.
const SHOWN: usize = 4;

/// A node of the machine that a run is planned for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Node {
    /// Bytes it has for its ranks.
    pub memory: u64,
    /// Ranks on it.
    pub ranks: usize,
}

/// A process mesh that the ranks can have.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Candidate {
    /// Blocks along each x-axis: what `--ranks-x` takes.
    pub space: Vec<usize>,
    /// Mode groups.
    pub groups: usize,
    /// Modelled time over that of the cheapest mesh that fits.
    pub cost: f64,
    /// Largest and mean modelled cost of a mode group, as a ratio.
    pub imbalance: f64,
    /// Part of the modelled time that splitting space adds: the exchange of ghosts, and a solver's further iterations.
    pub split: f64,
    /// Planned bytes on the fullest rank.
    pub memory: u64,
    /// Whether that is within the memory of a rank.
    pub fits: bool,
}

/// What to ask for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Advice {
    /// The meshes, those that fit first, the cheapest first.
    pub meshes: Vec<Candidate>,
    /// The node.
    pub node: Option<Node>,
    /// Nodes that the ranks take.
    pub nodes: Option<usize>,
    /// Planned bytes on a full node, each of its ranks as the fullest.
    pub memory_per_node: Option<u64>,
    /// Where the memory of a rank is known: the most points `N_p` of which a run on the plan's mesh can keep all modes. One that drops
    /// them takes as much memory for any `N_p`.
    pub largest_points: Option<usize>,
}

/// The largest even number from 2 to `most` whose `memory` is within `limit`; `memory` does not fall.
fn largest_points(most: usize, limit: u64, memory: impl Fn(usize) -> u64) -> Option<usize> {
    let fits = |half: usize| memory(2 * half) <= limit;
    let (mut low, mut high) = (0, most / 2 + 1);
    while high - low > 1 {
        let middle = low.midpoint(high);
        if fits(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    Some(2 * low).filter(|points| *points > 0)
}

impl Advice {
    /// For `plan`, where a rank may take `limit` bytes and a node is `node`.
    pub fn new(case: &Case, plan: &Plan, limit: Option<u64>, node: Option<Node>) -> Self {
        let (warp, ranks) = (plan.warp.as_ref(), plan.layout.mesh.ranks());
        let bounds: &Bounds = &plan.bounds;
        let mut meshes: Vec<Candidate> = Layout::every(case, bounds, warp, ranks)
            .map(|layout| {
                let (rows, split) = layout.rows(case, warp);
                let memory = layout.memory();
                Candidate {
                    cost: layout.cost(case, warp),
                    imbalance: layout.imbalance,
                    split: split / (rows + split),
                    memory,
                    fits: limit.is_none_or(|limit| memory <= limit),
                    groups: layout.mesh.groups,
                    space: layout.mesh.space,
                }
            })
            .collect();
        meshes.sort_by(|a, b| (b.fits.cmp(&a.fits)).then(a.cost.total_cmp(&b.cost)));
        let least = meshes.first().map_or(1.0, |best| best.cost);
        if least > 0.0 {
            meshes.iter_mut().for_each(|mesh| mesh.cost /= least);
        }
        let nodes = node.map(|node| ranks.div_ceil(node.ranks));
        let full = node.map(|node| node.ranks.min(ranks) as u64 * plan.memory());
        Self {
            meshes,
            node,
            nodes,
            memory_per_node: full,
            largest_points: limit.zip(warp).and_then(|(limit, warp)| {
                let layout = &plan.layout;
                let memory = |points| layout.memory_of_points(case, bounds, warp, points);
                largest_points(2 * MOST_MODES - 2, limit, memory)
            }),
        }
    }
}

impl fmt::Display for Advice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let (Some(node), Some(nodes), Some(memory)) =
            (self.node, self.nodes, self.memory_per_node)
        {
            writeln!(
                f,
                "nodes           {nodes} of {} ranks: {} of {} on a full one",
                node.ranks,
                bytes_text(memory),
                bytes_text(node.memory)
            )?;
        }
        if let Some(points) = self.largest_points {
            writeln!(
                f,
                "largest N_p     {points}{} with all modes kept (--mode full) on this mesh; as many as wanted streamed",
                match 1usize << points.ilog2() {
                    power if power < points => format!(" (2^{} = {power})", points.ilog2()),
                    _ => String::new(),
                }
            )?;
        }
        for (k, mesh) in self.meshes.iter().take(SHOWN).enumerate() {
            let blocks: Vec<String> = mesh.space.iter().map(usize::to_string).collect();
            writeln!(
                f,
                "{:<16}--ranks-x {:<7} time {:.2}: imbalance of the groups {:.3}, exchange {:.0} %, {} a rank{}",
                if k == 0 { "suggested mesh" } else { "" },
                blocks.join(","),
                mesh.cost,
                mesh.imbalance,
                100.0 * mesh.split,
                bytes_text(mesh.memory),
                if mesh.fits {
                    ""
                } else {
                    ", more than it may take"
                }
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Resources;

    #[test]
    fn the_largest_number_of_points_just_fits() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("cases/example3.toml");
        let sets = |points: usize, method: &str| {
            [
                format!("solver.warp.points={points}"),
                "solver.warp.profile=exponential".to_owned(),
                "solver.tolerance=0.1".to_owned(),
                "output.warped_field=true".to_owned(),
                format!("solver.propagator={method}"),
            ]
        };
        for method in [
            "{method='chebyshev'}",
            "{method='crank-nicolson',step=0.05}",
        ] {
            for (ranks, limit) in [(1, 100 << 20), (3, 64 << 20), (8, 80 << 20)] {
                let resources = Resources {
                    ranks,
                    ..Resources::default()
                };
                let plan = |points: usize, space: Option<Vec<usize>>| {
                    let case = Case::load(&path, &sets(points, method)).expect("a case");
                    let resources = Resources {
                        ranks_x: space,
                        ..resources.clone()
                    };
                    let plan = Plan::new(&case, &resources, 1.5).expect("a plan");
                    (case, plan)
                };
                let (case, first) = plan(64, None);
                let advice = Advice::new(&case, &first, Some(limit), None);
                let points = advice.largest_points.expect("some fit");
                // As a plan for so many points says itself; groups differ by a batch or two.
                let space = Some(first.layout.mesh.space.clone());
                assert!(plan(points, space.clone()).1.memory() <= limit);
                let more = points + 32 * ranks;
                assert!(plan(more, space).1.memory() > limit, "{points}");
            }
        }
    }
}
