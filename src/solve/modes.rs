//! The Schrödingerized run: modes are propagated batch by batch, added to the recovered field, and
//! dropped.
//!
//! It needs memory for a few phase-space vectors and the sums of one field at a time, and some
//! hundred bytes for the plan of each mode. Contributions of modes are added in fixed point (see
//! [`crate::base::fixed_point`]), so the result has the same bits for any mode groups, any batches
//! of independent modes and any order.
//!
//! A run has *legs*, from one output time to the next, or past output times that need moments only
//! (see [`crate::propagate::intermediate_moments`]). It consists of *stages*, each a pass over all
//! modes of a field. In a stage of a streamed run, a batch takes all legs one after the other; in a
//! stage of a full run, which stores the modes, it takes one leg. Both treat a mode alike, so that
//! their results have the same bits.

use crate::base::error::Result;
use crate::base::memory;
use crate::base::progress::Progress;
use crate::matrix::lanes::Lanes;
use crate::plan::balance::{self, Batch};
use crate::propagate::evolution::{Evolution, SeriesSize};
use crate::propagate::intermediate_moments::IntermediateMoments;
use crate::propagate::method::Propagator;
use crate::solve::batch::{BatchDestination, add_batch};
use crate::solve::checkpoint::watch::RankState;
use crate::solve::checkpoint::{Checkpoints, ResumePoint};
use crate::solve::rank_modes::ModeProgress;
use crate::solve::stage::{FullRunModes, LegEnd, RecoveredFields, Stage, StageBatches, Task};
use crate::solve::statistics::BatchStatistics;
use std::ops::Range;
use std::time::Instant;

/// Optional tasks of a run beside recovering fields: storing modes, writing checkpoints.
#[derive(Default)]
pub struct RunHooks<'r, 'k, 'c> {
    /// The modes that a full run stores. A streamed run drops them.
    pub keeping: Option<&'r mut FullRunModes<'k>>,
    /// Checkpoints that are made, and the one that the run continues from.
    pub checkpoints: Option<&'r mut Checkpoints<'c>>,
}

/// Runs the task, field after field. Collective.
///
/// # Errors
/// [`Error::Unitarity`] when a mode's norm changed by more than its method allows;
/// [`Error::Stopped`] and others as [`Checkpoints::write_if_due`]; errors of
/// [`FullRunModes::after`].
///
/// [`Error::Unitarity`]: crate::base::error::Error::Unitarity
/// [`Error::Stopped`]: crate::base::error::Error::Stopped
pub fn run(
    task: &Task<'_>,
    system: &mut Evolution<'_>,
    propagator: &mut dyn Propagator,
    progress: &mut Progress,
    mut hooks: RunHooks<'_, '_, '_>,
) -> Result<RecoveredFields> {
    let resumed = hooks.checkpoints.as_mut().and_then(|c| c.resumed.take());
    // Whether batches start from stored modes instead of a field at time zero.
    let begun = hooks.keeping.as_ref().is_some_and(|keeping| keeping.begun);
    let between = if begun || task.legs.len() > 1 { system.matrix.rows() } else { 0 };
    let legs = task.legs.len();
    let times = task.legs.iter().map(|leg| leg.passed.len()).max().unwrap_or(0);
    let matrix = system.matrix;
    let passed = task.moments.filter(|_| times > 0).map(|moments| {
        let size = SeriesSize {
            largest_degree: task.warp.largest_work(),
            applications: task.initial.len() * balance::applications(task.batches),
        };
        IntermediateMoments::new(matrix, moments, times, size)
    });
    let at_once = if hooks.keeping.is_some() { 1 } else { legs };
    let stages: Vec<(usize, usize)> = (0..task.initial.len())
        .flat_map(|k| (0..legs).step_by(at_once).map(move |leg| (k, leg)))
        .collect();
    let first = resumed.as_ref().map_or(0, |r| r.generation.state.stage);
    let mut run = StagedModes {
        task,
        system,
        propagator,
        progress,
        keeping: hooks.keeping,
        checkpoints: hooks.checkpoints,
        between: vec![Lanes::ZERO; between],
        passed,
        before: BatchStatistics::default(),
        statistics: BatchStatistics::default(),
        recovered: RecoveredFields::default(),
    };
    for (number, &(k, leg)) in stages.iter().enumerate().skip(first) {
        let from = resumed.as_ref().filter(|_| number == first);
        run.stage(number, k, leg..leg + at_once, from)?;
        memory::mark();
    }
    Ok(run.counted())
}

/// The state of a run by modes while it passes through the stages.
struct StagedModes<'r, 'a, 's, 'k, 'c> {
    task: &'r Task<'a>,
    system: &'r mut Evolution<'s>,
    propagator: &'r mut dyn Propagator,
    progress: &'r mut Progress,
    keeping: Option<&'r mut FullRunModes<'k>>,
    checkpoints: Option<&'r mut Checkpoints<'c>>,
    /// The state of a batch between two legs.
    between: Vec<Lanes>,
    /// The moments of a batch at the times that a leg passes.
    passed: Option<IntermediateMoments<'a>>,
    /// The counts before the checkpoint that the run continues from.
    before: BatchStatistics,
    /// The counts since the beginning.
    statistics: BatchStatistics,
    recovered: RecoveredFields,
}

impl StagedModes<'_, '_, '_, '_, '_> {
    /// Runs stage number `number`, of field `k`: all its batches, or those that the checkpoint
    /// left. Collective.
    fn stage(
        &mut self,
        number: usize,
        k: usize,
        legs: Range<usize>,
        from: Option<&ResumePoint<'_>>,
    ) -> Result<()> {
        let task = self.task;
        let leg = legs.start;
        let mut stage = Stage::new(task, self.system, self.propagator, k, legs);
        if let Some(keeping) = self.keeping.as_deref_mut()
            && leg == 0
            && !keeping.begun
        {
            let start = ModeProgress::start(task.initial[k].norms[0]);
            keeping.kept.progress_mut().fill(start);
        }
        let mut finished = Vec::with_capacity(task.warp.modes);
        if let Some(resumed) = from {
            self.resume(&mut stage, resumed, &mut finished)?;
        }
        let batches = from.map_or(task.batches, |resumed| &resumed.batches);
        let outcome = self.batches(number, &mut stage, batches, &mut finished)?;
        task.communicator.world.agree(outcome)?;
        // All arrays of the stage are there.
        memory::mark();
        stage.finish(task, self.system.matrix.block.velocity_cells, &mut self.recovered);
        match self.keeping.as_deref_mut() {
            Some(keeping) => (keeping.after)(LegEnd { field: k, leg }, keeping.kept),
            None => Ok(()),
        }
    }

    /// Restores the contents of the checkpoint. Collective.
    fn resume(
        &mut self,
        stage: &mut Stage<'_>,
        resumed: &ResumePoint<'_>,
        finished: &mut Vec<usize>,
    ) -> Result<()> {
        let task = self.task;
        let kept = self.keeping.as_deref_mut().map(|keeping| &mut *keeping.kept);
        let read = stage.resume(resumed, task, self.system.matrix, kept, &mut self.recovered);
        task.communicator.world.agree(read)?;
        if task.communicator.modes.is_first() {
            let state = &resumed.generation.state;
            self.before = state.statistics.clone();
            finished.extend_from_slice(&state.finished);
        }
        self.statistics = self.before.clone();
        Ok(())
    }

    /// Propagates the batches one after the other, with checkpoints between them. The inner result
    /// is the error of a batch on this rank only; the ranks have not agreed on it yet. Collective.
    fn batches(
        &mut self,
        number: usize,
        stage: &mut Stage<'_>,
        batches: &[Batch],
        finished: &mut Vec<usize>,
    ) -> Result<Result<()>> {
        let task = self.task;
        let mut batches = batches.iter();
        let mut outcome: Result<()> = Ok(());
        loop {
            let standing = match (&outcome, batches.len()) {
                (Err(e), _) if e.is_interruption() => RankState::Left,
                (Err(_), _) => RankState::Failed,
                (Ok(()), 0) => RankState::Finished,
                _ => RankState::Working,
            };
            let over = match self.checkpoints.as_mut() {
                Some(checkpoints) => checkpoints.write_if_due(standing, || {
                    let statistics = &self.statistics;
                    let batches = StageBatches { stage: number, finished, statistics };
                    let kept = self.keeping.as_ref().map(|keeping| &*keeping.kept);
                    stage.snapshot(&batches, task, self.system.matrix, kept, &self.recovered)
                })?,
                None => standing != RankState::Working,
            };
            if over {
                // The error is one of another rank.
                return Ok(outcome.or_else(|e| if e.is_interruption() { Ok(()) } else { Err(e) }));
            }
            let Some(batch) = batches.next().filter(|_| outcome.is_ok()) else {
                continue;
            };
            let started = Instant::now();
            let destination = BatchDestination {
                stage,
                between: &mut self.between,
                passed: self.passed.as_mut(),
                keeping: self.keeping.as_deref_mut(),
                statistics: &mut self.statistics,
            };
            outcome = add_batch(task, self.system, self.propagator, batch, destination);
            self.recovered.busy_seconds += started.elapsed().as_secs_f64();
            if outcome.is_ok() {
                finished.extend_from_slice(&batch.modes);
                let done = |legs: usize| batch.cost * legs / task.legs.len();
                self.progress.advance(done(stage.legs.end) - done(stage.legs.start));
            }
        }
    }

    /// The recovered fields and the counters. Collective.
    fn counted(self) -> RecoveredFields {
        let Self { task, before, statistics, mut recovered, .. } = self;
        let world = &task.communicator.world;
        // A rank without batches has neither defect nor norm.
        let smallest = -world.max(-statistics.least_norm_ratio.unwrap_or(f64::INFINITY));
        let largest = world.max(statistics.defect.unwrap_or(-1.0));
        recovered.unitarity_defect = Some(largest).filter(|d| *d >= 0.0);
        recovered.norm_kept = Some(smallest).filter(|r| r.is_finite());
        recovered.applications = statistics.applications;
        recovered.applications_here = statistics.applications - before.applications;
        recovered.solves = statistics.solves;
        recovered
    }
}
