//! The propagation of a batch of modes through the legs of a stage.

use crate::base::error::{Error, Result};
use crate::matrix::lanes::{LANES, Lanes};
use crate::plan::balance::Batch;
use crate::problem::legs::Leg;
use crate::propagate::evolution::{BatchSpec, Evolution, InitialState, StateRows};
use crate::propagate::intermediate_moments::IntermediateMoments;
use crate::propagate::method::{BatchReport, Propagator};
use crate::schrodingerization::recovery::Reading;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::rank_modes::{ModeProgress, RankModes};
use crate::solve::stage::{FullRunModes, Stage, Task};
use crate::solve::statistics::BatchStatistics;
use crate::solve::sum::ModeSum;
use num_complex::Complex64;

/// Bound on the change of a mode's norm by round-off, per leg.
const UNITARITY_ROUND_OFF: f64 = 1e-12;

/// The vectors that receive the modes of a batch.
pub(super) struct BatchDestination<'b, 'a, 'k, 'm> {
    pub(super) stage: &'b mut Stage<'a>,
    /// The state at the end of a leg, with which the next begins.
    pub(super) between: &'b mut [Lanes],
    /// The moments at the times that legs pass, if any.
    pub(super) passed: Option<&'b mut IntermediateMoments<'m>>,
    /// The stored modes of a full run.
    pub(super) keeping: Option<&'b mut FullRunModes<'k>>,
    pub(super) statistics: &'b mut BatchStatistics,
}

/// Propagates the modes of a batch through the legs of the stage and adds them to its sums; a full
/// run also loads and stores them. Collective over the space group; allocates nothing.
pub(super) fn add_batch(
    task: &Task<'_>,
    system: &mut Evolution<'_>,
    propagator: &mut dyn Propagator,
    batch: &Batch,
    destination: BatchDestination<'_, '_, '_, '_>,
) -> Result<()> {
    let BatchDestination { stage, between, mut passed, keeping, statistics } = destination;
    let (warp, initial) = (task.warp, &task.initial[stage.field]);
    let begun = keeping.as_ref().is_some_and(|keeping| keeping.begun);
    let stored = keeping.as_ref().filter(|_| begun || stage.legs.start > 0);
    let mut lanes = LaneProgress::start(initial.norms);
    stored.into_iter().for_each(|keeping| lanes.load(keeping.kept, batch, between));
    for leg in stage.legs.clone() {
        let Leg { time, passed: times, .. } = &task.legs[leg];
        system.time = *time;
        // The sums do not contain the batch yet.
        system.interruption.allowed = leg == stage.legs.start;
        let spec = specification(warp, leg, batch);
        let start = InitialState {
            state: match leg {
                0 if !begun => initial.state,
                _ => StateRows::Lanes(between),
            },
            norms: lanes.norms,
        };
        let (on_the_way, at_end) = stage.sums[leg - stage.legs.start].split_at_mut(times.len());
        let mut moments = passed.as_deref_mut().filter(|_| !times.is_empty());
        let factors = weights(warp, batch, &warp.readings[0], &lanes.phases);
        moments.iter_mut().for_each(|moments| moments.begin(times, &factors));
        let report = propagated(system, propagator, &spec, &start, moments, on_the_way)?;
        lanes.advance(leg, &report);
        let (cells, state) = (system.matrix.block.cells(), propagator.state());
        let at_leg_end = BatchAtLegEnd { batch, spec: &spec, lanes: &lanes, propagator };
        let [kept, defect] = at_leg_end.norms_kept(system, report.unitary)?;
        statistics.norms(kept, defect);
        statistics.took(&report);
        for sum in at_end {
            sum.add(&weights(warp, batch, &sum.reading, &lanes.phases), &state[..cells]);
        }
        if leg + 1 < stage.legs.end {
            between.copy_from_slice(&state[..between.len()]);
            continue;
        }
        at_leg_end.add_step_error(task, system, stage);
    }
    if let Some(keeping) = keeping {
        lanes.store(keeping.kept, batch, stage.legs.end, propagator.state());
    }
    Ok(())
}

/// Propagates a batch over a leg, and adds the moments at the times that it passes, if any, to
/// `sums`. Collective over the space group; allocates nothing.
fn propagated(
    system: &mut Evolution<'_>,
    propagator: &mut dyn Propagator,
    spec: &BatchSpec,
    start: &InitialState<'_>,
    moments: Option<&mut IntermediateMoments<'_>>,
    sums: &mut [ModeSum],
) -> Result<BatchReport> {
    let Some(moments) = moments else {
        return propagator.propagate(system, spec, start);
    };
    let report = propagator.propagate_past(system, spec, start, moments)?;
    for (t, sum) in sums.iter_mut().enumerate() {
        sum.add_moments(moments.at(t));
    }
    Ok(report)
}

struct LaneProgress {
    /// The factor of each lane.
    phases: [Complex64; LANES],
    /// Allowed change of each lane's norm so far, relative to the norm.
    allowed: [f64; LANES],
    /// Norms at time zero.
    norms: [f64; LANES],
}

impl LaneProgress {
    /// Initial progress of lanes with these norms.
    fn start(norms: [f64; LANES]) -> Self {
        Self { phases: [Complex64::ONE; LANES], allowed: [0.0; LANES], norms }
    }

    /// Loads the modes of `batch` that this rank has stored into `state`, and their progress.
    fn load(&mut self, kept: &RankModes, batch: &Batch, state: &mut [Lanes]) {
        kept.load(batch, state);
        for l in 0..LANES {
            if let Some(progress) = kept.progress_of(batch.mode(l)) {
                (self.phases[l], self.allowed[l], self.norms[l]) =
                    (progress.phase, progress.allowed, progress.norm);
            }
        }
    }

    /// Adds the report of the propagation over `leg`.
    fn advance(&mut self, leg: usize, report: &BatchReport) {
        for l in 0..LANES {
            let before = self.phases[l];
            self.phases[l] = if leg == 0 { report.phases[l] } else { before * report.phases[l] };
            self.allowed[l] += report.tails[l] + UNITARITY_ROUND_OFF;
        }
    }

    /// Stores the modes of `batch`, which `state` holds after `legs` legs.
    fn store(&self, kept: &mut RankModes, batch: &Batch, legs: usize, state: &[Lanes]) {
        let progress = std::array::from_fn(|l| ModeProgress {
            legs,
            phase: self.phases[l],
            norm: self.norms[l],
            allowed: self.allowed[l],
        });
        kept.store(&batch.modes, &progress, state);
    }
}

/// A batch after the propagation over a leg.
struct BatchAtLegEnd<'a> {
    batch: &'a Batch,
    spec: &'a BatchSpec,
    lanes: &'a LaneProgress,
    /// Holds the state, and its time-step error if the method has one.
    propagator: &'a dyn Propagator,
}

impl BatchAtLegEnd<'_> {
    /// Smallest ratio of a lane's norm to its norm at time zero, `None` where that was zero; and,
    /// where the method is `unitary`, the largest change as a fraction of the allowed one.
    /// Collective over the space group.
    ///
    /// # Errors
    /// [`Error::Unitarity`] where a norm changed by more.
    fn norms_kept(&self, system: &Evolution<'_>, unitary: bool) -> Result<[Option<f64>; 2]> {
        let Self { batch, spec, lanes, propagator } = self;
        let LaneProgress { norms, allowed, .. } = lanes;
        let now = system.lane_norms(&norms.map(|norm| norm * norm), propagator.state());
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
        Ok([Some(kept).filter(|kept| kept.is_finite()), unitary.then_some(defect)])
    }

    /// Adds the leading term of the time-step error of a batch, if the method has one and the stage
    /// goes to the end. Collective over the space group.
    fn add_step_error(&self, task: &Task<'_>, system: &mut Evolution<'_>, stage: &mut Stage<'_>) {
        let Self { batch, spec, lanes, propagator } = self;
        let LaneProgress { phases, norms, .. } = lanes;
        let (Some(sum), Some(error)) = (&mut stage.step_sum, propagator.step_error()) else {
            return;
        };
        let whole = task.whole_over_last(propagator.step_order());
        let steps = spec.largest_work();
        let bound =
            |l: usize| propagator.largest_step_error(system, spec.wavenumbers[l], steps) * norms[l];
        let bounds: [f64; LANES] = std::array::from_fn(bound);
        let sizes = system.lane_norms(&bounds.map(|b| b * b), error);
        // The error of a mode is at most the sum of the norms of its two states, to which the
        // leading term is cut.
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
}

/// The factor of each lane in a reading; it includes the reading's own `factors`.
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
    BatchSpec {
        modes: batch.modes.len(),
        wavenumbers: std::array::from_fn(|l| warp.wavenumber(batch.mode(l))),
        tolerances: std::array::from_fn(|l| warp.leg_tolerance(batch.mode(l))),
        work: std::array::from_fn(|l| warp.leg_work[leg][batch.mode(l)]),
    }
}
