//! Resources to request from a batch system: the process mesh, and the memory of a node.

use crate::base::text::{bytes_text, counted, joined};
use crate::plan::Plan;
use crate::plan::layout::{BlockRows, Layout, Resources};
use crate::problem::case::Case;
use crate::problem::limits::MOST_POINTS;
use crate::schrodingerization::warp_plan::WarpPlan;
use serde::Serialize;
use std::fmt;

/// Largest number of meshes that are printed.
const SHOWN: usize = 4;

/// A node of the machine that a run is planned for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MachineNode {
    /// Bytes for all ranks on it, if known.
    pub memory: Option<u64>,
    /// Ranks on it.
    pub ranks: usize,
}

impl MachineNode {
    /// Number of nodes for `ranks` ranks.
    pub fn count(&self, ranks: usize) -> usize {
        ranks.div_ceil(self.ranks)
    }

    /// Bytes on a full node, each of its ranks taking `memory`.
    pub fn filled(&self, ranks: usize, memory: u64) -> u64 {
        self.ranks.min(ranks) as u64 * memory
    }

    /// Bytes for each of `ranks` ranks, if its memory is known. On a node that is not full each
    /// rank has more.
    pub fn share(&self, ranks: usize) -> Option<u64> {
        Some(self.memory? / self.ranks.min(ranks) as u64)
    }
}

/// A process mesh that the ranks can form.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MeshCandidate {
    /// Blocks along each x-axis, as for `--ranks-x`.
    pub space: Vec<usize>,
    /// Mode groups.
    pub groups: usize,
    /// Modelled time over that of the first mesh.
    pub cost: f64,
    /// Largest modelled cost of a mode group over the mean.
    pub imbalance: f64,
    /// Part of the modelled time that splitting space adds: ghost exchange, and more iterations of
    /// a solver.
    #[serde(rename = "split")]
    pub exchange: f64,
    /// Planned bytes on the fullest rank.
    pub memory: u64,
    /// Whether the planned bytes fit into the memory of a rank.
    pub fits: bool,
}

/// The resources to request.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JobRequest {
    /// The meshes: the default one of a run, then the others that fit, the cheapest first.
    pub meshes: Vec<MeshCandidate>,
    /// Modelled time of the plan's own mesh, for all fields: rows times applications of the rank
    /// with most to do. Ghost exchange counts as rows.
    pub row_applications: f64,
    /// The node.
    pub node: Option<MachineNode>,
    /// Number of nodes for the ranks.
    pub nodes: Option<usize>,
    /// Planned bytes on a full node, if each of its ranks takes as much as the fullest.
    pub memory_per_node: Option<u64>,
    /// The most points `N_p` with which a run can keep all modes, for whatever `N_p` this one has.
    /// The memory of a run that drops its modes does not depend on `N_p`.
    pub largest_points: Option<usize>,
    /// Blocks along each x-axis of the mesh for this `N_p`.
    pub largest_points_mesh: Option<Vec<usize>>,
    /// Bytes a rank may take for this: the given limit, or else the memory of this machine.
    pub largest_points_memory: u64,
    /// Whether the limit was given.
    pub memory_given: bool,
    /// Whether `solver.warp.points` can be given.
    pub takes_points: bool,
}

impl JobRequest {
    /// The request for `plan` on `resources` and nodes like `node`. On this machine each of as many
    /// ranks would have `here` bytes.
    pub fn new(
        case: &Case,
        plan: &Plan,
        resources: &Resources,
        node: Option<MachineNode>,
        here: u64,
    ) -> Self {
        let limit = resources.memory_per_rank;
        let (work, ranks) = (plan.work(case), plan.layout.mesh.ranks());
        let memory = limit.unwrap_or(here);
        let known = Resources { memory_per_rank: Some(memory), ..resources.clone() };
        let (largest_points, largest_points_mesh) = Layout::largest_points(work, &known)
            .map(|found| (found.points, found.mesh.space))
            .unzip();
        let cells_of_fields = (case.space.cells() * case.fields.len()) as f64;
        Self {
            meshes: mesh_candidates(case, plan, resources),
            row_applications: plan.layout.cost(work) * cells_of_fields,
            node,
            nodes: node.map(|node| node.count(ranks)),
            memory_per_node: node.map(|node| node.filled(ranks, plan.memory())),
            largest_points,
            largest_points_mesh,
            largest_points_memory: memory,
            memory_given: limit.is_some(),
            takes_points: work.warp.is_some_and(WarpPlan::takes_points),
        }
    }
}

/// The meshes of the ranks of `plan`: that of the run first, then the cheapest that fits.
fn mesh_candidates(case: &Case, plan: &Plan, resources: &Resources) -> Vec<MeshCandidate> {
    let (work, limit) = (plan.work(case), resources.memory_per_rank);
    let candidate = |layout: Layout| {
        let BlockRows { own, exchange } = layout.rows(work);
        let memory = layout.memory();
        MeshCandidate {
            cost: layout.cost(work),
            imbalance: layout.imbalance,
            exchange: exchange / (own + exchange),
            memory,
            fits: limit.is_none_or(|limit| memory <= limit),
            groups: layout.mesh.groups,
            space: layout.mesh.space,
        }
    };
    let layouts = Layout::every(work, plan.layout.mesh.ranks());
    let mut meshes: Vec<MeshCandidate> = layouts.map(candidate).collect();
    // A mesh cheaper than that of the run is chosen only if it saves enough.
    let chosen =
        |mesh: &MeshCandidate| resources.ranks_x.is_none() && mesh.space == plan.layout.mesh.space;
    meshes.sort_by(|a, b| {
        let fits = chosen(b).cmp(&chosen(a)).then(b.fits.cmp(&a.fits));
        fits.then(a.cost.total_cmp(&b.cost))
    });
    let first = meshes.first().map_or(1.0, |first| first.cost);
    if first > 0.0 {
        meshes.iter_mut().for_each(|mesh| mesh.cost /= first);
    }
    meshes
}

impl fmt::Display for JobRequest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let (Some(node), Some(nodes), Some(memory)) =
            (self.node, self.nodes, self.memory_per_node)
        {
            let of = node.memory.map_or(String::new(), |all| format!(" of {}", bytes_text(all)));
            writeln!(
                f,
                "nodes           {nodes} of {}: {}{of} on a full one",
                counted(node.ranks, "rank", "ranks"),
                bytes_text(memory),
            )?;
        }
        if let (Some(points), Some(space)) = (self.largest_points, &self.largest_points_mesh) {
            let power = 1usize << points.ilog2();
            writeln!(
                f,
                "largest N_p     {points}{} with all modes kept, --mode full --ranks-x {}, in {} a \
                rank{}. A run that drops its modes, --mode streamed, takes any N_p.{}",
                match points {
                    MOST_POINTS => " (the program's own limit)".to_owned(),
                    _ if power < points => format!(" (2^{} = {power})", points.ilog2()),
                    _ => String::new(),
                },
                joined(space, ","),
                bytes_text(self.largest_points_memory),
                if self.memory_given { "" } else { " (free on this machine)" },
                if self.takes_points {
                    ""
                } else {
                    " The profile of this case fixes N_p: to choose it, give another \
                solver.warp.profile and solver.warp.points."
                },
            )?;
        }
        for (k, mesh) in self.meshes.iter().take(SHOWN).enumerate() {
            writeln!(
                f,
                "{:<16}--ranks-x {:<7} time {:.2}: imbalance {:.3}, exchange {:.0} %, {} a rank{}",
                if k == 0 { "suggested mesh" } else { "" },
                joined(&mesh.space, ","),
                mesh.cost,
                mesh.imbalance,
                100.0 * mesh.exchange,
                bytes_text(mesh.memory),
                if mesh.fits { "" } else { ", more than it may take" }
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::layout::Resources;
    use crate::plan::memory::PlannedWork;

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
        for method in ["{method='chebyshev'}", "{method='crank-nicolson',step=0.05}"] {
            for (ranks, limit) in [(1, 100 << 20), (3, 64 << 20), (8, 80 << 20)] {
                let resources = Resources { ranks, ..Resources::default() };
                let plan = |points: usize, space: Option<Vec<usize>>| {
                    let case = Case::load(&path, &sets(points, method)).expect("a case");
                    let resources = Resources { ranks_x: space, ..resources.clone() };
                    let plan = Plan::new(&case, &resources, 1.5).expect("a plan");
                    (case, plan)
                };
                let (case, first) = plan(64, None);
                let limited = Resources { memory_per_rank: Some(limit), ..resources.clone() };
                let request = JobRequest::new(&case, &first, &limited, None, 0);
                let points = request.largest_points.expect("some fit");
                // A plan for so many points agrees; groups differ by a batch or two.
                let space = request.largest_points_mesh.clone();
                assert!(plan(points, space).1.memory() <= limit);
                let more = points + 32 * ranks;
                let work = PlannedWork { warp: None, ..first.work(&case) };
                let meshes = Layout::every(work, ranks);
                for space in meshes.map(|layout| layout.mesh.space) {
                    assert!(plan(more, Some(space)).1.memory() > limit, "{points}");
                }
                // The same number for any request, and in the refusal of too many points.
                let (case, other) = plan(points / 4 * 2, None);
                let again = JobRequest::new(&case, &other, &limited, None, 0);
                assert_eq!(again.largest_points, Some(points));
                let case = Case::load(&path, &sets(more, method)).expect("a case");
                let refused = Plan::new(&case, &limited, 1.5).expect_err("too many");
                for words in
                    ["--mode streamed", "solver.warp.points", &format!("at most {points} fit")]
                {
                    assert!(refused.to_string().contains(words), "{refused}");
                }
            }
        }
    }
}
