//! `phasewarp resources`: what the case takes on a quantum computer.

use crate::case::{Case, Method};
use crate::communicator::{Communicator, World};
use crate::error::{Error, Result};
use crate::partition::Block;
use crate::plan::{Bounds, Plan, Resources};
use crate::problem::Problem;
use crate::quantum::access::largest_parts;
use crate::quantum::optimise::{Ranking, System, choices, deltas};
use crate::quantum::probability::Norms;
use crate::quantum::resources::Record;
use crate::run;

/// Assembles `case` on all ranks and counts. Collective.
///
/// # Errors
/// [`Error::Input`] for a classical case; as [`Problem::new`] and [`Plan::new`].
pub fn count(world: &World, case: &Case) -> Result<Record> {
    has_counts(case)?;
    let mut system = Assembled::new(world, case)?;
    let plan = Plan::with_bounds(case, system.bounds.clone(), &system.here, system.ratio)?;
    let Some(warp) = &plan.warp else {
        return Err(Error::Input(format!(
            "{}: nothing is planned by modes",
            case.name
        )));
    };
    let norms = system.norms(case);
    let problem = (&system.problem, norms);
    Record::new(
        case,
        (&system.bounds, warp),
        problem,
        &system.communicator.space,
    )
}

/// Every choice of profile, recovery point and `δ`, the cheapest first. Collective.
///
/// # Errors
/// As [`count`].
pub fn optimise(world: &World, case: &Case) -> Result<Ranking> {
    has_counts(case)?;
    let mut all = Vec::new();
    let own = Assembled::new(world, case)?;
    let inflow = own.problem.matrix.inflow.iter();
    let largest = inflow
        .flat_map(|aux| aux.values)
        .fold(0.0, |m: f64, b| m.max(b.abs()));
    let largest = own.communicator.space.max(largest);
    drop(own);
    for delta in deltas(case, largest) {
        let mut case = case.clone();
        case.warp.delta = delta;
        let mut system = Assembled::new(world, &case)?;
        let norms = system.norms(&case);
        let (s, k, nonzeros) = largest_parts(&system.problem.matrix);
        let space = &system.communicator.space;
        all.extend(choices(&System {
            case: &case,
            bounds: &system.bounds,
            ratio: system.ratio,
            norms,
            matrix: (space.max(s), space.max(k), space.max_count(nonzeros)),
        }));
    }
    Ok(Ranking::new(all))
}

/// Refuses what the paper's counts are not for.
fn has_counts(case: &Case) -> Result<()> {
    if case.method == Method::Classical {
        let what = "solver.method = \"classical\" has no quantum side; \"schrodingerized\" has";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    if case.varies() {
        let what =
            "inflow.value depends on t; the paper's counts are for a generator that does not";
        return Err(Error::Input(format!("{}: {what}", case.name)));
    }
    Ok(())
}

/// A case assembled on all ranks, with what is measured before a plan is made.
struct Assembled {
    here: Resources,
    communicator: Communicator,
    problem: Problem,
    bounds: Bounds,
    ratio: f64,
}

impl Assembled {
    fn new(world: &World, case: &Case) -> Result<Self> {
        run::refuse_hopeless_here(world, case)?;
        let all = world.group();
        let here = Resources {
            ranks: all.size(),
            ranks_x: None,
            memory_per_rank: Some(run::memory_per_rank(&all)),
        };
        let bounds = Bounds::new(case)?;
        let expected = Plan::provisional(case, &bounds, &here)?;
        let (mesh, patience) = (&expected.layout.mesh, expected.patience());
        let communicator = Communicator::new(world, mesh);
        let block = Block::new(&case.space, mesh, communicator.space.rank());
        let mut problem = Problem::new(case, &bounds, &communicator, block, (1, patience))?;
        let bounds = problem.bounds(case, &bounds);
        let ratio = problem.probe(&communicator, bounds.rate, &case.legs());
        Ok(Self {
            here,
            communicator,
            problem,
            bounds,
            ratio,
        })
    }

    fn norms(&mut self, case: &Case) -> Norms {
        let rate = self.bounds.rate;
        self.problem.rough_norms(&self.communicator, rate, case.end)
    }
}
