//! Streamed runs: modes are propagated on all ranks, and fields are recovered from them.

use crate::pieces::gather_field;
use crate::support::prepared::{Prepared, parts, resources};
use phasewarp::base::error::Result;
use phasewarp::base::progress::Progress;
use phasewarp::matrix::lanes::LANES;
use phasewarp::matrix::observables::{MomentsOf, VelocityFactors};
use phasewarp::parallel::communicator::World;
use phasewarp::parallel::partition::ProcessMesh;
use phasewarp::plan::Plan;
use phasewarp::plan::balance::Batch;
use phasewarp::problem::case::Case;
use phasewarp::schrodingerization::warp_plan::WarpPlan;
use phasewarp::solve::modes;
use phasewarp::solve::modes::RunHooks;
use phasewarp::solve::stage::{RecoveredFields, Task};
use std::ops::Range;

/// A streamed run of a case on a mesh.
#[derive(Clone)]
pub struct StreamedRun<'a> {
    pub case: &'a Case,
    pub mesh: &'a ProcessMesh,
    /// The largest `‖u(0)‖/‖f(t)‖` that is planned for.
    pub ratio: f64,
    /// The fields of the case that the run propagates.
    pub fields: Range<usize>,
    /// A function that gives the batches of a mode group.
    pub batches: fn(&Plan, usize) -> Vec<Batch>,
}

/// The result of a streamed run on this rank.
pub struct Streamed {
    pub plan: WarpPlan,
    /// The applications, or solves, that are planned for this rank's batches.
    pub planned: usize,
    pub recovered: RecoveredFields,
}

impl<'a> StreamedRun<'a> {
    /// A run of all fields in the batches of the plan.
    pub fn new(case: &'a Case, mesh: &'a ProcessMesh, ratio: f64) -> Self {
        Self { case, mesh, ratio, fields: 0..case.fields.len(), batches: planned }
    }

    /// Runs a method that needs exactly the planned applications.
    pub fn run_as_planned(&self, world: &World, prepared: &mut Prepared) -> Streamed {
        let run = self.run(world, prepared);
        assert_eq!(run.applications(prepared), run.plan.applications);
        run
    }

    pub fn run(&self, world: &World, prepared: &mut Prepared) -> Streamed {
        let run = self.attempt(world, prepared).expect("a unitary run");
        assert!(run.recovered.unitarity_defect.unwrap_or(0.0) <= 1.0);
        run
    }

    /// A run that may fail.
    pub fn attempt(&self, world: &World, prepared: &mut Prepared) -> Result<Streamed> {
        let resources = resources(world, self.mesh);
        let plan = Plan::with_bounds(self.case, prepared.bounds.clone(), &resources, self.ratio)
            .expect("a plan");
        assert_eq!(plan.layout.mesh, *self.mesh);
        let warp = plan.warp.as_ref().expect("a schrodingerized run");
        let shares = prepared.rank_cells.ranges.clone();
        let batches = (self.batches)(&plan, prepared.communicator.modes.rank());
        let modes = batches.iter().flat_map(|batch| &batch.modes);
        let planned = modes.map(|&l| warp.work[l]).sum();
        let factors = VelocityFactors::new(&self.case.space);
        let mut parts = parts(prepared, self.case.end);
        let mut propagator = parts.propagator(&plan);
        let moments = MomentsOf { factors: &factors, pi: parts.pi, least: 1.0 };
        let recovered = modes::run(
            &Task {
                communicator: parts.communicator,
                warp,
                legs: &warp.legs,
                batches: &batches,
                initial: &parts.initial[self.fields.clone()],
                shares: &shares,
                moments: Some(&moments),
            },
            &mut parts.evolution,
            &mut *propagator,
            &mut Progress::silent(),
            RunHooks::default(),
        );
        let plan = plan.warp.expect("a schrodingerized run");
        Ok(Streamed { recovered: recovered?, planned, plan })
    }
}

impl Streamed {
    /// The number of applications on all ranks.
    pub fn applications(&self, prepared: &Prepared) -> usize {
        prepared.communicator.modes.sum_count(self.recovered.applications)
    }

    /// The whole first field of each reading, on every rank.
    pub fn fields(&self, world: &World, prepared: &Prepared) -> Vec<Vec<f64>> {
        let shares = self.recovered.fields[0].each();
        shares.map(|share| gather_field(world, prepared, share)).collect()
    }
}

/// The batches of the plan.
pub fn planned(plan: &Plan, group: usize) -> Vec<Batch> {
    plan.layout.groups[group].clone()
}

/// Mixed batches: the groups get the modes in turn, in batches of 1 to 8 modes without order.
pub fn mixed(plan: &Plan, group: usize) -> Vec<Batch> {
    let modes = plan.warp.as_ref().map_or(0, |warp| warp.modes);
    let groups = plan.layout.groups.len();
    let mut mine: Vec<usize> = (0..modes).filter(|l| l % groups == group).collect();
    // Modes that are far apart become neighbours.
    mine.sort_by_key(|l| (7 * l) % 11);
    let mut batches = Vec::new();
    while !mine.is_empty() {
        let count = (batches.len() % LANES + 1).min(mine.len());
        let modes: Vec<usize> = mine.drain(..count).collect();
        batches.push(Batch { modes, cost: 0 });
    }
    batches
}
