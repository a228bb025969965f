//! The Schrödingerized run: modes are propagated batch by batch, added to what is recovered, and
//! dropped.
//!
//! Memory is a few phase-space vectors, whatever the number of modes, and the sums of one field at
//! a time. Contributions of modes are added in fixed point (see [`crate::base::fixed_point`]), so
//! the result has the same bits for any mode groups, any batches of independent modes and any
//! order.
//!
//! A run has *legs*, from one output time to the next, or past some at which moments are all that
//! is wanted (see [`crate::propagate::passed`]). It goes in *stages*, each a pass over all
//! modes of a field: of a streamed run, in which a batch takes all legs one after the other; of a
//! full one, which keeps the modes, in which it takes one. Both do the same with a mode, so that
//! their results have the same bits.

use crate::base::error::{Error, Result};
use crate::base::progress::Progress;
use crate::matrix::lanes::{LANES, Lanes};
use crate::matrix::observables::MomentsOf;
use crate::parallel::communicator::Communicator;
use crate::plan::balance::Batch;
use crate::problem::legs::Leg;
use crate::propagate::evolution::{BatchSpec, Evolution, Initial, Start};
use crate::propagate::method::{BatchReport, Propagator};
use crate::propagate::passed::PassedMoments;
use crate::schrodingerization::recovery::Reading;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::checkpoint::watch::Standing;
use crate::solve::checkpoint::{Checkpoints, Resumed};
use crate::solve::kept::{KeptModes, ModeProgress};
use crate::solve::statistics::BatchStatistics;
use crate::solve::sum::Sum;
use num_complex::Complex64;
use std::ops::Range;
use std::time::Instant;

/// What round-off may add to the change of a mode's norm, each leg.
const UNITARITY_ROUND_OFF: f64 = 1e-12;

/// What a run is to do on this rank.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    /// The process mesh.
    pub communicator: &'a Communicator,
    /// Profile, modes, readings.
    pub warp: &'a WarpPlan,
    /// How long each leg takes, and what is read at its end; at that of the last all readings are.
    pub legs: &'a [Leg],
    /// The batches of this rank's mode group.
    pub batches: &'a [Batch],
    /// The fields at time zero.
    pub initial: &'a [Initial<'a>],
    /// `shares[g]`: the block's cells that rank `g` of the mode groups keeps of the results.
    pub shares: &'a [Range<usize>],
    /// How moments follow, where no more than them is wanted at a time.
    pub moments: Option<&'a MomentsOf<'a>>,
}

/// What was recovered, on this rank's share of the block's cells.
#[derive(Clone, Debug, Default)]
pub struct Recovered {
    /// `fields[k][r]`: `ũ(T)` of field `k` by reading `r`.
    pub fields: Vec<Vec<Vec<f64>>>,
    /// `plateau[r]`: `ũ(T)` of the first field by the plateau's reading `r`.
    pub plateau: Vec<Vec<f64>>,
    /// `early[k][t]`: `ũ` of field `k` by the first reading at each output time before the end; or,
    /// where they are all that is wanted, sums over the velocities for the moments of `f`, point by
    /// point.
    pub early: Vec<Vec<Vec<f64>>>,
    /// Largest over the modes of (change of the norm) / (what its method allows plus 1e-12); at
    /// most 1. None where the method does not keep the norm.
    pub unitarity_defect: Option<f64>,
    /// Smallest `‖w_l(T)‖/‖w_l(0)‖` over the modes of all ranks; none where the state is zero.
    pub norm_kept: Option<f64>,
    /// Leading term of the error that the time step leaves in each field by the first reading, like
    /// `fields`; empty where the method meets its tolerance by itself.
    pub step_errors: Vec<Vec<f64>>,
    /// By field, the norm of what modes may add to it whose step is too long for the leading term.
    pub step_beyond: Vec<f64>,
    /// Applications done by this rank's mode group; the first group counts those before a
    /// checkpoint that the run went on from.
    pub applications: usize,
    /// Those of this process.
    pub applications_here: usize,
    /// Linear systems solved by this rank's mode group.
    pub solves: usize,
    /// Seconds that this rank took for its batches.
    pub busy_seconds: f64,
}

/// What a full run does with the modes that it keeps.
pub struct Keeping<'a> {
    /// The modes of this rank, of one field after the other.
    pub kept: &'a mut KeptModes,
    /// Whether they are those that the run starts from, instead of the fields at time zero.
    pub begun: bool,
    /// What is to be done with a field at the end of a leg, on all ranks together: `(field, leg,
    /// modes)`.
    pub after: &'a mut dyn FnMut(usize, usize, &KeptModes) -> Result<()>,
}

/// What of a stage is finished.
pub(crate) struct StageBatches<'a> {
    /// Number of the stage.
    pub(crate) stage: usize,
    /// The modes of this rank that are finished.
    pub(crate) finished: &'a [usize],
    /// What was counted so far.
    pub(crate) statistics: &'a BatchStatistics,
}

/// A pass over the modes of a field.
pub(crate) struct Stage<'a> {
    pub(crate) field: usize,
    pub(crate) legs: Range<usize>,
    /// By leg of the stage, what is added up at each time that it passes, then at its end.
    pub(crate) sums: Vec<Vec<Sum<'a>>>,
    /// Whether the method leaves an error of its time step.
    pub(crate) stepped: bool,
    /// Where the stage goes to the end, the leading term of that; and by mode what is beyond.
    pub(crate) step_sum: Option<Sum<'a>>,
    pub(crate) beyond: Vec<f64>,
}

impl<'a> Stage<'a> {
    /// Empty sums for `legs` of field `k`.
    fn new(
        task: &Task<'a>,
        system: &mut Evolution<'_>,
        propagator: &dyn Propagator,
        k: usize,
        legs: Range<usize>,
    ) -> Self {
        let warp = task.warp;
        let norm = task.initial[k].norms.into_iter().fold(0.0, f64::max);
        let velocities = system.matrix.block.velocity_cells;
        let points = system.matrix.block.space_cells();
        let field = |reading, size| Sum::of_field(warp, reading, size * norm, points, velocities);
        let last = task.legs.len() - 1;
        let moments = || {
            let of = |moments| Sum::of_moments(warp, &warp.readings[0], norm, points, moments);
            task.moments.map(of)
        };
        let at_end = |leg: usize| match moments().filter(|_| task.legs[leg].moments_only) {
            _ if leg == last => {
                let plateau = if k == 0 { &warp.plateau[..] } else { &[] };
                warp.readings.iter().chain(plateau).map(|r| field(r, 1.0)).collect()
            }
            Some(moments) => vec![moments],
            None => vec![field(&warp.readings[0], 1.0)],
        };
        let on_the_way = |leg: usize| task.legs[leg].passed.iter().filter_map(|_| moments());
        let sums = legs.clone().map(|leg| on_the_way(leg).chain(at_end(leg)).collect()).collect();
        let stepped = propagator.step_error().is_some();
        let step_sum = (stepped && legs.end > last).then(|| {
            // T Δt^q c G^(q+1) w, G at most as large as H of the last mode.
            let mode = warp.modes.saturating_sub(1);
            let (mu, steps) = (warp.wavenumber(mode), warp.leg_work[last][mode]);
            let whole = whole_over_leg(task.legs, last);
            system.time = task.legs[last].time;
            let size = whole * propagator.largest_step_error(system, mu, steps);
            field(&warp.readings[0], size)
        });
        Self { field: k, legs, sums, stepped, step_sum, beyond: Vec::with_capacity(warp.modes) }
    }

    /// What is recovered, onto `recovered`. Collective.
    fn finish(self, task: &Task<'_>, velocities: usize, recovered: &mut Recovered) {
        let modes = &task.communicator.modes;
        let share = |sum: Sum<'_>| sum.share(modes, velocities, task.shares);
        let mut found: Vec<Vec<f64>> = self.sums.into_iter().flatten().map(share).collect();
        let at_end = (self.legs.end == task.legs.len()).then(|| {
            let plateau = if self.field == 0 { task.warp.plateau.len() } else { 0 };
            found.split_off(found.len() - task.warp.readings.len() - plateau)
        });
        if self.legs.start == 0 {
            recovered.early.push(Vec::new());
        }
        if let Some(early) = recovered.early.last_mut() {
            early.extend(found);
        }
        let Some(mut end) = at_end else { return };
        if self.field == 0 {
            recovered.plateau = end.split_off(task.warp.readings.len());
        }
        recovered.fields.push(end);
        recovered.step_errors.extend(self.step_sum.map(share));
        recovered.step_beyond.push(modes.sum_terms(&self.beyond));
    }
}

/// How much longer the run up to the end of a leg is than the leg: so much larger is what equal
/// steps leave of an error.
fn whole_over_leg(legs: &[Leg], leg: usize) -> f64 {
    legs[..=leg].iter().map(|leg| leg.time).sum::<f64>() / legs[leg].time
}

/// What a run does beside recovering fields: it keeps modes, it writes checkpoints.
#[derive(Default)]
pub struct RunHooks<'r, 'k, 'c> {
    /// Of a full run: what is kept. A streamed run drops the modes.
    pub keeping: Option<&'r mut Keeping<'k>>,
    /// Checkpoints that are made, and the one that the run goes on from.
    pub checkpoints: Option<&'r mut Checkpoints<'c>>,
}

/// Does the task, field after field. Collective.
///
/// # Errors
/// [`Error::Unitarity`] when a mode's norm changed by more than its method allows;
/// [`Error::Stopped`] and others as [`Checkpoints::are_over`]; what is done with the modes in
/// between.
pub fn run(
    task: &Task<'_>,
    system: &mut Evolution<'_>,
    propagator: &mut dyn Propagator,
    progress: &mut Progress,
    mut hooks: RunHooks<'_, '_, '_>,
) -> Result<Recovered> {
    let resumed = hooks.checkpoints.as_mut().and_then(|c| c.resumed.take());
    // What a batch starts from that does not start from a field at time zero.
    let begun = hooks.keeping.as_ref().is_some_and(|keeping| keeping.begun);
    let between = if begun || task.legs.len() > 1 { system.matrix.rows() } else { 0 };
    let legs = task.legs.len();
    let times = task.legs.iter().map(|leg| leg.passed.len()).max().unwrap_or(0);
    let matrix = system.matrix;
    let passed = (task.moments.filter(|_| times > 0))
        .map(|moments| PassedMoments::new(matrix, moments, times, task.warp.largest_work()));
    let at_once = if hooks.keeping.is_some() { 1 } else { legs };
    let stages: Vec<(usize, usize)> = (0..task.initial.len())
        .flat_map(|k| (0..legs).step_by(at_once).map(move |leg| (k, leg)))
        .collect();
    let first = resumed.as_ref().map_or(0, |r| r.generation.state.stage);
    let mut run = ModeRun {
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
        recovered: Recovered::default(),
    };
    for (number, &(k, leg)) in stages.iter().enumerate().skip(first) {
        let from = resumed.as_ref().filter(|_| number == first);
        run.stage(number, k, leg..leg + at_once, from)?;
    }
    Ok(run.counted())
}

/// A run of modes on its way through the stages.
struct ModeRun<'r, 'a, 's, 'k, 'c> {
    task: &'r Task<'a>,
    system: &'r mut Evolution<'s>,
    propagator: &'r mut dyn Propagator,
    progress: &'r mut Progress,
    keeping: Option<&'r mut Keeping<'k>>,
    checkpoints: Option<&'r mut Checkpoints<'c>>,
    /// The state of a batch between two legs.
    between: Vec<Lanes>,
    /// The moments of a batch at the times that a leg passes.
    passed: Option<PassedMoments<'a>>,
    /// What was counted before the checkpoint that the run goes on from.
    before: BatchStatistics,
    /// What was counted since the beginning.
    statistics: BatchStatistics,
    recovered: Recovered,
}

impl ModeRun<'_, '_, '_, '_, '_> {
    /// Does stage number `number`, of field `k`: all its batches, or those that are left of it
    /// after a checkpoint. Collective.
    fn stage(
        &mut self,
        number: usize,
        k: usize,
        legs: Range<usize>,
        from: Option<&Resumed<'_>>,
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
        stage.finish(task, self.system.matrix.block.velocity_cells, &mut self.recovered);
        match self.keeping.as_deref_mut() {
            Some(keeping) => (keeping.after)(k, leg, keeping.kept),
            None => Ok(()),
        }
    }

    /// Takes over what the checkpoint holds. Collective.
    fn resume(
        &mut self,
        stage: &mut Stage<'_>,
        resumed: &Resumed<'_>,
        finished: &mut Vec<usize>,
    ) -> Result<()> {
        let task = self.task;
        let kept = self.keeping.as_deref_mut().map(|keeping| &mut *keeping.kept);
        let read = stage.resume(resumed, task, self.system.matrix, kept, &mut self.recovered);
        task.communicator.world.agree(read)?;
        if task.communicator.modes.rank() == 0 {
            let state = &resumed.generation.state;
            self.before = state.statistics.clone();
            finished.extend_from_slice(&state.finished);
        }
        self.statistics = self.before.clone();
        Ok(())
    }

    /// Does the batches one after the other, with checkpoints between them. What goes wrong with a
    /// batch on one rank is the inner result; the ranks do not agree on it. Collective.
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
                (Err(e), _) if e.is_left() => Standing::Left,
                (Err(_), _) => Standing::Failed,
                (Ok(()), 0) => Standing::Finished,
                _ => Standing::Working,
            };
            let over = match self.checkpoints.as_mut() {
                Some(checkpoints) => checkpoints.are_over(standing, || {
                    let statistics = &self.statistics;
                    let batches = StageBatches { stage: number, finished, statistics };
                    let kept = self.keeping.as_ref().map(|keeping| &*keeping.kept);
                    stage.snapshot(&batches, task, self.system.matrix, kept, &self.recovered)
                })?,
                None => standing != Standing::Working,
            };
            if over {
                // What failed, failed on another rank.
                return Ok(outcome.or_else(|e| if e.is_left() { Ok(()) } else { Err(e) }));
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

    /// What was recovered, with what was counted. Collective.
    fn counted(self) -> Recovered {
        let Self { task, before, statistics, mut recovered, .. } = self;
        let world = &task.communicator.world;
        // A rank without batches knows of no defect and no norm.
        let smallest = -world.max(-statistics.kept.unwrap_or(f64::INFINITY));
        let largest = world.max(statistics.defect.unwrap_or(-1.0));
        recovered.unitarity_defect = Some(largest).filter(|d| *d >= 0.0);
        recovered.norm_kept = Some(smallest).filter(|r| r.is_finite());
        recovered.applications = statistics.applications;
        recovered.applications_here = statistics.applications - before.applications;
        recovered.solves = statistics.solves;
        recovered
    }
}

/// Where the modes of a batch go.
struct BatchDestination<'b, 'a, 'k, 'm> {
    stage: &'b mut Stage<'a>,
    /// The state at the end of a leg, from which the next begins.
    between: &'b mut [Lanes],
    /// The moments at the times that a leg passes, if one passes any.
    passed: Option<&'b mut PassedMoments<'m>>,
    /// Of a full run, what is kept.
    keeping: Option<&'b mut Keeping<'k>>,
    statistics: &'b mut BatchStatistics,
}

/// Propagates the modes of a batch through the legs of the stage and adds them to its sums; from
/// and to what is kept, if anything is. Collective over the space group; allocates nothing.
fn add_batch(
    task: &Task<'_>,
    system: &mut Evolution<'_>,
    propagator: &mut dyn Propagator,
    batch: &Batch,
    destination: BatchDestination<'_, '_, '_, '_>,
) -> Result<()> {
    let BatchDestination { stage, between, mut passed, keeping, statistics } = destination;
    let (warp, initial) = (task.warp, &task.initial[stage.field]);
    let cells = system.matrix.block.cells();
    let mut lanes = LaneProgress::start(initial.norms);
    let begun = keeping.as_ref().is_some_and(|keeping| keeping.begun);
    if let Some(keeping) = keeping.as_ref().filter(|_| begun || stage.legs.start > 0) {
        lanes.load(keeping.kept, batch, between);
    }
    for leg in stage.legs.clone() {
        let Leg { time, passed: times, .. } = &task.legs[leg];
        system.time = *time;
        // Nothing of the batch was added to a sum so far.
        system.interruption.allowed = leg == stage.legs.start;
        let spec = specification(warp, leg, batch);
        let start = Initial {
            state: match leg {
                0 if !begun => initial.state,
                _ => Start::Lanes(between),
            },
            norms: lanes.norms,
        };
        let (on_the_way, at_end) = stage.sums[leg - stage.legs.start].split_at_mut(times.len());
        let report = match passed.as_deref_mut().filter(|_| !times.is_empty()) {
            Some(passed) => {
                passed.begin(times, &weights(warp, batch, &warp.readings[0], &lanes.phases));
                let report = propagator.propagate_past(system, &spec, &start, passed)?;
                for (t, sum) in on_the_way.iter_mut().enumerate() {
                    sum.add_moments(passed.at(t));
                }
                report
            }
            None => propagator.propagate(system, &spec, &start)?,
        };
        lanes.advance(leg, &report);
        let state = propagator.state();
        let (ratio, found) = lanes.norms_kept(system, state, &spec, batch, report.unitary)?;
        statistics.norms(ratio, found);
        statistics.took(&report);
        for sum in at_end {
            sum.add(&weights(warp, batch, &sum.reading, &lanes.phases), &state[..cells]);
        }
        if leg + 1 < stage.legs.end {
            between.copy_from_slice(&state[..between.len()]);
            continue;
        }
        add_step_error(task, system, propagator, stage, &LaneEnds { batch, spec, lanes: &lanes });
    }
    if let Some(keeping) = keeping {
        lanes.store(keeping.kept, batch, stage.legs.end, propagator.state());
    }
    Ok(())
}

/// How far the lanes of a batch are.
struct LaneProgress {
    /// What each lane is to be multiplied by.
    phases: [Complex64; LANES],
    /// How much of its norm each lane's norm may have changed so far.
    allowed: [f64; LANES],
    /// Norms at time zero.
    norms: [f64; LANES],
}

impl LaneProgress {
    /// Of lanes with these norms that have not begun.
    fn start(norms: [f64; LANES]) -> Self {
        Self { phases: [Complex64::ONE; LANES], allowed: [0.0; LANES], norms }
    }

    /// Loads the modes of `batch` that this rank has kept into `state`, and how far they are.
    fn load(&mut self, kept: &KeptModes, batch: &Batch, state: &mut [Lanes]) {
        kept.load(&batch.modes, state);
        for l in 0..LANES {
            let mode = batch.modes[l.min(batch.modes.len() - 1)];
            if let Some(progress) = kept.progress_of(mode) {
                (self.phases[l], self.allowed[l], self.norms[l]) =
                    (progress.phase, progress.allowed, progress.norm);
            }
        }
    }

    /// Adds what propagating over `leg` reports.
    fn advance(&mut self, leg: usize, report: &BatchReport) {
        for l in 0..LANES {
            let before = self.phases[l];
            self.phases[l] = if leg == 0 { report.phases[l] } else { before * report.phases[l] };
            self.allowed[l] += report.tails[l] + UNITARITY_ROUND_OFF;
        }
    }

    /// Keeps the modes of `batch`, which are in `state` after so many `legs`.
    fn store(&self, kept: &mut KeptModes, batch: &Batch, legs: usize, state: &[Lanes]) {
        let progress = std::array::from_fn(|l| ModeProgress {
            legs,
            phase: self.phases[l],
            norm: self.norms[l],
            allowed: self.allowed[l],
        });
        kept.store(&batch.modes, &progress, state);
    }

    /// Smallest ratio of a lane's norm to what it was, infinite where that was zero; and, where the
    /// method is `unitary`, the largest change as a fraction of what is allowed. Collective over the
    /// space group.
    ///
    /// # Errors
    /// [`Error::Unitarity`] where it is more.
    fn norms_kept(
        &self,
        system: &Evolution<'_>,
        state: &[Lanes],
        spec: &BatchSpec,
        batch: &Batch,
        unitary: bool,
    ) -> Result<(f64, Option<f64>)> {
        let Self { norms, allowed, .. } = self;
        let now = system.lane_norms(&norms.map(|norm| norm * norm), state);
        let (mut kept, mut defect) = (f64::INFINITY, 0.0f64);
        for (l, &mode) in batch.modes.iter().enumerate() {
            if norms[l] == 0.0 {
                continue;
            }
            let ratio = now[l] / norms[l];
            kept = kept.min(ratio);
            if !unitary {
                continue;
            }
            let change = (ratio - 1.0).abs();
            if change.is_nan() || change > allowed[l] {
                return Err(Error::Unitarity {
                    mode,
                    wavenumber: spec.wavenumbers[l],
                    defect: change,
                    allowed: allowed[l],
                });
            }
            defect = defect.max(change / allowed[l]);
        }
        Ok((kept, unitary.then_some(defect)))
    }
}

/// The lanes of a batch at the end of its last leg.
struct LaneEnds<'a> {
    batch: &'a Batch,
    spec: BatchSpec,
    lanes: &'a LaneProgress,
}

/// Adds the leading term of the error that the time step leaves, where the method leaves one and
/// the stage goes to the end. Collective over the space group.
fn add_step_error(
    task: &Task<'_>,
    system: &mut Evolution<'_>,
    propagator: &dyn Propagator,
    stage: &mut Stage<'_>,
    ends: &LaneEnds<'_>,
) {
    let (Some(sum), Some(error)) = (&mut stage.step_sum, propagator.step_error()) else { return };
    let LaneEnds { batch, spec, lanes: LaneProgress { phases, norms, .. } } = ends;
    let whole = whole_over_leg(task.legs, task.legs.len() - 1);
    let steps = spec.largest_work();
    let bound =
        |l: usize| propagator.largest_step_error(system, spec.wavenumbers[l], steps) * norms[l];
    let bounds: [f64; LANES] = std::array::from_fn(bound);
    let sizes = system.lane_norms(&bounds.map(|b| b * b), error);
    // No mode is further off than its two states are long: where the leading term is, it is cut to
    // that.
    let most = norms.map(|norm| 2.0 * norm);
    let parts: [f64; LANES] = std::array::from_fn(|l| {
        let size = whole * sizes[l];
        whole * if size > most[l] { most[l] / size } else { 1.0 }
    });
    let cut = |l: &usize| parts[*l] < whole;
    for l in (0..batch.modes.len()).filter(cut) {
        let weight = task.warp.weight(batch.modes[l], &task.warp.readings[0]).norm();
        stage.beyond.push(most[l] * weight);
    }
    let factors = std::array::from_fn(|l| parts[l] * phases[l]);
    let cells = system.matrix.block.cells();
    sum.add(&weights(task.warp, batch, &sum.reading, &factors), &error[..cells]);
}

/// What each lane is multiplied by in a reading, `factors` of it included.
fn weights(
    warp: &WarpPlan,
    batch: &Batch,
    reading: &Reading,
    factors: &[Complex64; LANES],
) -> [Complex64; LANES] {
    let mut weights = [Complex64::ZERO; LANES];
    for (l, &mode) in batch.modes.iter().enumerate() {
        weights[l] = warp.weight(mode, reading) * factors[l];
    }
    weights
}

fn specification(warp: &WarpPlan, leg: usize, batch: &Batch) -> BatchSpec {
    let mode = |l: usize| batch.modes[l.min(batch.modes.len() - 1)];
    BatchSpec {
        modes: batch.modes.len(),
        wavenumbers: std::array::from_fn(|l| warp.wavenumber(mode(l))),
        tolerances: std::array::from_fn(|l| warp.leg_tolerance(mode(l))),
        work: std::array::from_fn(|l| warp.leg_work[leg][mode(l)]),
    }
}
