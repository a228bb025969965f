//! The tasks of a run by modes, and its stages: each is a pass over the modes of a field.

use crate::base::error::Result;
use crate::matrix::observables::MomentsOf;
use crate::parallel::communicator::Communicator;
use crate::plan::balance::Batch;
use crate::problem::legs::Leg;
use crate::propagate::evolution::{Evolution, InitialState};
use crate::propagate::method::Propagator;
use crate::schrodingerization::warp_plan::WarpPlan;
use crate::solve::field_readings::{FieldHistory, FieldReadings};
use crate::solve::rank_modes::RankModes;
use crate::solve::statistics::BatchStatistics;
use crate::solve::sum::ModeSum;
use std::ops::Range;
use std::sync::Arc;

/// The tasks of a run on this rank.
#[derive(Clone, Copy)]
pub struct Task<'a> {
    /// The process mesh.
    pub communicator: &'a Communicator,
    /// Profile, modes, readings.
    pub warp: &'a WarpPlan,
    /// Length of each leg and the readings at its end; at the end of the last leg all are taken.
    pub legs: &'a [Leg],
    /// The batches of this rank's mode group.
    pub batches: &'a [Batch],
    /// The fields at time zero.
    pub initial: &'a [InitialState<'a>],
    /// `shares[g]`: the block's cells whose results rank `g` of the mode groups has.
    pub shares: &'a [Range<usize>],
    /// The computation of moments, for output times that need moments only.
    pub moments: Option<&'a MomentsOf<'a>>,
}

impl Task<'_> {
    /// The error of the time steps of all legs in errors of those of the last leg: `Σ t Δt^q` over
    /// the legs, each with equal steps.
    pub fn whole_over_last(&self, order: i32) -> f64 {
        let of_leg = |(leg, work): (&Leg, &Arc<[usize]>)| {
            let steps = work.first().map_or(1, |steps| (*steps).max(1));
            leg.time * (leg.time / steps as f64).powi(order)
        };
        let parts: Vec<f64> = self.legs.iter().zip(&self.warp.leg_work).map(of_leg).collect();
        parts.last().map_or(1.0, |last| parts.iter().sum::<f64>() / last)
    }
}

/// The recovered fields on this rank's share of the block's cells.
#[derive(Clone, Debug, Default)]
pub struct RecoveredFields {
    /// `ũ(T)` of each field.
    pub fields: Vec<FieldReadings>,
    /// `plateau[r]`: `ũ(T)` of the first field by the plateau's reading `r`.
    pub plateau: Vec<Vec<f64>>,
    /// Each field at the output times before the end.
    pub early: Vec<FieldHistory>,
    /// Largest over the modes of (change of the norm) / (change that its method allows + 1e-12); at
    /// most 1. `None` if the method does not preserve the norm.
    pub unitarity_defect: Option<f64>,
    /// Smallest `‖w_l(T)‖/‖w_l(0)‖` over the modes of all ranks; `None` if the state is zero.
    pub norm_kept: Option<f64>,
    /// Leading term of the time-step error of each field by the first reading, as in `fields`;
    /// empty if the method meets its tolerance by itself.
    pub step_errors: Vec<Vec<f64>>,
    /// By field, a bound on the error of modes for which the step is too long to use the leading
    /// term.
    pub step_beyond: Vec<f64>,
    /// Applications of this rank's mode group; the first group includes those before the checkpoint
    /// from which the run continues.
    pub applications: usize,
    /// Applications of this rank's mode group since the process started.
    pub applications_here: usize,
    /// Linear systems solved by this rank's mode group.
    pub solves: usize,
    /// Seconds that this rank took for its batches.
    pub busy_seconds: f64,
}

/// The tasks of a full run with the modes that it stores.
pub struct FullRunModes<'a> {
    /// The modes of this rank, of one field after the other.
    pub kept: &'a mut RankModes,
    /// Whether the run starts from these modes instead of the fields at time zero.
    pub begun: bool,
    /// Called on all ranks with the modes at the end of each leg.
    pub after: &'a mut dyn FnMut(LegEnd, &RankModes) -> Result<()>,
}

/// The end of a leg of a field's modes.
#[derive(Clone, Copy, Debug)]
pub struct LegEnd {
    /// Number of the field.
    pub field: usize,
    /// Number of the leg.
    pub leg: usize,
}

/// The finished part of a stage.
pub(crate) struct StageBatches<'a> {
    pub(crate) stage: usize,
    /// The modes of this rank that are finished.
    pub(crate) finished: &'a [usize],
    pub(crate) statistics: &'a BatchStatistics,
}

/// A pass over the modes of a field.
pub(crate) struct Stage<'a> {
    pub(crate) field: usize,
    pub(crate) legs: Range<usize>,
    /// By leg of the stage, the sums at each time that the leg passes, then at its end.
    pub(crate) sums: Vec<Vec<ModeSum<'a>>>,
    /// Whether the method has a time-step error.
    pub(crate) stepped: bool,
    /// The leading term of that error, if the stage goes to the end.
    pub(crate) step_sum: Option<ModeSum<'a>>,
    /// Bounds on the error of modes whose step is too long for the leading term.
    pub(crate) beyond: Vec<f64>,
}

impl<'a> Stage<'a> {
    /// Empty sums for `legs` of field `k`.
    pub(crate) fn new(
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
        let field =
            |reading, size| ModeSum::of_field(warp, reading, size * norm, points, velocities);
        let last = task.legs.len() - 1;
        let moments = || {
            let of = |moments| ModeSum::of_moments(warp, &warp.readings[0], norm, points, moments);
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
            let whole = task.whole_over_last(propagator.step_order());
            system.time = task.legs[last].time;
            let size = whole * propagator.largest_step_error(system, mu, steps);
            field(&warp.readings[0], size)
        });
        Self { field: k, legs, sums, stepped, step_sum, beyond: Vec::with_capacity(warp.modes) }
    }

    /// Adds the recovered field to `recovered`. Collective.
    pub(crate) fn finish(
        self,
        task: &Task<'_>,
        velocities: usize,
        recovered: &mut RecoveredFields,
    ) {
        let modes = &task.communicator.modes;
        let share = |sum: ModeSum<'_>| sum.share(modes, velocities, task.shares);
        let mut found: Vec<Vec<f64>> = self.sums.into_iter().flatten().map(share).collect();
        let at_end = (self.legs.end == task.legs.len()).then(|| {
            let plateau = if self.field == 0 { task.warp.plateau.len() } else { 0 };
            found.split_off(found.len() - task.warp.readings.len() - plateau)
        });
        if self.legs.start == 0 {
            recovered.early.push(FieldHistory::default());
        }
        if let Some(early) = recovered.early.last_mut() {
            early.times.extend(found);
        }
        let Some(mut end) = at_end else { return };
        if self.field == 0 {
            recovered.plateau = end.split_off(task.warp.readings.len());
        }
        recovered.fields.push(FieldReadings::new(end));
        recovered.step_errors.extend(self.step_sum.map(share));
        recovered.step_beyond.push(modes.sum_terms(&self.beyond));
    }
}
