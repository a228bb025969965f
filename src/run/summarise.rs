//! Fills the summary from the plan, the semi-discrete system and the log.

use crate::base::memory;
use crate::base::stopwatch::Stopwatch;
use crate::base::version::GIT;
use crate::matrix::instruction_set::InstructionSet;
use crate::parallel::communicator::Group;
use crate::results::summary::Summary;
use crate::run::log::RunLog;
use crate::solve::prepared::Prepared;

impl Summary {
    /// Sets the numbers of plan, system and log. Collective.
    pub(crate) fn fill(&mut self, prepared: &Prepared, log: &RunLog) {
        let Prepared { case, plan, system, communicator, .. } = prepared;
        self.title = case.title.clone();
        self.version = env!("CARGO_PKG_VERSION").to_owned();
        self.git = GIT.to_owned();
        self.method = Some(case.method);
        self.interface = Some(case.scheme.interface);
        self.ranks = communicator.world.size();
        self.space_blocks = plan.layout.mesh.space.clone();
        self.mode_groups = plan.layout.mesh.groups;
        self.imbalance = plan.warp.as_ref().map(|_| plan.layout.imbalance);
        self.instruction_set = InstructionSet::here().name().to_owned();
        self.cells = plan.cells;
        self.reductions = plan.reductions.clone();
        self.distinct_rows = communicator.space.sum_count(system.matrix.distinct_rows());
        self.inflow_unknowns = system.norm_terms - case.space.space_cells();
        self.modes = plan.warp.as_ref().map_or(0, |warp| warp.modes);
        self.points = plan.warp.as_ref().and_then(|warp| warp.points);
        self.tolerance = case.tolerance;
        self.memory_planned_bytes_per_rank = plan.memory();
        self.growth_bound = plan.bounds.growth;
        self.decay_bound = plan.bounds.decay;
        if let Some(schedule) = &system.schedule {
            self.time_steps = Some(schedule.steps);
            self.time_error = Some(schedule.error);
        }
        self.growth_certificate = system.weights.certificate;
        self.weight_spread = system.weights.spread;
        self.weight_sweeps = system.weights.sweeps;
        self.warnings = log.warnings.clone();
        self.warnings_printed = log.printed;
    }

    /// Sets the numbers of the end: seconds, and peak memory. Collective.
    pub(crate) fn finish(&mut self, world: &Group, watch: &Stopwatch) {
        let peak = memory::peak();
        let [resident, anonymous] = [peak.resident, peak.anonymous];
        self.memory_peak_bytes_per_rank = world.max_count(resident as usize) as u64;
        self.memory_anonymous_bytes_per_rank = world.max_count(anonymous as usize) as u64;
        self.solve_seconds = watch.seconds.get("solve").copied().unwrap_or(0.0);
        self.wall_seconds = watch.started.elapsed().as_secs_f64();
        self.seconds = watch.seconds.clone();
    }
}
